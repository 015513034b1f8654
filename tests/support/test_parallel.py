"""Sweeps on one machine: early results, order, errors, and addresses that lead nowhere."""

import os
import socket
import subprocess
import sys
import time

import pytest

from benchmarks import hidden_effects
from rdpi_gym.cli import main
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.parallel import Pool, run_cases
from tests.looping import over

# Functions are made inside functions: what pickles by value needs no import in another process.


def squares():
    def square(x):
        return x * x

    return square


@pytest.fixture
def closed_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    return f"127.0.0.1:{port}"


@over("jobs", [1, 2, -1])
def test_every_case_has_one_result(jobs):
    assert sorted(run_cases(squares(), list(range(7)), jobs)) == [k * k for k in range(7)]


def test_a_pool_keeps_the_order_and_starts_processes_for_long_work_alone(monkeypatch):
    def slow_first(case):
        time.sleep(0.5 if case == 1 else 0.01)
        return case, os.getpid()

    pool, seen = Pool(2), []
    short = pool.map(slow_first, [0, 0, 0], seen.append)
    assert {process for _, process in short} == {os.getpid()}
    assert seen == short
    monkeypatch.setattr("rdpi_gym.support.parallel._WORTH_S", 0.02)
    results = pool.map(slow_first, [0, 1, 2, 3, 4], seen.append)
    assert [case for case, _ in results] == [0, 1, 2, 3, 4]
    first, *others = (process for _, process in results)
    assert first == os.getpid()
    assert os.getpid() not in others
    assert sorted(seen[3:]) == sorted(results)
    assert os.getpid() not in {process for _, process in pool.map(slow_first, [0, 0])}


def test_one_process_takes_the_cases_in_turn_and_waits_to_be_asked():
    taken = []
    results = run_cases(taken.append, ["a", "b"], jobs=1)
    assert taken == []
    next(results)
    assert taken == ["a"]


def test_results_come_before_the_last_case_is_done(tmp_path):
    def waits(name):
        deadline = time.monotonic() + 20.0
        while name == "slow" and not (tmp_path / "seen").exists():
            if time.monotonic() > deadline:
                return "nobody took the first result"
            time.sleep(0.01)
        return name

    seen = []
    for result in run_cases(waits, ["slow", "quick"], jobs=2):
        seen.append(result)
        (tmp_path / "seen").touch()
    assert seen == ["quick", "slow"]


@pytest.mark.parametrize("leave", ["close", "error"])
def test_a_sweep_may_be_left_early_without_a_word(leave, tmp_path, recwarn):
    def waits(case):
        deadline = time.monotonic() + 20.0
        while case and not (tmp_path / "left").exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        return case

    results = run_cases(waits, [0, 1, 2, 3, 4, 5], jobs=2)
    assert next(results) == 0
    if leave == "close":
        results.close()
    else:
        with pytest.raises(ZeroDivisionError):
            results.throw(ZeroDivisionError)
    (tmp_path / "left").touch()
    assert [str(each.message) for each in recwarn] == []


INTERRUPTED = """
import os, signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
from rdpi_gym.support.parallel import run_cases

class Interrupting(list):
    def __iter__(self):
        os.kill(os.getpid(), signal.SIGINT)
        return super().__iter__()

try:
    list(run_cases(time.sleep, Interrupting([0.2] * 6), jobs=2))
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.skipif(os.name == "nt", reason="signals of a terminal")
def test_an_interrupt_while_its_processes_start_ends_a_sweep_without_a_word():
    run = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True)
    assert (run.stdout, run.stderr) == ("interrupted\n", "")


def test_a_process_has_one_thread(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")

    def seen(name):
        return os.environ.get(name)

    names = ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"]
    assert list(run_cases(seen, names, jobs=2)) == ["1", "1"]


@over("jobs", [1, 2])
def test_what_a_case_raises_is_raised(jobs):
    def fails(number):
        raise InputError(f"case {number} is no case")

    with pytest.raises(InputError, match=r"^case 0 is no case$"):
        list(run_cases(fails, [0, 0], jobs))


def test_without_cases_no_cluster_is_asked(closed_port):
    assert list(run_cases(squares(), [], ray_address=closed_port)) == []


def test_without_ray_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputError, match=r"^--ray needs Ray; pip install 'rdpi-gym\[ray\]'$"):
        list(run_cases(squares(), [1], ray_address="auto"))


@over("address", ["nonsense", "a b:c", "http://127.0.0.1"])
def test_an_address_that_is_none_is_refused_in_one_line(address):
    pytest.importorskip("ray", reason="Ray is not installed")
    with pytest.raises(
        InputError, match=f"^--ray {address}: no connection to a Ray cluster"
    ) as error:
        list(run_cases(squares(), [1], ray_address=address))
    assert "\n" not in str(error.value)


@over("scheme", ["", "ray://"])
def test_the_commands_say_in_one_line_that_nobody_answers(scheme, closed_port, tmp_path, capsys):
    pytest.importorskip("ray", reason="Ray is not installed")
    address = scheme + closed_port
    out = str(tmp_path / "out")
    bench = [
        "bench", "--controllers", "none", "--plants", "P5", "--references", "steps",
        "--ts", "1e-3", "--seeds", "1", "--out", out, "--ray", address,
    ]  # fmt: skip
    assert main(bench) == 2
    first = capsys.readouterr().err
    study = ["--study", "none", "--plants", "1", "--out", out, "--ray", address]
    assert hidden_effects.main(study) == 2
    second = capsys.readouterr().err
    for said in (first, second):
        assert f"--ray {address}: no connection to a Ray cluster there" in said
        assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
