"""The tasks as a benchmark: rows, failures, the order that they make."""

import time

import numpy as np
import pytest

from baselines import make_controller
from baselines.model_predictive import TrueHorizon
from benchmarks.stages.entries import BESIDE, INFORMATION, RIGHT_KIND, told
from benchmarks.stages.ranking import (
    TaskScores,
    interquartile_mean,
    rank_correlation,
    ranking,
)
from benchmarks.stages.row_table import checked_against, write_rows
from benchmarks.stages.run import (
    SLOWEST_US,
    WORST_PERCENT,
    TestSeed,
    field,
    read_seed,
    run_tasks,
)
from benchmarks.tracking.episode import microseconds_per_sample, play
from rdpi_gym.envs.tasks import TASKS
from rdpi_gym.plant import P10
from rdpi_gym.support.errors import InputError
from tests.looping import over


class Wrapped:
    """A controller that goes wrong in one way."""

    def __init__(self, belief, layout):
        self.inner = make_controller("classical-static", belief, layout)

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return self.inner.predict(observation, state, episode_start)


class AnswersNaN(Wrapped):
    def predict(self, *args, **options):
        action, state = super().predict(*args, **options)
        return np.full_like(action, np.nan), state


class Raises(Wrapped):
    def predict(self, *args, **options):
        raise ValueError("no\nidea")


class Rails(Wrapped):
    def predict(self, *args, **options):
        action, state = super().predict(*args, **options)
        return np.ones_like(action), state


class Slow(Wrapped):
    def predict(self, *args, **options):
        end = time.process_time() + 0.05
        while time.process_time() < end:
            pass
        return super().predict(*args, **options)


class Waits(Wrapped):
    """Computes nothing for longer than a decision may take, as where others have the machine."""

    def predict(self, *args, **options):
        time.sleep(1.5e-6 * SLOWEST_US)
        return super().predict(*args, **options)


class Certified(Wrapped):
    def certificate(self):
        return "small gain 0.5 below 1"


def test_time_is_that_of_the_processor():
    layout, r = TASKS["Bare"].layout(), np.zeros(40)
    controller = Waits(TASKS["Bare"].belief(), layout)
    assert 1.0 < microseconds_per_sample(controller, P10, layout, r) < SLOWEST_US


FACTORIES = {kind.__name__: kind for kind in (AnswersNaN, Raises, Rails, Slow, Certified)}


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    out = tmp_path_factory.mktemp("stages")
    return out, run_tasks(
        ["none", "classical-static"], ["Bare"], 3, out, factories=FACTORIES, bound=False
    )


def ranked(outcome):
    return ranking(outcome[1].rows).set_index("controller")


@pytest.mark.slow
def test_what_goes_wrong_is_a_failed_row_and_all_else_is_kept(outcome):
    table = ranked(outcome)
    assert len(outcome[1].rows) == 3 * 7
    said = table["failure"]
    assert "action at sample 1 is not finite" in said["AnswersNaN"]
    assert said["Raises"] == "error: ValueError: no idea"
    assert said["Slow"].startswith("too slow: 5")
    assert said["Rails"].startswith("diverged on 1 sine")
    assert table.loc[list(said.index[said != ""]), "failed"].tolist() == [1.0] * 4
    assert table.loc["AnswersNaN", "p90_percent"] == WORST_PERCENT


def test_failures_come_last_and_doubles_tie(outcome):
    table = ranked(outcome)
    assert table.index[0] in ("classical-static", "Certified")
    assert table["rank"][:3].tolist() == ["1=", "1=", "3"]
    assert table.loc["Certified", "certificate"] == "small gain 0.5 below 1"
    best, gain = table.loc["classical-static"], table.loc["none"]
    assert best["failed"] == gain["failed"] == 0.0
    assert best["p90_high"] < gain["p90_low"]
    task = TASKS["Bare"]
    per_noise = 2.0 * task.layout().scale_um / 100.0 / task.noise_um  # percent of a peak to peak
    assert best["iqm_noise"] == pytest.approx(best["iqm_percent"] * per_noise, rel=0.3)


def test_a_run_goes_on_where_it_was_and_gives_the_same_rows(outcome, tmp_path):
    out, first = outcome
    again = run_tasks(["none", "classical-static"], ["Bare"], 3, out, bound=False)
    assert again.computed == 0
    anew = run_tasks(["classical-static"], ["Bare"], 3, tmp_path, bound=False)
    timed = "microseconds_per_sample"
    before = [row for row in first.rows if row["controller"] == "classical-static"]
    assert [{**r, timed: 0} for r in before] == [{**r, timed: 0} for r in anew.rows]


