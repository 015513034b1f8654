"""Teaching on true plants: what the teacher says holds, a student learns it, interruptions leave no trace."""

import json
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("torch")

import torch

from baselines import make_controller
from baselines.core_bank import AdaptiveCoreBank
from baselines.learned.controller import find_learned
from baselines.learned.imitation import fitting, rounds
from baselines.learned.imitation.fitting import Learner, Loop
from baselines.learned.imitation.plays import SearchedCore, TruePlays
from baselines.learned.imitation.policy import (
    ERRORS,
    SCALE_SPREAD,
    UNIT_UM,
    WEIGHTED,
    Student,
    StudentPolicy,
    fresh_arrays,
    is_like,
)
from baselines.learned.imitation.rounds import Options, drive_draws, train
from baselines.learned.imitation.teacher import (
    Chords,
    Plays,
    Rollout,
    Systems,
    roll_out,
    student_lanes,
)
from benchmarks.stages.run import Unit, run_unit
from rdpi_gym.cli import main
from rdpi_gym.envs.tasks import TASKS as ALL
from rdpi_gym.envs.tasks.stages import (
    BARE,
    RESONANCE_TASK,
    STAGE,
    structure_belief,
    structure_truth,
)
from rdpi_gym.support.errors import InputError

TASK = replace(STAGE, samples=101, first=51, references=("sine",))
"""One sine and 10 ms."""


@pytest.fixture(autouse=True)
def _small_task(monkeypatch):
    monkeypatch.setattr("rdpi_gym.envs.tasks.TASKS", MappingProxyType({"Stage": TASK}))
    monkeypatch.setattr(fitting, "WARM_UP", 0)
    monkeypatch.setattr(fitting, "STRETCH", 25)
    monkeypatch.setattr(rounds, "SETTLED", 20)


@pytest.fixture(scope="module")
def met():
    policy = StudentPolicy.untrained(TASK.belief(), TASK.layout(), hidden=4)
    return policy, again(policy)


def again(policy, numbers=range(2)):
    (lanes,) = student_lanes(TASK, "training", numbers, 0)
    return roll_out(lanes, policy)


def network(policy, met):
    middle = np.zeros(policy.student.inputs, dtype=np.float32)
    spread = (met.seen.std(axis=(0, 2)) + 1e-6).astype(np.float32)
    return fresh_arrays(0, middle, spread, hidden=4, weighted=WEIGHTED)


def drives(policy, met, size, seed=0):
    """A network that drives at random, by `size`."""
    arrays = network(policy, met)
    rng = np.random.default_rng(seed)
    arrays["head"] = (size * rng.standard_normal(arrays["head"].shape)).astype(np.float32)
    return Learner(arrays, WEIGHTED)


@pytest.mark.parametrize(
    ("plant", "doubt", "most"),
    [
        ("with a mode", 0.1, 0.08),
        ("with a mode", 0.005, 0.5),
        ("of the task", 0.1, 0.3),  # its sensor's steps, of a fifth of a unit, fall otherwise
        ("of the task", 0.005, 0.4),
        ("bouc_wen", 0.1, 0.25),
        ("bouc_wen, by the bank", 0.1, 0.2),
        ("preisach, by the bank", 0.1, 0.2),
        ("duhem, by the bank", 0.1, 0.2),
        ("of the task, by the bank", 0.1, 0.4),
        ("alone, by the bank", 0.1, 0.4),
    ],
)
def test_the_teacher_says_what_the_true_plants_make_of_another_student(plant, doubt, most):
    """Rough corrections move the thresholds, and an estimate that learns answers them."""
    kind = plant.removesuffix(", by the bank")
    known = {
        "with a mode": RESONANCE_TASK.nominal(),
        "of the task": STAGE.nominal(),
        "alone": BARE.nominal(),
    }
    nominal = known[kind] if kind in known else structure_truth(kind)
    belief = nominal if kind in known else structure_belief(kind)
    baseline = "adaptive-core-bank" if "bank" in plant else "adaptive-dual-loop"
    task = replace(TASK, nominals=(nominal,), beliefs=(belief,), samples=1501, first=1001)

    def lanes():
        (found,) = student_lanes(task, "training", range(3), 0)
        return found

    policy = StudentPolicy.untrained(belief, task.layout(), 4, baseline)
    policy = replace(policy, feedforward=dict(policy.feedforward) | {"doubt": doubt})
    before = roll_out(lanes(), policy)
    learner = drives(policy, before, 0.05)
    after = roll_out(lanes(), replace(policy, student=learner.student))
    with torch.no_grad():
        said = Loop(learner.tensors, WEIGHTED, before).run(0, 1500).numpy() - before.left
    said, found = said[700:], (after.left - before.left)[700:]
    missed = np.sqrt(np.mean((said - found) ** 2) / np.mean(found**2))
    assert np.sqrt(np.mean(found**2)) > 0.1
    assert missed < most


