"""The study of speed: committed tables keep what the pages promise, every case of a part is measured."""

from pathlib import Path

import pandas as pd
import pytest

pytest.importorskip("torch")

from rdpi_gym.envs.tasks import TASKS
from studies import speed
from studies.runner import RESULTS
from tests.looping import over

PAGE = Path(__file__).parents[2] / "docs" / "vector-environment.md"
STAGGERED = "as in a training, episodes end at different times"


def committed(part):
    return pd.read_csv(RESULTS / f"{part}_speed.csv")


def test_the_vector_environment_is_as_fast_as_its_page_says():
    table = committed("vector").set_index(["case", "threads"])
    assert table.index.tolist() == [(case, n) for case in speed.CASES for n in (1, 2)]
    plain, effects = table.loc[("defaults", 2)], table.loc[("five effects", 2)]
    assert plain["times_cartpole"] >= 4.0
    assert plain["share_of_bare"] >= 0.4
    assert effects["share_of_defaults"] >= 0.3
    one, two, apart, apart_two = (
        table.loc[(case, n), "times_cartpole"]
        for case in (speed.AS_TRAINED, STAGGERED)
        for n in (1, 2)
    )
    assert one >= 1.0
    assert two >= 2.0
    page = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert f"makes {one:.2f} times the steps of CartPole, two make {two:.2f} times" in page
    assert f"begins at every step these are {apart:.2f} and {apart_two:.2f} times" in page


def test_the_tasks_are_as_fast_as_their_page_says():
    table = committed("tasks")
    assert set(table["case"]) == {task.id for task in TASKS.values()}
    page = " ".join(PAGE.read_text(encoding="utf-8").split())
    one, two = (table[table["threads"] == n].set_index("case")["times_cartpole"] for n in (1, 2))
    alone = f"{(one >= 1.0).sum()} of {len(one)} tasks make at least its steps on one thread"
    assert f"{alone}, `{one.idxmin()}` {one.min():.2f} times" in page
    both = f"{(two >= 1.0).sum()} of {len(two)} on two, and `{two.idxmin()}` {two.min():.2f} times"
    assert both in page


@over("case", speed.CASES)
def test_every_case_of_the_vector_environment_is_measured(case):
    table = speed.vector(rounds=2, duration_s=0.001, lanes=3, threads=[1], cases=[case])
    assert table["case"].tolist() == [case]
    assert (table.drop(columns="case") > 0).all(axis=None)
    assert (table["lowest"] <= table["times_cartpole"]).all()
    assert (table["times_cartpole"] <= table["highest"]).all()


def test_a_task_is_measured_in_steps_and_in_whole_episodes():
    (row,) = speed.tasks(1, duration_s=0.001, lanes=3, threads=[1], names=["Bare"]).to_dict(
        "records"
    )
    assert row["case"] == TASKS["Bare"].id
    assert 0.0 < row["episodes_times_cartpole"] < row["times_cartpole"]
    assert row["reset_ms"] > 0.0


def test_no_core_is_below_a_third_of_the_rdpi_models_speed_at_usual_sampling():
    table = committed("core")
    assert set(table["core"]) == set(speed.core_cases())
    usual = table[table["samples_a_period"] >= 200]
    assert usual["block_ratio"].min() >= 1.0 / 3.0, usual.to_string()
    fresh = speed.core(1, lanes=(16,), periods=(200,), samples=5)
    assert fresh["core"].tolist() == list(speed.core_cases())
    assert (fresh[["block_ns", "block_ratio", "steps_ratio"]] > 0).all(axis=None)
    assert list(fresh) == list(table)


def test_the_native_ppo_is_faster_than_the_reference(monkeypatch):
    pytest.importorskip("stable_baselines3")
    table = committed("training")
    assert list(zip(table["learner"], table["threads"], strict=True)) == list(speed.TRAININGS)
    reference, one = (table.iloc[i]["steps_per_process_s"] for i in (0, 1))
    assert one > 3.0 * reference
    monkeypatch.setattr(speed, "TRAININGS", (("native-ppo", 2),))
    (row,) = speed.training(rounds=1, rollouts=1).to_dict("records")
    assert (row["learner"], row["threads"], row["steps"]) == ("native-ppo", 2, 512 * 64)
    assert row["steps_per_process_s"] > 0.0


def test_the_command_writes_the_parts_that_are_named(tmp_path, capsys):
    assert speed.main(["vector", "fast", "--out", str(tmp_path)]) == 2
    assert "no part is named 'fast'; known are vector, tasks, core, " in capsys.readouterr().err
    for part, answer in (
        ("vector", "With the defaults one thread makes 3.05 times the steps"),
        ("core", "The slowest is asymmetric_bouc_wen, exponent 1.5 at 64 lanes"),
        ("training", "9.1 times as many. On two threads"),
    ):
        with pytest.MonkeyPatch.context() as patch:
            stored = speed.dataclasses.replace(
                speed.PARTS[part], measure=lambda rounds, part=part: committed(part)
            )
            patch.setattr(speed, "PARTS", {part: stored})
            assert speed.main([part, "--rounds", "1", "--out", str(tmp_path)]) == 0
        assert answer in (tmp_path / f"{part}_speed.md").read_text()
        written, kept = (folder / f"{part}_speed.csv" for folder in (tmp_path, RESULTS))
        pd.testing.assert_frame_equal(pd.read_csv(written), pd.read_csv(kept))