def test_another_seed_has_other_plants_and_its_name_does_not_tell_it(tmp_path):
    (tmp_path / "seed").write_text("12345678901234567890\n")
    seed = read_seed(tmp_path / "seed")
    private = run_tasks(["none"], ["Bare"], 2, tmp_path, seed=seed, bound=False)
    public = run_tasks(["none"], ["Bare"], 2, tmp_path, bound=False)
    assert private.rows[0]["rmse_percent"] != public.rows[0]["rmse_percent"]
    assert "confined" in private.rows[0]  # it ran in a process of its own
    assert "confined" not in public.rows[0]
    with pytest.raises(InputError, match="Rails is a callable of this process"):
        run_tasks([], ["Bare"], 1, tmp_path, seed=seed, factories={"Rails": Rails})
    assert "1234567890" not in (tmp_path / "task-rows.jsonl").read_text()
    assert (seed.is_public, TestSeed().is_public) == (False, True)


def test_the_bound_is_within_the_noise_while_a_load_comes_and_has_no_rank():
    (lanes,) = TASKS["Load"].lanes("training", 1)
    samples = 25 + max(lanes.draws[0].later)
    layout, r = lanes.layout(), lanes.references_um[:samples]
    taken = play(TrueHorizon(lanes.plant(), layout), lanes.track(layout), r, lanes.noises)
    left = (taken.displacement_um - r)[1000:]
    assert np.sqrt(np.mean(left**2)) < 2.0 * TASKS["Load"].noise_um
    rows = rows_of({"true-plant-horizon": np.full(4, 0.1), "none": np.ones(4)})
    assert ranking(rows)["rank"].tolist() == ["bound", "1"]


def test_the_information_bound_finds_the_plant_from_its_readings():
    scores = {}
    for name in (INFORMATION, RIGHT_KIND):
        (lanes,) = TASKS["Duhem"].lanes("training", 1)
        controller = BESIDE[name].make(lanes)
        r = lanes.references_um[:1500]
        taken = play(controller, lanes.track(lanes.layout()), r, lanes.noises)
        scores[name] = np.sqrt(np.mean((taken.displacement_um - r)[1000:] ** 2))
    assert scores[INFORMATION] < 0.5 * scores[RIGHT_KIND]
    assert scores[INFORMATION] < 2.0 * TASKS["Duhem"].noise_um
    with pytest.raises(InputError, match="no information bound is known of Ageing"):
        BESIDE[INFORMATION].make(TASKS["Ageing"].lanes("training", 1)[0])


REFUSED = [
    ({"controllers": ["pii"]}, "no controller is named 'pii'; did you mean 'pi'"),
    ({"tasks": ["Stag"]}, "no task is named 'Stag'; did you mean 'Stage'"),
    ({"plants": 0}, "nothing to score"),
]


@over("asked, message", REFUSED)
def test_what_cannot_be_scored_is_refused_in_one_line(asked, message, tmp_path):
    words = {"controllers": ["none"], "tasks": ["Bare"], "plants": 1} | asked
    with pytest.raises(InputError, match=message) as caught:
        run_tasks(**words, out=tmp_path)
    assert "\n" not in str(caught.value)


def rows_of(errors):
    return [
        {"controller": name, "task": "Bare", "plant": plant, "rmse_percent": value,
         "rmse_noise": value, "failure": "", "sees": "preview"}
        for name, values in errors.items()
        for plant, value in enumerate(values)
    ]  # fmt: skip


def test_the_worst_tenth_counts_before_the_middle_half():
    assert interquartile_mean(np.array([100.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, -9.0])) == 3.5
    rng = np.random.default_rng(0)
    steady = 1.0 + 0.01 * rng.random(40)
    risky = np.where(np.arange(40) % 4 == 0, 5.0, 0.5) + 0.01 * rng.random(40)
    found = ranking(rows_of({"risky": risky, "steady": steady, "worst": 9.0 * steady}))
    assert found["controller"].tolist() == ["steady", "risky", "worst"]
    assert found["rank"].tolist() == ["1", "2", "3"]
    assert rank_correlation(rows_of({"a": steady, "b": 2 * steady, "c": risky + 9})) == 1.0


