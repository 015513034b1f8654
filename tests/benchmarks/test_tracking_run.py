"""Runs of the tracking benchmark: rows, stores, fingerprints, controllers of one's own that fail."""

import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import baselines
import rdpi_gym as rg
from benchmarks.rows import TRACKING
from benchmarks.tracking import controllers, episode, run
from benchmarks.tracking.evaluation import COLUMNS, evaluate
from benchmarks.tracking.report import write_tables
from benchmarks.tracking.run import row_keys
from benchmarks.tracking.selection import select
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import P5, P10
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.store import RowStore
from tests.looping import over

MINE = """
import numpy as np
from baselines import make_controller

def static(belief, layout):
    return make_controller("classical-static", belief, layout)

class Counts:
    def __init__(self, belief, layout):
        pass
    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        k = 0 if state is None else state
        return self.answer(len(observation), k > 20), k + 1

class Raises(Counts):
    def answer(self, lanes, later):
        if later:
            raise RuntimeError("out of\\nideas; sorry")
        return np.zeros((lanes, 1))

class NaN(Counts):
    def answer(self, lanes, later):
        return np.full((lanes, 1), np.nan if later else 0.0, np.float32)

class WrongShape(Counts):
    def answer(self, lanes, later):
        return np.zeros((lanes, 2 if later else 1))

class Beyond(Counts):
    def answer(self, lanes, later):
        return np.full((lanes, 1), 3.0)
"""


@pytest.fixture
def mine(tmp_path, monkeypatch, request):
    # a name of its own for each test, so that no other test's module is found under it
    name = f"mine_{request.node.name.translate(str.maketrans('[]-:', '____'))}"
    (tmp_path / f"{name}.py").write_text(MINE)
    monkeypatch.syspath_prepend(tmp_path)
    return name


def small(controllers=("none", "classical-static"), seeds=(0, 1)):
    return select(controllers, ["P5"], ["sine", "steps"], [1e-3], seeds)


def scores(outcome):
    return [
        {name: value for name, value in row.items() if name != "microseconds_per_sample"}
        for row in outcome.rows
    ]


def test_every_row_that_was_asked_for_is_there_and_in_order(tmp_path):
    selection = small()
    outcome = run.benchmark(selection, tmp_path, jobs=1)
    # 4 sines and the steps, 2 seeds, the bound beside the two that were asked for
    assert [row["controller"] for row in outcome.rows] == [
        name for name in ("none", "classical-static", "full-preview-inversion") for _ in range(10)
    ]
    assert [row["seed"] for row in outcome.rows[:4]] == [0, 1, 0, 1]
    table = evaluate(selection, outcome).table
    assert tuple(table.columns) == COLUMNS
    assert set(table["controller"]) == {"none", "classical-static"}
    assert (table["belief"] == "P5").all()
    assert (table["status"] == "ok").all()


@pytest.mark.slow
def test_results_do_not_depend_on_the_number_of_workers(tmp_path):
    one, two = (run.benchmark(small(), tmp_path / str(jobs), jobs) for jobs in (1, 2))
    assert scores(one) == scores(two)


def stored(path):
    return RowStore(path, TRACKING.name, TRACKING.key).rows


