"""Sweeps on two Ray nodes, which the test starts: same rows, and none lost with a node."""

import shutil
import socket
import tempfile
import time
from functools import partial

import pytest

from benchmarks.effect_discovery.cases import Case, run_case, study_fingerprint
from benchmarks.effect_discovery.independent import INDEPENDENT
from benchmarks.rows import ROWS_FILE, TASKS, TRACKING, run_rows
from rdpi_gym.cli import main
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.parallel import run_cases
from rdpi_gym.support.store import named_rows

pytestmark = pytest.mark.slow
ray = pytest.importorskip("ray", reason="Ray is not installed: pip install 'rdpi-gym[ray]'")

# Loopback; Ray would replace 127.0.0.1 by an address that others can reach.
HOST = "127.0.0.2"
NODE = {"num_cpus": 1, "node_ip_address": HOST, "object_store_memory": 80 * 2**20}


@pytest.fixture(scope="module")
def cluster():
    from ray.cluster_utils import Cluster

    try:
        socket.create_server((HOST, 0)).close()
    except OSError:
        pytest.skip(f"this system has no loopback address {HOST}")
    # A default folder of its own, so that no other program takes this cluster for its own, and
    # nothing is asked of a folder that another Ray made; a short name, since paths of sockets are
    # limited.
    folder = tempfile.mkdtemp(prefix="ray")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        patch.setenv("RAY_TMPDIR", folder)
        started = Cluster(initialize_head=True, head_node_args={**NODE, "include_dashboard": False})
        yield started
        started.shutdown()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def second(cluster):
    node = cluster.add_node(**NODE)
    yield node
    if node in cluster.worker_nodes:
        cluster.remove_node(node)


BENCHES = {
    "references": (
        TRACKING.open,
        [
            "--controllers",
            "classical-static",
            "--plants",
            "P5",
            "--references",
            "steps",
            "--ts",
            "1e-3",
            "--seeds",
            "2",
        ],
        4,
    ),
    "tasks": (
        TASKS.open,
        ["--controllers", "classical-static", "--task", "Bare", "--draws", "2"],
        4,
    ),
}


@pytest.mark.parametrize(("read", "words", "count"), BENCHES.values(), ids=BENCHES)
def test_a_benchmark_gives_the_rows_of_one_machine(cluster, second, tmp_path, read, words, count):
    rows = {}
    for name, more in (("here", []), ("there", ["--ray", cluster.address])):
        assert main(["bench", *words, "--jobs", "1", *more, "--out", str(tmp_path / name)]) == 0
        rows[name] = read(tmp_path / name).rows
        for row in rows[name].values():
            assert row.pop("microseconds_per_sample") >= 0.0
    assert rows["here"] == rows["there"]
    assert [row.get("status", "ok") for row in rows["there"].values()] == ["ok"] * count


def test_the_study_gives_the_rows_of_one_machine_and_continues(cluster, second, tmp_path):
    def engine(dataset, seed):
        raise ValueError(f"{len(dataset.records)} records, seed {seed}")

    def interrupt(stage, done, total):
        if done == 1:
            raise KeyboardInterrupt

    cases = [Case("none", (), number, variant="plain") for number in range(2)]

    def study(name, progress=None, address=None):
        run = partial(run_case, source=INDEPENDENT, engine=engine)
        out = tmp_path / name
        return run_rows(cases, out, run, study_fingerprint(), 1, progress, ray_address=address)

    here = study("here")
    assert here[0]["error"] == "ValueError: 16 records, seed 0"
    address, counts = cluster.address, []
    with pytest.raises(KeyboardInterrupt):
        study("there", interrupt, address)
    study("there", lambda stage, *n: counts.append(n), address)
    assert counts == [(1, 2), (2, 2)]
    written = [named_rows(tmp_path / name / ROWS_FILE).rows for name in ("here", "there")]
    assert len(written[0]) == 2
    assert written[0] == written[1]


def test_what_a_case_raises_on_a_node_is_raised_here(cluster):
    def fails(number):
        raise InputError(f"case {number} is no case")

    with pytest.raises(InputError, match=r"^case 0 is no case$"):
        list(run_cases(fails, [0], ray_address=cluster.address))
    assert not ray.is_initialized()


def test_a_worker_imports_nothing_of_the_current_folder(cluster, tmp_path, monkeypatch):
    folder, canary = tmp_path / "from-somebody", tmp_path / "canary"
    folder.mkdir()
    for name in (
        "joblib",
        "numba",
        "numpy",
        "pandas",
        "rdpi_gym",
        "scipy",
        "secrets",
        "statistics",
    ):
        (folder / f"{name}.py").write_text(f"open({str(canary)!r}, 'w')")
    monkeypatch.chdir(folder)

    def case(number):
        import secrets
        import statistics

        import numpy

        return [each.__name__ for each in (secrets, statistics, numpy)]

    assert list(run_cases(case, [0], ray_address=cluster.address)) == [
        ["secrets", "statistics", "numpy"]
    ]
    assert not canary.exists()


def test_a_node_that_dies_costs_no_finished_row(cluster, second, tmp_path):
    doomed, starts = second.node_id, tmp_path / "starts"
    starts.mkdir()

    def case(number):
        node = ray.get_runtime_context().get_node_id()
        (starts / f"{number}-{node}-{time.monotonic_ns()}").touch()
        # the doomed node finishes its first case and dies in its second; the other one waits for that
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            begun = len(list(starts.glob(f"*-{doomed}-*")))
            if begun == 1 if node == doomed else begun == 2:
                break
            time.sleep(0.02)
        return {"key": str(number), "node": node}

    store = named_rows(tmp_path / "rows.jsonl")
    for row in run_cases(case, range(8), ray_address=cluster.address):
        store.append([row])
        if len(store.rows) == 3:
            cluster.remove_node(second, allow_graceful=False)
    rows = named_rows(tmp_path / "rows.jsonl").rows
    assert sorted(rows) == [str(number) for number in range(8)]
    assert [row["node"] for row in rows.values()].count(doomed) == 1
    # only the case that died with its node was begun twice
    begun = [path.name.split("-")[:2] for path in starts.iterdir()]
    twice = {number for number, node in begun if node == doomed and rows[number]["node"] != node}
    assert len(twice) == 1
    assert len(begun) == 9