def test_kernels_have_the_gradients_of_what_they_compute():
    """Gradients of piecewise linear sums: their differences are exact but where a play turns."""
    rng = np.random.default_rng(0)
    chords = Chords.of(AdaptiveCoreBank(STAGE.belief(), TASK.layout()).feedforward.bank, 1e-4)
    chords = replace(chords, slopes=(chords.slopes[1],) * 3)  # slopes count as given
    core = STAGE.nominal().hysteresis
    memory = np.zeros((core.n, 3))
    walk = torch.tensor(np.cumsum(rng.normal(0.0, 2.0, (40, 3)), axis=0), dtype=torch.float32)
    besides = torch.tensor(rng.normal(size=(40, 3)), dtype=torch.float32)

    def driven(wanted):
        searched = SearchedCore(chords, 3, 0.0)
        commands = [searched.drive(each, torch.zeros(3)) for each in wanted]
        return (torch.stack(commands) * besides).sum()

    def moved(commands):
        plays = TruePlays(Plays.of([core] * 3, 1e-4, memory), 0.0)
        return (torch.stack([plays.step(each) for each in commands]) * besides).sum()

    for of in (moved, driven):
        at = walk.clone().requires_grad_()
        of(at).backward()
        way = torch.tensor(rng.normal(size=(40, 3)), dtype=torch.float32)
        step = 2e-3
        with torch.no_grad():
            found = float(of(walk + step * way) - of(walk - step * way)) / (2.0 * step)
        assert float((at.grad * way).sum()) == pytest.approx(found, rel=0.02)


def test_rollouts_of_several_processes_are_as_those_of_one():
    policy = StudentPolicy.untrained(TASK.belief(), TASK.layout(), 4, "adaptive-core-bank")
    whole = again(policy).loop_model
    joined = Rollout.joined([again(policy, [0]), again(policy, [1])]).loop_model
    np.testing.assert_allclose(joined.given_um, whole.given_um, atol=1e-4)
    np.testing.assert_allclose(joined.plays.weights, whole.plays.weights)
    for name in ("before", "behind", "feedback"):
        np.testing.assert_allclose(getattr(joined, name).a, getattr(whole, name).a)


def test_plants_of_several_kinds_surround_a_student_by_what_is_linear_of_them():
    """The kind that is believed, too: its lanes stand beside the others' in one fit."""
    task = replace(ALL["Measured"], samples=101, first=51, references=("sine",))
    policy = StudentPolicy.untrained(task.belief(), task.layout(), 4, "adaptive-core-bank")
    groups = student_lanes(task, "training", range(12), 0)
    assert [lanes.numbers for lanes in groups] == [[k, k + 6] for k in range(6)]
    met = Rollout.joined([roll_out(lanes, policy) for lanes in groups])
    assert isinstance(met.loop_model, Systems)
    assert len(met.loop_model.d) == met.left.shape[1] == 12


def test_the_fit_runs_the_student_that_drove_and_lessens_its_error(met):
    policy, untrained = met
    arrays = network(policy, untrained)
    arrays["head_bias"][WEIGHTED + 1 : WEIGHTED + 1 + ERRORS] = 0.05
    learner = Learner(arrays, WEIGHTED)
    drove = again(replace(policy, student=learner.student))
    as_it_drove = Loop(learner.tensors, WEIGHTED, drove).run(0, 100).detach().numpy()
    np.testing.assert_allclose(as_it_drove, drove.left, atol=2e-4)
    weights = UNIT_UM / drove.score.rmse_um
    for _ in range(8):
        left = learner.fit(drove, weights, rate=3e-3)
    assert left < 0.9
    really = again(replace(policy, student=learner.student)).score.rmse_um
    assert np.mean(really * weights / UNIT_UM) < 0.95


def options(folder, **fields):
    given = {"lanes": 1, "timesteps": 400, "every": 200, "hidden": 4, "held_out": 1}
    return Options(out=folder, **(given | fields))


