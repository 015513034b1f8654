"""What reaches a terminal, in which encoding, and how a command ends."""

import io
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from numba import njit

from rdpi_gym.support.command import run_command
from rdpi_gym.support.compiling import compilations
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.terminal import console, plain_output

TOP = Path(__file__).parents[2]
EVIL = "a title\x1b[2J\x1b]0;owned\x07 [bold]x[/bold] \u202egnp"
SHOWN = "a title\\x1b[2J\\x1b]0;owned\\x07 [bold]x[/bold] \\u202egnp"
INTERRUPTED = "rdpi: interrupted; what was computed is kept, and the same command goes on from it\n"
# As the script `rdpi` does, once the interpreter stands. Whoever runs the tests in the background has
# them ignore interrupts; a terminal does not.
SCRIPT = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
    "import sys; sys.argv[0] = 'rdpi'; import rdpi_gym.support.guard; print('up', flush=True);"
    "from rdpi_gym.cli import main; sys.exit(main())"
)


def started(words, **options):
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT, *map(str, words)],
        env={**os.environ, "PYTHONPATH": str(TOP)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **options,
    )


def shell(line, **variables):
    return subprocess.run(
        ["bash", "-c", re.sub(r"\brdpi\b", f"{sys.executable} -m rdpi_gym", line)],
        env={**os.environ, "PYTHONPATH": str(TOP), **variables},
        capture_output=True,
        cwd=TOP,
        timeout=120,
    )


def test_no_control_character_is_printed_by_a_command(capsys):
    def prints():
        print(EVIL)
        print("µm\tdone")
        console().print(EVIL)
        print(EVIL, file=sys.stderr)

    assert run_command("rdpi", prints) == 0
    printed = capsys.readouterr()
    assert printed.out == f"{SHOWN}\nµm\tdone\n{SHOWN}\n"
    assert printed.err == f"{SHOWN}\n"


def test_a_table_shows_names_as_they_are(capsys):
    from rich.table import Table

    table = Table("name")
    table.add_row(EVIL)
    with plain_output():
        console().print(table)
    printed = capsys.readouterr().out
    assert SHOWN in printed
    assert "\x1b" not in printed


