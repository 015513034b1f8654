"""Learning curves of the study of agents, and which policies it ships."""

import io
import json
from dataclasses import replace

import pandas as pd
import pytest
from PIL import Image

pytest.importorskip("torch")

from baselines.learned import policy as policies
from baselines.learned.policy import Network, Policy, policy_folder
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import named_plant
from rdpi_gym.support.errors import InputError
from studies.agents import shipping
from studies.agents import tables as curves
from studies.agents.__main__ import OUT, POLICIES, main
from studies.agents.tables import learning_picture
from studies.agents.training import QUICK, Agent, Training, all_trainings

STEPS = (0, 100, 200)
SEEDS = replace(QUICK, agents=(Agent("ppo", "increment"),), seeds=(0, 1, 2, 3, 4))


def trained(training, factor=1.0, steps=STEPS):
    """Leave what a training leaves: a policy of its own, and a curve."""
    layout = ObservationLayout.for_plant(named_plant("P10"), 1e-4, action="increment")
    actor = Network((layout.size, 1), "Tanh", "Hardtanh").build()
    story = {"seed": training.seed, "timesteps": steps[-1]}
    Policy(layout, 0, 100.0, 0.02, actor, training=story).save(training.policy)
    rows = [
        {
            "timesteps": step, "seconds": 1.0 + step * factor, "training_reward": None,
            "reward": -factor / (1 + step), "rmse_um": 40.0 * factor / (1 + step), "rmse_percent": 50.0,
            "command_variation_V_s": 3000.0 * factor, "compensator_rmse_um": 1.0,
            "compensator_rmse_percent": 1.25, "compensator_command_variation_V_s": 6000.0,
        }
        for step in steps
    ]  # fmt: skip
    pd.DataFrame(rows).to_csv(training.folder / "training.csv", index=False)
    return training


def scores(by_seed, agent="ppo-increment", plants=4):
    return pd.DataFrame(
        [
            {"contestant": agent, "kind": "agent", "training_seed": seed, "plant_seed": plant, "rmse_percent": error}
            for seed, error in enumerate(by_seed)
            for plant in range(plants)
        ]
        + [{"contestant": "pi", "kind": "feedback", "training_seed": None, "plant_seed": 0, "rmse_percent": 1.0}]
    )  # fmt: skip


def test_the_stage_writes_curves_costs_and_a_picture(tmp_path, capsys):
    runs, out = tmp_path / "runs", tmp_path / "out"
    one = trained(all_trainings(QUICK, runs)[0])
    asked = ["--quick", "--stage", "curves", "--runs", str(runs), "--out", str(out)]
    assert main(asked) == 0
    assert "curves.md" in capsys.readouterr().out
    table = pd.read_csv(out / "curves.csv")
    assert tuple(table.columns) == curves.CURVE_COLUMNS
    source = pd.read_csv(one.folder / "training.csv")
    own = table[table["agent"] == one.agent.name]
    assert own["rmse_um"].tolist() == pytest.approx(source["rmse_um"].tolist(), rel=1e-5)
    # The other is not finished yet.
    assert set(table["agent"]) == {one.agent.name}
    assert "| ppo-correction | 1 | 200 | 201 | 1 |" in (out / "curves.md").read_text()
    width, height = Image.open(io.BytesIO((out / curves.PICTURE).read_bytes())).size
    assert width > height / 2 > 200
    assert (out / curves.PICTURE).stat().st_size < 100_000


def test_curves_that_are_missing_or_damaged_are_named(tmp_path):
    one = trained(Training(SEEDS, SEEDS.agents[0], 0, tmp_path))
    curve = one.folder / "training.csv"
    for text in ("", "timesteps,seconds\n0,1\n"):
        curve.write_text(text)
        with pytest.raises(InputError, match=r"training\.csv is no learning curve"):
            curves.learning_curves([one])
    curve.unlink()
    with pytest.raises(InputError, match="no training has a curve"):
        curves.learning_curves([one])


def test_a_band_reaches_over_all_trainings_its_line_and_the_costs_are_medians(tmp_path):
    made = [
        trained(Training(SEEDS, SEEDS.agents[0], seed, tmp_path), factor)
        for seed, factor in enumerate((1.0, 4.0, 2.0))
    ]
    (cost,) = curves.training_costs(curves.learning_curves(made)).to_dict("records")
    assert (cost["trainings"], cost["timesteps"], cost["seconds"]) == (3, 200, 401.0)
    assert cost["steps_per_s"] == pytest.approx(200.0 / 401.0)
    # One was stopped early: where it was not evaluated there is no band of three.
    trained(made[0], 1.0, STEPS[:2])
    bands = curves.learning_bands(curves.learning_curves(made))
    assert bands["timesteps"].tolist() == list(STEPS[:2])
    ratio = bands[["variation_ratio_low", "variation_ratio", "variation_ratio_high"]]
    assert ratio.to_numpy().tolist() == [[0.5, 1.0, 2.0]] * 2
    assert bands["rmse_um"].tolist() == pytest.approx([80.0, 80.0 / 101.0])
    drawn = learning_picture(bands, "pi", 1.0)
    assert drawn == learning_picture(bands, "pi", 1.0)
    assert drawn != learning_picture(bands, "pi", 2.0)


def test_the_text_says_how_many_plants_are_evaluated():
    pytest.importorskip("stable_baselines3")
    from baselines.learned import environments, options

    assert f"{environments.LANES} held-out plants" in curves.CURVE_METHOD
    assert set(curves.CURVE_COLUMNS) - {"agent", "seed"} == set(options.COLUMNS) - {
        "training_reward"
    }