def test_a_training_that_was_interrupted_ends_as_one_that_was_not(tmp_path, monkeypatch):
    policy = train(options(tmp_path / "whole"))
    calls = []

    def interrupted(lanes, student):
        calls.append(None)
        if len(calls) == 7:  # in the third round: the base, its score, a row, two rounds and a row
            raise KeyboardInterrupt
        return roll_out(lanes, student)

    monkeypatch.setattr(rounds, "roll_out", interrupted)
    with pytest.raises(KeyboardInterrupt):
        train(options(tmp_path / "cut"))
    assert pd.read_csv(tmp_path / "cut" / "training.csv")["timesteps"].tolist() == [0, 200]
    other = train(options(tmp_path / "cut"))
    assert (policy / "weights.npz").read_bytes() == (other / "weights.npz").read_bytes()
    curves = [pd.read_csv(tmp_path / name / "training.csv") for name in ("whole", "cut")]
    pd.testing.assert_frame_equal(*(curve.drop(columns="seconds") for curve in curves))
    assert curves[0]["timesteps"].tolist() == [0, 200, 400]
    with pytest.raises(InputError, match=r"options\.hidden 4, asked for is 5"):
        train(options(tmp_path / "cut", hidden=5))


def test_every_round_has_plants_of_its_own(tmp_path, monkeypatch):
    drawn = []

    def noted(task, split, numbers, seed):
        drawn.append((split, *numbers))
        return student_lanes(task, split, numbers, seed)

    asked = options(tmp_path / "run", timesteps=200)
    monkeypatch.setattr(rounds, "student_lanes", noted)
    train(asked)
    assert drawn == [
        ("training", 0), ("validation", 0), ("validation", 0),
        ("training", 0), ("training", 1), ("validation", 0),
        ("training", 0, 1, 2, 3),  # how far its loops go
    ]  # fmt: skip


def test_a_round_that_made_it_much_worse_is_taken_back_and_the_next_is_fitted(
    tmp_path, monkeypatch
):
    rates = []

    def fit(self, visited, weights, rate):
        rates.append(rate)
        with torch.no_grad():
            self.tensors["head_bias"][WEIGHTED] += 20.0 if len(rates) == 2 else 0.01
        return 1.0

    monkeypatch.setattr(Learner, "fit", fit)
    monkeypatch.setattr(rounds, "WORSE", 5.0)  # of one plant to another the error differs as well
    monkeypatch.setattr(rounds, "NEAR", 5.0)
    course = rounds.Rounds(options(tmp_path / "run", timesteps=500))
    course.run()
    assert (course.done, course.taken_back, len(rates)) == (5, 1, 4)
    assert course._learner.student.arrays["head_bias"][WEIGHTED] == pytest.approx(0.03)
    assert rates[2] < 0.7 * rates[1]


def test_train_and_bench_through_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command = ["train", "imitation", "--lanes", "1", "--timesteps", "100", "--out", "run"]
    command += ["--baseline", "adaptive-dual-loop"]
    assert main(command) == 0
    assert "adaptive-dual-loop" in capsys.readouterr().out
    name = "learned:run/policy"
    (row,) = run_unit(Unit(name, "Stage", 2026, "public", (0,), "stamp"))
    assert (row["failure"], row["sees"]) == ("", "preview")
    for words, said in (
        (["--sweep", "1"], "a sweep of imitation is not known"),
        (["--action", "increment"], "--action is no option of imitation"),
        (["--task", "Stag"], "did you mean 'Stage'"),
        (["--seed", "1"], "seed 0, asked for is 1"),
    ):
        assert main([*command, *words]) == 2
        error = capsys.readouterr().err
        assert said.lower() in error.lower()
    pytest.importorskip("onnx")
    assert main(["export", "onnx", "run/policy", "--out", "p.onnx"]) == 0
    assert "the whole controller on belief P10 stage" in capsys.readouterr().out