def test_an_interrupted_run_continues_where_it_stopped(tmp_path, monkeypatch):
    whole = run.benchmark(small(), tmp_path / "whole", jobs=1)
    calls, original = [], run.run_task
    monkeypatch.setattr(run, "run_task", lambda task: calls.append(task) or original(task))

    def interrupt(stage, done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run.benchmark(small(), tmp_path / "cut", jobs=1, progress=interrupt)
    finished = len(calls)
    kept = stored(tmp_path / "cut" / TRACKING.file)
    assert 0 < len(kept) < len(whole.rows)

    outcome = run.benchmark(small(), tmp_path / "cut", jobs=1)
    assert scores(outcome) == scores(whole)
    assert outcome.computed == len(whole.rows) - len(kept)
    assert {k for task in calls[finished:] for k in row_keys(task)}.isdisjoint(kept)
    assert run.benchmark(small(), tmp_path / "cut", jobs=1).computed == 0


def test_a_torn_line_costs_its_row_and_rows_of_changed_code_are_set_aside(tmp_path, monkeypatch):
    whole = run.benchmark(small(), tmp_path, jobs=1)
    path = tmp_path / TRACKING.file
    path.write_bytes(path.read_bytes()[:-30])
    outcome = run.benchmark(small(), tmp_path, jobs=1)
    assert outcome.computed == 1
    assert "1 row was damaged in rows.jsonl" in outcome.notes[0]
    assert scores(outcome) == scores(whole)
    monkeypatch.setattr(run, "code_fingerprint", lambda controller: "another")
    second = run.benchmark(small(), tmp_path, jobs=1)
    assert second.computed == len(whole.rows)
    assert "set aside in rows-stale-1.jsonl" in second.notes[0]
    aside = stored(tmp_path / "rows-stale-1.jsonl")
    assert set(aside) == {TRACKING.key(row) for row in whole.rows}


def test_only_the_rows_of_a_changed_controller_are_set_aside(tmp_path, mine):
    selection = small(["none", f"{mine}:static"])
    run.benchmark(selection, tmp_path / "out", jobs=1)
    edit(tmp_path / f"{mine}.py")
    assert run.benchmark(selection, tmp_path / "out", jobs=1).computed == 10


def test_the_fingerprint_of_a_task_depends_on_the_plant():
    changed = P5.with_hysteresis(P5.hysteresis.static())
    first, again, other = (controllers.task_fingerprint("none", p) for p in (P5, P5, changed))
    assert first == again != other


def code_of(controller, folder):
    controllers.code_fingerprint.cache_clear()
    return controllers.code_fingerprint(controller, folder)


def edit(path):
    with path.open("a") as stream:
        stream.write("\nEDITED = 1\n")


def test_the_fingerprint_of_code_depends_on_the_files_that_a_controller_uses(tmp_path):
    folder = tmp_path / "baselines"
    shutil.copytree(Path(baselines.__file__).parent, folder)
    rows = "pi", "pi-classical-static", "pi-extended-inverse", "learned:ppo-correction"
    before = {name: code_of(name, folder) for name in rows}
    guarded = code_of("guarded:ppo-correction", folder)

    def changed():
        return [name for name in rows if code_of(name, folder) != before[name]]

    (folder / "another.py").write_text("class Another:\n    name = 'another'\n")
    assert changed() == []
    assert code_of("guarded:ppo-correction", folder) != guarded  # its name does not say which
    edit(folder / "repetitive.py")
    assert changed() == []
    edit(folder / "inverses" / "creep.py")
    assert "pi-extended-inverse" in changed()
    assert not {"pi", "pi-classical-static"} & set(changed())
    edit(folder / "classical.py")
    assert "pi-classical-static" in changed()
    assert "pi" not in changed()
    edit(folder / "pi.py")
    assert "pi" in changed()
    controllers.code_fingerprint.cache_clear()


def test_the_files_that_a_controller_uses_are_those_that_its_modules_load():
    """In a process of its own: what is loaded beyond the registry stands among the files."""
    script = """
import sys
from pathlib import Path
import baselines
from benchmarks.tracking import controllers
folder = Path(baselines.__file__).parent
before = set(sys.modules)
for name in ("model-predictive", "pi-preview", "h-infinity"):
    __import__("baselines." + name.replace("-", "_"))
loaded = {Path(sys.modules[m].__file__) for m in set(sys.modules) - before if m.startswith("baselines.")}
from rdpi_gym.support.fingerprint import used_files
used = used_files(["baselines.model_predictive", "baselines.linear_designs", "baselines.linear_designs"], folder)
missing = sorted(path.name for path in loaded - set(used) if path.name != "__init__.py")
assert not missing, missing
"""
    subprocess.run([sys.executable, "-c", script], check=True)


def test_without_a_folder_nothing_is_hashed(monkeypatch):
    def refuse(*_):
        raise AssertionError("a fingerprint")

    monkeypatch.setattr(run, "code_fingerprint", refuse)
    monkeypatch.setattr(run, "task_fingerprint", refuse)
    scores = rg.benchmark(["none"], ["P5"], ["sine"], [1e-3], seeds=1, jobs=1)
    assert scores.order == ["none"]


def test_a_controller_of_ones_own_scores_as_the_same_baseline(tmp_path, mine):
    names = ["classical-static", f"{mine}:static"]
    rows = run.benchmark(small(names), tmp_path, jobs=1).rows
    rmse = [[row["rmse_um"] for row in rows if row["controller"] == name] for name in names]
    assert rmse[0] == rmse[1]


@over(
    "name, reason",
    [
        ("Raises", "error: RuntimeError: out of ideas, sorry"),
        ("NaN", "error: the controller's action at sample 22 is not finite"),
        ("WrongShape", "error: ValueError: "),
    ],
)
def test_a_controller_that_fails_leaves_rows_that_say_so_and_the_others_go_on(
    tmp_path, mine, name, reason
):
    out = tmp_path / name  # where no row of "none" is stored yet
    selection = small([f"{mine}:{name}", "none"])
    outcome = run.benchmark(selection, out, jobs=1)
    assert outcome.computed == len(outcome.rows)
    failed = [row for row in outcome.rows if row["controller"] == f"{mine}:{name}"]
    assert all(row["status"].startswith(reason) for row in failed)
    results = evaluate(selection, outcome)
    assert results.order == ["none", f"{mine}:{name}"]
    text = write_tables(out, results).read_text()
    assert "error 10/10" in text
    table = pd.read_csv(out / "leaderboard.csv")
    assert tuple(table.columns) == COLUMNS
    numbers = table.drop(columns=["microseconds_per_sample", "status"])
    assert numbers.loc[table["controller"] == "none"].notna().all().all()
    assert table.loc[table["controller"] != "none", "rmse_um"].isna().all()


def test_rows_with_an_error_are_tried_again(tmp_path, mine):
    needs = tmp_path / "weights"
    with (tmp_path / f"{mine}.py").open("a") as stream:
        stream.write(
            "from pathlib import Path\n"
            "def trained(belief, layout):\n"
            f"    Path({str(needs)!r}).read_text()\n"
            "    return static(belief, layout)\n"
        )
    needs.write_text("here")
    selection = small([f"{mine}:trained"])
    needs.unlink()
    first = run.benchmark(selection, tmp_path / "out", jobs=1)
    assert first.rows[0]["status"].startswith("error: FileNotFoundError")
    needs.write_text("here")
    second = run.benchmark(selection, tmp_path / "out", jobs=1)
    assert second.computed == 10  # the bound's rows are kept
    assert {row["status"] for row in second.rows} == {"ok"}


def test_actions_beyond_the_range_are_clipped_and_said_to_be_saturated(tmp_path, mine):
    outcome = run.benchmark(small([f"{mine}:Beyond"]), tmp_path, jobs=1)
    rows = [row for row in outcome.rows if row["controller"] != "full-preview-inversion"]
    assert all(row["saturated_percent"] == 100.0 for row in rows)
    assert all("saturated: 100 %" in row["status"] for row in rows)
    assert all("diverged: " in row["status"] for row in rows)


def test_traces_are_kept_of_the_first_seed(tmp_path):
    outcome = run.benchmark(small(seeds=(0, 1)), tmp_path, jobs=1)
    assert {row["seed"] for row in outcome.rows if "trace" in row} == {0}
    trace = next(row["trace"] for row in outcome.rows if "trace" in row)
    error = np.subtract(trace["reference_um"], trace["displacement_um"])
    np.testing.assert_allclose(trace["error_um"], error, atol=1e-3)


def test_noise_free_static_inverse_is_exact_on_a_static_plant(tmp_path):
    selection = select(["classical-static"], ["P5-static"], ["sine", "triangle"], [1e-3], [0])
    outcome = run.benchmark(selection, tmp_path, jobs=1)
    # actions are float32, about 1e-6 V of the range
    assert all(row["max_um"] < 1e-5 for row in outcome.rows)


@over(
    "asked, said",
    [
        ({"controllers": ["clasical-static"]}, "did you mean 'classical-static'"),
        ({"plants": ["P10-statik"]}, "did you mean 'P10-static'"),
        ({"references": ["sinus"]}, "did you mean 'sine'"),
        ({"plants": ["missing.json"]}, "does not exist"),
        ({"ts_s": [0.0]}, "give a sampling time above 0 s"),
        ({"ts_s": [float("nan")]}, "give a sampling time above 0 s"),
        ({"ts_s": [0.5]}, "no reference among"),
        ({"controllers": []}, "nothing to score"),
        ({"controllers": ["no_such_module:thing"]}, "cannot be imported"),
        ({"plants": ["math:pi"]}, "'math:pi' is float"),
    ],
)
def test_bad_requests_are_refused_in_one_line(asked, said):
    with pytest.raises(InputError, match=said) as error:
        select(**{"plants": ["P5"], **asked})
    assert "\n" not in str(error.value)


def test_two_plants_of_one_name_and_a_file_in_place_of_the_folder_are_refused(tmp_path):
    path = P5.save(tmp_path / "mine.json")
    with pytest.raises(InputError, match="two different plants are named 'P5'"):
        select(plants=["P5", str(path)])
    (tmp_path / "out").write_text("mine")
    with pytest.raises(InputError, match="is a file"):
        run.benchmark(small(), tmp_path / "out", jobs=1)
    assert (tmp_path / "out").read_text() == "mine"


class Sluggish:
    """A controller whose decisions take the given times, the last again and again."""

    def __init__(self, *seconds):
        self.seconds, self.decisions = list(seconds), 0

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        end = time.process_time() + self.seconds[min(self.decisions, len(self.seconds) - 1)]
        while time.process_time() < end:
            pass
        self.decisions += 1
        return np.zeros((1, 1)), state


@over(
    "seconds, decisions",
    [
        ((0.3, 0.0), 305),  # the first compiles
        ((0.0,) * 6 + (0.3, 0.0), 305),  # or a later one
        ((0.05,), 8),
    ],
)
def test_only_a_controller_that_is_always_slow_is_given_up(seconds, decisions, monkeypatch):
    monkeypatch.setattr(episode, "_GIVEN_UP_S", 0.1)
    controller, layout = Sluggish(*seconds), ObservationLayout.for_plant(P10, ts_s=1e-4, preview=1)
    took = episode.microseconds_per_sample(controller, P10, layout, np.zeros(400))
    assert controller.decisions == decisions
    assert (took > 4e4) is (decisions == 8)


NEW_REFERENCE = """
from benchmarks.tracking.case import Case
from rdpi_gym.signals import Sawtooth

def _sawtooth(amplitude_um, base_hz):
    signal = Sawtooth(amplitude_um=amplitude_um, frequency_hz=base_hz)
    return (Case.smooth(signal, base_hz, start_s=1.0 / base_hz, periods=3),)

REFERENCES = {"sawtooth": _sawtooth}
"""
SCORE_IT = """
import sys
from benchmarks.tracking import references
references.__path__.append(sys.argv[1])
from benchmarks.tracking.run import benchmark
from benchmarks.tracking.selection import select
from pathlib import Path

selection = select(["none"], ["P5"], ["sawtooth"], [1e-3], [0])
rows = benchmark(selection, Path(sys.argv[1]) / "out", jobs=1).rows
print([(row["controller"], row["reference"], row["frequency_hz"], row["rmse_um"] > 0) for row in rows])
"""


@pytest.mark.slow
def test_a_new_reference_is_one_file(tmp_path):
    (tmp_path / "new.py").write_text(NEW_REFERENCE)
    words = [sys.executable, "-c", SCORE_IT, str(tmp_path)]
    found = subprocess.run(words, capture_output=True, text=True, check=True)
    expected = [(name, "sawtooth", 10.0, True) for name in ("none", "full-preview-inversion")]
    assert found.stdout.strip() == str(expected)