def test_the_median_is_shipped_and_not_the_best():
    for by_seed, seed in (
        ([5.0, 1.0, 3.0, 2.0, 4.0], 2),
        ([4.0, 1.0, 2.0, 3.0], 3),  # the worse of the two in the middle
        ([1.0, float("nan"), float("nan")], 1),  # a training that fails counts as infinite
        ([7.0], 0),
    ):
        (chosen,) = shipping.median_trainings(scores(by_seed)).to_dict("records")
        assert chosen["seed"] == seed, by_seed
        assert (chosen["trainings"], chosen["best_percent"]) == (len(by_seed), min(by_seed))


def test_of_agents_with_the_same_actions_the_one_that_leaves_least_ships():
    names, errors = ("ppo-correction", "sac-correction", "sac-increment"), (1.0, 2.0, 9.0)
    each = [scores([error], name) for name, error in zip(names, errors, strict=True)]
    table = pd.concat(each, ignore_index=True)
    chosen = shipping.median_trainings(table).set_index("agent")
    assert chosen["ships"].to_dict() == dict(zip(names, (True, False, True), strict=True))


def test_shipped_policies_are_the_trained_ones_and_twice_is_once(tmp_path, monkeypatch):
    runs, target = tmp_path / "runs", tmp_path / "policies"
    made = [trained(each) for each in all_trainings(SEEDS, runs)]
    kept = trained(Training(QUICK, Agent("sac", "increment"), 9, tmp_path)).policy
    target.mkdir()
    kept.rename(target / "mine")
    table = scores([5.0, 1.0, 3.0, 2.0, 4.0])
    found = shipping.ship(table, made, target)
    assert found["seed"].tolist() == [2]
    first = {path: path.read_bytes() for path in target.rglob("*") if path.is_file()}
    assert found["policy_bytes"].tolist() == [
        sum(len(content) for path, content in first.items() if path.parent.name == "ppo-increment")
    ]
    assert {path.parent.name for path in first} == {"mine", "ppo-increment"}
    pd.testing.assert_frame_equal(shipping.ship(table, made, target), found)
    assert {path: path.read_bytes() for path in target.rglob("*") if path.is_file()} == first
    monkeypatch.setattr(policies, "SHIPPED", target)
    assert Policy.load(policy_folder("ppo-increment")).training == {"seed": 2, "timesteps": 200}


def test_the_stage_ships_and_a_quick_one_not_among_the_published(tmp_path, capsys):
    runs, out = tmp_path / "runs", tmp_path / "out"
    for each in all_trainings(QUICK, runs):
        trained(each)
    asked = ["--quick", "--stage", "ship", "--runs", str(runs), "--out", str(out)]
    assert main(asked) == 2
    assert "scores.csv is missing; run --stage score" in capsys.readouterr().err
    out.mkdir()
    names = [agent.name for agent in QUICK.agents]
    pd.concat([scores([2.0], name) for name in names]).to_csv(out / "scores.csv", index=False)
    assert main(asked) == 0
    assert "seed 0, the median of 1 trainings" in capsys.readouterr().out
    assert sorted(path.name for path in (runs / "policies").iterdir()) == sorted(names)
    table = pd.read_csv(out / "shipped.csv")
    assert table["agent"].tolist() == names
    assert (table["rmse_percent"] == 2.0).all()


def test_what_cannot_be_shipped_is_refused_and_nothing_is_copied(tmp_path, monkeypatch):
    made = [trained(each) for each in all_trainings(SEEDS, tmp_path / "runs")]
    target = tmp_path / "policies"
    table = scores([5.0, 1.0, 3.0, 2.0, 4.0])
    with pytest.raises(InputError, match="ppo-increment with seed 4 is either not trained or"):
        shipping.ship(table, made[:-1], target)
    with pytest.raises(InputError, match="run --stage score again"):
        shipping.ship(scores([5.0, 1.0, 3.0, 2.0]), made, target)
    (target / "ppo-increment").mkdir(parents=True)
    with pytest.raises(InputError, match="holds no policy"):
        shipping.ship(table, made, target)
    (target / "ppo-increment").rmdir()
    with monkeypatch.context() as patched:
        patched.setattr(shipping, "LIMIT_BYTES", 100)
        with pytest.raises(InputError, match="more than 100"):
            shipping.ship(table, made, target)
    weights = made[2].policy / "weights.pt"
    weights.write_bytes(weights.read_bytes()[:50])
    with pytest.raises(InputError, match="cut off"):
        shipping.ship(table, made, target)
    assert not list(target.iterdir())


def test_committed_policies_are_those_of_the_table():
    table = OUT / "shipped.csv"
    # students are none of the study's agents
    folders = {
        path.parent.name: path
        for path in POLICIES.glob("*/policy.json")
        if json.loads(path.read_text())["format"] == policies.FORMAT
    }
    rows = pd.read_csv(table).set_index("agent")
    earned = rows[rows["ships"]]
    assert set(folders) == set(earned.index), "run python -m studies.agents --stage ship"
    assert (rows.loc[~rows["ships"], "policy_bytes"] == 0).all()
    for name in folders:
        assert Policy.load(policy_folder(name)).training["seed"] == rows.loc[name, "seed"]
    total = sum(file.stat().st_size for path in folders.values() for file in path.parent.iterdir())
    assert total == rows["policy_bytes"].sum() < shipping.LIMIT_BYTES
    chosen = shipping.median_trainings(pd.read_csv(OUT / "scores.csv"))
    assert dict(zip(chosen["agent"], chosen["seed"], strict=True)) == rows["seed"].to_dict()