def test_a_policy_is_whole_or_refused_in_one_line(met, tmp_path):
    policy, _ = met
    layout, belief = TASK.layout(), TASK.belief()
    folder = policy.save(tmp_path / "policy")
    controller = make_controller(f"learned:{folder}", belief, layout)
    shown = np.zeros((3, layout.size), dtype=np.float32)
    action, state = controller.predict(shown + 0.1)
    moved, _ = controller.predict(shown, state, [True, False, False])
    fresh, _ = controller.predict(shown)
    assert action.shape == (3, 1)
    assert moved[0] == fresh[0]
    assert moved[1] == moved[2] != moved[0]
    with pytest.raises(InputError, match="belongs to another observation layout"):
        make_controller(f"learned:{folder}", belief, replace(layout, ts_s=2e-4))
    guarded = make_controller(f"guarded:{folder}", belief, layout)
    assert guarded.predict(shown)[0].shape == (3, 1)
    short = make_controller(f"learned:{folder}", belief, replace(layout, preview=6))
    with pytest.raises(InputError, match="shown 8 samples"):
        short.predict(shown[:, :9])
    document = json.loads((folder / "policy.json").read_text())
    (folder / "policy.json").write_text(json.dumps(document | {"version": 1}))
    with pytest.raises(InputError, match=r"of an earlier release.*teach it again"):
        StudentPolicy.load(folder)
    (folder / "policy.json").write_text(json.dumps(document | {"weighted": 3}))
    with pytest.raises(InputError, match="weighted is 3"):
        StudentPolicy.load(folder)
    (folder / "policy.json").write_text(json.dumps(document))
    (folder / "weights.npz").write_bytes(b"cut")
    with pytest.raises(InputError, match="perhaps one of them was cut off"):
        StudentPolicy.load(folder)


def test_a_student_of_several_kinds_through_the_command_line(tmp_path, monkeypatch, capsys):
    """It corrects the bank, reports at once where nobody watches a terminal, and refuses in one line."""
    kinds = {
        name: replace(ALL[name], samples=101, first=51, references=("sine",))
        for name in ("Preisach", "Duhem")
    }
    others = {name: ALL[name] for name in ("Stage", "Load")}
    monkeypatch.setattr("rdpi_gym.envs.tasks.TASKS", MappingProxyType(kinds | others))
    monkeypatch.chdir(tmp_path)
    command = ["train", "imitation", "--task", "Preisach,Duhem", "--lanes", "2"]
    command += ["--timesteps", "200", "--hidden", "4", "--out", "run"]
    assert main(command) == 0
    told = capsys.readouterr()
    assert "adaptive-core-bank" in told.out
    assert told.err.startswith("measuring adaptive-core-bank: 0 of 2\n")
    policy = StudentPolicy.load(tmp_path / "run" / "policy")
    assert (policy.baseline, policy.training["task"]) == ("adaptive-core-bank", "Preisach,Duhem")
    driven = make_controller("learned:run/policy", kinds["Duhem"].belief(), kinds["Duhem"].layout())
    assert driven.warning() is None
    for words, said in (
        (["--baseline", "pi"], "a student corrects adaptive-dual-loop or adaptive-core-bank"),
        (["--task", "Preisach,Stage"], "Stage and Preisach differ in sampling time"),
        (["--task", "Preisach,Preisch"], "did you mean 'Preisach'"),
        (["--task", "Load"], "plants change within an episode"),
        (["--lanes", "3"], "give a multiple of 2"),
        (["--baseline", "adaptive-dual-loop"], "several tasks"),
    ):
        assert main([*command, *words]) == 2
        error = capsys.readouterr().err
        assert said.lower() in error.lower()
        assert error.count("\n") == 1
    pytest.importorskip("onnx")
    assert main(["export", "onnx", "run/policy", "--out", "p.onnx"]) == 2
    assert "rdpi export c takes any" in capsys.readouterr().err


def test_tasks_that_cannot_be_taught_are_refused():
    changing = replace(TASK, schedule=lambda model, rng: {})
    with pytest.raises(InputError, match="take Stage and score it there"):
        student_lanes(changing, "training", range(1), 0)
    with pytest.raises(InputError, match="lanes is 0"):
        Options(lanes=0)


def shares(name, task):
    """Mean error of a shipped student on a plant that neither taught nor chose it, over its base's."""
    policy = find_learned(name)
    assert is_like(task.layout(), policy.layout)
    blank = replace(policy, student=Student.blank(policy.student.inputs, 64, WEIGHTED))
    own, base = (drive_draws(each, (task, "validation", [100], 0)) for each in (policy, blank))
    return own.score.percent.mean() / base.score.percent.mean()


def test_the_shipped_student_leaves_less_than_what_it_corrects():
    """At the farthest stroke, too, of which it does not warn."""
    task = replace(STAGE, samples=1500, amplitude_share=1.0 - SCALE_SPREAD)
    assert shares("imitation-stage", task) < 0.6


@pytest.mark.parametrize("name", ["Preisach", "BoucWen", "Duhem"])
def test_one_student_leaves_less_on_each_of_three_other_kinds(name):
    assert shares("imitation-kinds", replace(ALL[name], samples=1500)) < 0.6


def test_the_student_of_the_measured_stack_leaves_less_at_its_own_rate():
    assert shares("imitation-measured", ALL["Measured"]) < 0.9