def test_colours_reach_a_terminal_and_names_do_not_make_them(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    screen = Terminal()
    monkeypatch.setattr(sys, "stdout", screen)
    monkeypatch.setenv("TERM", "xterm")
    with plain_output():
        console().print("\x1b[31m" + "red", style="bold")
    assert screen.getvalue() == "\x1b[1m\\x1b[31mred\x1b[0m\n"


def test_a_terminal_sees_that_kernels_are_compiled(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setenv("COLUMNS", "200")

    @njit
    def inner(x):
        return x + 1.0

    @njit
    def outer(x):
        return inner(x) * 2.0

    with progress_bar() as show, compilations() as found:
        show("fitting", 0, 0)
        assert outer(1.0) == 4.0
        assert outer(2.0) == 6.0
        written = sys.stderr.getvalue()
    assert (found.kernels, found.depth) == (1, 0)
    assert found.seconds > 0.0
    assert "compiling, once per installation: kernel 1, 0 s" in written
    assert written.rstrip().rindex("fitting") > written.rindex("compiling")


@pytest.mark.parametrize(
    ("encoding", "shown"),
    [("ascii", b"8.1 um, delta2 ? ?\n"), ("latin-1", b"8.1 \xb5m, delta2 ? ?\n")],
)
def test_an_encoding_that_lacks_letters_spells_them(encoding, shown, monkeypatch):
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding)
    monkeypatch.setattr(sys, "stdout", stream)
    assert run_command("rdpi", lambda: print("8.1 µm, δ2 中 \u2603")) == 0
    assert raw.getvalue() == shown
    assert stream.errors == "strict"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_effects_are_listed_in_any_encoding(encoding):
    run = shell("rdpi effects creep", PYTHONIOENCODING=encoding)
    assert (run.returncode, run.stderr) == (0, b"")
    assert b"gain_per_decade" in run.stdout


def test_a_reader_that_goes_away_is_no_error():
    run = shell("rdpi effects | head -n 1; echo ${PIPESTATUS[0]}")
    assert run.stderr == b""
    many = "import sys; from rdpi_gym.support.command import run_command as r;"
    many += "sys.exit(r('sum', lambda: print('x' * 10 ** 6)))"
    run = shell(f'{sys.executable} -c "{many}" | head -c 9; echo ${{PIPESTATUS[0]}}')
    assert (run.stdout, run.stderr) == (b"xxxxxxxxx141\n", b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has a device that is always full")
def test_a_full_disk_is_one_line():
    run = shell("rdpi effects > /dev/full")
    assert run.returncode == 2
    assert run.stderr.startswith(b"rdpi: the disk is full; what was written before is kept")
    assert run.stderr.count(b"\n") == 1


@pytest.mark.parametrize(
    ("line", "status"), [("rdpi effects creep", 0), ("rdpi --help", 0), ("rdpi fit nothing.csv", 2)]
)
@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-", "2>/dev/full"])
def test_a_stream_that_is_closed_is_one_that_nobody_reads(line, status, closed):
    run = shell(f"{line} {closed}")
    assert run.returncode == status
    assert run.stderr.count(b"\n") == (status == 2 and "2>" not in closed)
    assert (b"creep" in run.stdout) == ("creep" in line and ">&-" not in closed.replace("2>&-", ""))


def test_what_the_system_refuses_is_one_line(capsys):
    def opens():
        Path("a" * 300).read_bytes()

    assert run_command("rdpi", opens) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "File name too long" in said
    assert len(said) < 400


def test_errors_of_our_own_are_not_hidden():
    with pytest.raises(ZeroDivisionError):
        run_command("rdpi", lambda: 1 // 0)


def test_progress_is_silent_without_a_terminal(capsys):
    with progress_bar() as show:
        show("fitting", 1, 3)
    assert capsys.readouterr() == ("", "")


def test_progress_on_a_terminal_shows_stage_and_numbers(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with progress_bar() as show:
        show("fitting [bold]", 1, 3)
        show("scoring", 5, 3)
    assert "fitting [bold]" in screen.getvalue() or "scoring" in screen.getvalue()
    assert "3/3" in screen.getvalue()


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    out = tmp_path_factory.mktemp("data")
    run = shell(f"rdpi simulate --model P5 --hide creep --ts-factor 2 --out {out}")
    assert run.returncode == 0, run.stderr
    return out / "data"


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals of a terminal")
@pytest.mark.parametrize(
    ("words", "delay_s"),
    [
        (words, delay_s)
        for words, delays_s in (
            (["fit", "DATA"], (0.05, 0.3)),  # done in a second
            (["bench", "--jobs", "2"], (0.05, 0.3, 1.0, 3.0)),
            (["discover", "DATA", "--jobs", "2"], (0.05, 0.3, 1.0, 3.0)),
            (["train", "ppo"], (0.05, 0.3, 1.0, 3.0)),
        )
        for delay_s in delays_s
    ],
    ids=str,
)
def test_an_interrupt_is_one_line_and_status_130(words, delay_s, data, tmp_path):
    if words[0] == "train":
        pytest.importorskip("stable_baselines3")
    words = [str(data) if word == "DATA" else word for word in words]
    process = started([*words, "--out", tmp_path / "out"])
    assert process.stdout.readline() == "up\n"
    time.sleep(delay_s)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal sends it, to its workers too
    try:
        _, errors = process.communicate(timeout=60)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert (process.returncode, errors) == (130, INTERRUPTED)


def test_an_interrupt_that_became_another_error_is_still_one(capsys):
    before = signal.getsignal(signal.SIGINT)

    def imports():
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise ImportError("an extension could not be loaded") from error

    assert run_command("rdpi", imports) == 130
    assert capsys.readouterr().err == INTERRUPTED
    assert signal.getsignal(signal.SIGINT) is before