def test_failures_decide_a_rank_where_they_differ_for_sure():
    steady = 1.0 + 0.01 * np.random.default_rng(0).random(40)
    rows = rows_of({"first": steady, "second": 2.0 * steady, "third": 3.0 * steady})
    for failed, order in ((1, ["1", "2", "3"]), (20, ["3", "1", "2"])):
        own = {"failure": "diverged on 1 sine"}
        some = [r | own if r["controller"] == "first" and r["plant"] < failed else r for r in rows]
        found = ranking(some).set_index("controller")["rank"]
        assert found[["first", "second", "third"]].tolist() == order


def test_the_users_own_controller_is_in_the_tables_wherever_it_stands(tmp_path):
    others = [name for name in field() if name != "none"][:9]
    errors = {name: np.full(4, 1.0 + k) for k, name in enumerate([*others, "mine:make", "none"])}
    rows = [row | {"task": "Bare"} for row in rows_of(errors)]
    text = TaskScores(tuple(rows), "public seed 0").write(tmp_path).read_text()
    *shown, last = [line for line in text.splitlines() if line][-10:]
    assert [line.split(" | ")[1] for line in shown] == [*others[:8], "mine:make"]
    assert shown[-1].startswith("| 10 | mine:make |")
    assert last == "The first 8 of 11 rows of `tasks.csv`, and yours."


def test_the_headline_names_no_controller_that_fails_everywhere_and_marks_what_is_near_a_bound():
    errors = {
        "true-plant-horizon": np.full(4, 0.1),
        "peek": np.full(4, 0.104),
        "pi": np.full(4, 1.0),
    }
    scores = TaskScores(tuple(rows_of(errors)), "public seed 0")
    assert scores.answer.startswith("Bare: peek first, IQM 0.104 %")
    assert scores.answer.endswith("Within 5 % of the bound: peek.")
    assert scores.leaders("Bare")["controller"].tolist() == ["true-plant-horizon", "peek †", "pi"]
    failed = [row | {"failure": "error: no idea"} for row in rows_of({"peek": np.full(4, 0.1)})]
    assert TaskScores(tuple(failed), "public seed 0").answer == (
        "Bare: no controller among 1 follows any plant; the first reason: error: no idea"
    )


def test_ratios_to_the_information_bound_lead_where_it_was_scored():
    errors = {INFORMATION: np.full(4, 0.1), RIGHT_KIND: np.full(4, 0.2), "pi": np.full(4, 0.4)}
    scores = TaskScores(tuple(rows_of(errors)), "public seed 0")
    assert scores.answer.startswith("Bare: pi first, 4 times the information bound")
    table = scores.leaders("Bare")
    assert table["rank"].tolist() == ["information bound", "told the kind", "1"]
    assert table["over information"].tolist() == pytest.approx([1.0, 2.0, 4.0])


def test_a_controller_is_told_numbers_and_no_name():
    beliefs = [task.belief() for task in TASKS.values()]
    assert {told(belief).name for belief in beliefs} == {"stage"}
    for belief in beliefs:
        known = told(belief)
        assert (known.hysteresis, known.effects) == (belief.hysteresis, belief.effects)
        assert known.note == ""
        assert not known.identification


def test_rows_of_every_plant_are_kept_and_a_subset_is_checked_against_them(outcome, tmp_path):
    rows = outcome[1].rows
    path = write_rows(tmp_path, rows)
    assert path.read_bytes() == write_rows(tmp_path, rows).read_bytes()
    some = [row for row in rows if row["plant"] == 1]
    assert checked_against(some, path) == "7 of 7 rows are as task-rows.csv.gz states them."
    changed = [some[0] | {"rmse_percent": 1.001 * some[0]["rmse_percent"]}, *some[1:]]
    assert checked_against(changed, path).startswith("6 of 7 rows")
    for wrong, said in (
        ([some[0] | {"plant": 9}], "none of these rows"),
        (some, "is no task-rows"),
    ):
        with pytest.raises(InputError, match=said):
            checked_against(wrong, path)
        path.write_bytes(path.read_bytes()[:40] + b"?" * 40)


def test_the_field_holds_rivals_only():
    names = field()
    assert {"none", "pi", "pi-extended-inverse"} <= set(names)
    assert not {"preview-inversion", "core-inverse", "true-plant-horizon"} & set(names)
