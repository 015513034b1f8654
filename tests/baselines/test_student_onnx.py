"""A student's controller exported to ONNX does what it does in Python, and says what it must be shown."""

import itertools
import json
import sys
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

import onnxruntime

from baselines.learned.imitation import policy as student
from baselines.learned.imitation.policy import (
    WEIGHTED,
    Student,
    StudentController,
    StudentPolicy,
    fresh_arrays,
)
from baselines.learned.imitation.teacher import student_lanes
from baselines.learned.onnx_export import controller_on, export_student
from rdpi_gym.cli import main
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.tasks import named_task
from rdpi_gym.envs.tasks.stages import STAGE
from rdpi_gym.plant import PlantModel, Sensor, named_plant
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.onnx_metadata import METADATA


def drawn():
    """A plant of the task that nobody was taught on, with each reference; its noise lasts once.

    Its sensor has no steps: in a loop a reading at the border of one falls either way for the last digit.
    """
    nominal = replace(STAGE.nominal(), sensor=Sensor(noise_um=0.01))
    task = replace(STAGE, samples=1300, nominals=(nominal,), beliefs=(STAGE.belief(),))
    (lanes,) = student_lanes(task, "validation", [0], 0)
    return lanes


def taught(name):
    """A student that answers at random, of ``adaptive-dual-loop``: those that ship correct the bank of cores."""
    task = named_task(name)
    policy = StudentPolicy.untrained(task.belief(), task.layout(), 64, "adaptive-dual-loop")
    inputs = np.zeros(policy.student.inputs, dtype=np.float32)
    arrays = fresh_arrays(0, inputs, inputs + 1.0, 64, WEIGHTED)
    head = 0.02 * np.random.default_rng(0).normal(size=arrays["head"].shape)
    made = Student(arrays | {"head": head.astype(np.float32)}, WEIGHTED)
    return replace(policy, student=made.rounded_to_half(), training={"task": name})


class InDouble:
    """NumPy for a student's network that asks for single precision in vain."""

    float32 = np.float64

    def __getattr__(self, name):
        return getattr(np, name)


class Step:
    """A file as somebody runs it who has it alone."""

    def __init__(self, path):
        self.session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        said = self.session.get_modelmeta().custom_metadata_map[METADATA]
        self.about = json.loads(said)

    def start(self, lanes):
        return np.zeros((lanes, self.about["state"]))

    def __call__(self, reference_um, measured_um, applied_V, state):
        given = {"reference_um": reference_um, "measured_um": measured_um,
                 "applied_V": applied_V, "state": state}  # fmt: skip
        return self.session.run(["command_V", "next_state"], given)


def decoded(layout, observation):
    parts = layout.reference_um, layout.measured_um, layout.command_V
    return [np.ascontiguousarray(part(observation)) for part in parts]


def encoded(layout, reference_um, measured_um, applied_V):
    low, high = layout.command_range_V
    moved = np.concatenate([reference_um, measured_um[:, None]], axis=1)
    place = 2.0 * (applied_V - low) / (high - low) - 1.0
    return np.hstack([(moved - layout.centre_um) / layout.scale_um, place[:, None]])


@pytest.fixture(scope="module")
def policy():
    return taught("Stage")


@pytest.fixture(scope="module")
def stage(policy, tmp_path_factory):
    return Step(export_student(policy, tmp_path_factory.mktemp("stage") / "stage.onnx"))


@pytest.fixture(scope="module")
def loop(stage):
    """What the file was shown while it drove drawn plants, and the error that it left (µm)."""
    lanes = drawn()
    samples, count = lanes.references_um.shape
    layout = lanes.layout()
    track = lanes.track(layout)
    observation = track.reset(lanes.references_um, lanes.noises)
    shown, errors, state = [], [], stage.start(count)
    for _ in range(samples - 1):
        shown.append(decoded(layout, observation))
        command, state = stage(*shown[-1], state)
        observation = track.step(command)
        errors.append(track.error_um.copy())
    return shown, np.array(errors)


def compared(made, step, shown):
    """Show both the same: largest difference (V) in one step, over all; largest of the memory (µm).

    The memory that is compared is what the inverse was asked for at each sample.
    """
    lanes = len(shown[0][1])
    newest = np.arange(made.rows.total)
    newest = made.inverse.rows.of(made.rows.of(newest, "inverse"), "wanted")[-1]
    state, kept = made.start(shown[0][0][:, 0]), step.start(lanes)
    once, always, wanted, commands, allowed = 0.0, 0.0, 0.0, [], 1.0
    for k, each in enumerate(shown):
        alone, _ = step(*each, np.ascontiguousarray(state.T) if k else kept)
        found, kept = step(*each, kept)
        pair = np.ascontiguousarray(each[0][:, :2].T)
        command = made.next_command(encoded(made.layout, *each), pair, state)
        once = max(once, np.abs(alone - command).max())
        always = max(always, np.abs(found - command).max())
        wanted = max(wanted, np.abs(kept[:, newest] - state[newest]).max())
        allowed = min(allowed, made.rows.of(state, "allowed").min())
        commands.append(command)
    return once, always, wanted, np.array(commands), allowed


def test_from_the_same_memory_it_is_python_to_a_millionth_of_a_volt(policy, stage, loop):
    once, always, wanted, commands, _ = compared(controller_on(policy, None), stage, loop[0])
    assert once < 1e-6
    # what Python rounds to single precision goes through the estimate
    assert max(always, wanted) < 1e-5
    assert commands.std() > 10.0


def test_where_python_does_not_round_it_is_the_same_over_all_of_a_loop(
    policy, stage, loop, monkeypatch
):
    monkeypatch.setattr(student, "np", InDouble())
    _, always, wanted, _, _ = compared(controller_on(policy, None), stage, loop[0])
    assert max(always, wanted) < 1e-6


def test_alone_it_leaves_the_error_that_the_student_leaves(policy, loop):
    lanes = drawn()
    layout = lanes.layout()
    made = StudentController(policy, lanes.belief, layout)
    track = lanes.track(layout)
    observation = track.reset(lanes.references_um, lanes.noises)
    state, errors = None, []
    for _ in range(len(loop[1])):
        action, state = made.predict(observation, state)
        observation = track.step(layout.place_to_V(action[:, 0].astype(np.float64)))
        errors.append(track.error_um.copy())
    np.testing.assert_allclose(loop[1], errors, rtol=0, atol=1e-4)
    assert np.abs(loop[1][1000:]).mean() < 0.1


def rough(made, samples):
    """A rough walk to beyond both ends of the command, followed with a ringing that grows and ends."""
    layout, rng = made.layout, np.random.default_rng(3)
    ahead = layout.preview
    slow = np.sin(np.arange(samples + ahead)[:, None] * np.array([0.01, 0.023]))
    reference = layout.centre_um + 3.5 * layout.scale_um * slow
    measured = reference[:samples] + 0.01 * layout.scale_um * rng.normal(size=(samples, 2))
    burst = np.arange(samples // 3)
    ring = 0.02 * 1.02**burst * np.sin(2.0 * np.pi * 800.0 * layout.ts_s * burst)
    measured[samples // 3 : samples // 3 + len(burst)] += (
        layout.scale_um * np.minimum(ring, 1.0)[:, None]
    )
    low, high = layout.command_range_V
    applied = np.clip(rng.uniform(1.2 * low, 1.2 * high, (samples, 2)), low, high)
    return [
        [np.ascontiguousarray(reference[k : k + ahead + 1].T), measured[k], applied[k]]
        for k in range(samples)
    ]


@pytest.mark.parametrize(
    ("name", "belief"),
    [
        ("Stage", "P5"),
        ("Stage", "picma-rdpi"),
        ("Resonance", None),
        ("Creep", None),
        ("Lag", None),
    ],
)
def test_so_it_is_with_any_belief_at_the_limits_and_while_it_rings(
    name, belief, tmp_path, monkeypatch
):
    policy = taught(name)
    belief = None if belief is None else named_plant(belief)
    made = controller_on(policy, belief)
    step = Step(export_student(policy, tmp_path / "a.onnx", belief))
    low, high = made.layout.command_range_V
    monkeypatch.setattr(student, "np", InDouble())
    _, always, _, commands, allowed = compared(made, step, rough(made, 600))
    assert always < 1e-6 * (high - low)
    assert (commands == low).any()
    assert (commands == high).any()
    assert allowed < 0.5


def test_a_lane_is_the_same_alone_and_among_others(stage, loop):
    both, one = stage.start(len(loop[0][0][1])), stage.start(1)
    for each in loop[0][:200]:
        commands, both = stage(*each, both)
        command, one = stage(*(part[1:2] for part in each), one)
        assert abs(commands[1] - command[0]) < 1e-8


def test_what_is_no_number_changes_nothing_in_its_lane(stage, loop):
    state = stage.start(len(loop[0][0][1]))
    for each in loop[0][:20]:
        _, state = stage(*each, state)
    expected, after = stage(*loop[0][20], state)
    for which, strange in itertools.product(range(3), (np.nan, np.inf, 1e9)):
        spoiled = [part.copy() for part in loop[0][20]]
        spoiled[which].flat[0] = strange
        command, kept = stage(*spoiled, state)
        assert np.array_equal(command[0], spoiled[2][0], equal_nan=True), (which, strange)
        assert np.array_equal(kept[0], state[0]), (which, strange)
        np.testing.assert_array_equal(command[1:], expected[1:])
        np.testing.assert_array_equal(kept[1:], after[1:])


def test_its_metadata_says_what_it_must_be_shown(policy, stage):
    about = stage.about
    assert (about["format"], about["version"]) == ("rdpi-student-onnx", 1)
    assert {each.name for each in stage.session.get_inputs()} == set(about["inputs"])
    assert [each.name for each in stage.session.get_outputs()] == list(about["outputs"])
    assert {each.type for each in stage.session.get_inputs()} == {"tensor(double)"}
    assert stage.session.get_inputs()[0].shape == ["batch", about["preview"] + 1]
    assert (about["corrects"], about["loop"]) == ("adaptive-dual-loop", policy.loop)
    assert PlantModel.from_dict(about["belief"], "metadata") == STAGE.belief()
    assert (about["ts_s"], about["command_range_V"]) == (1e-4, [-80.0, 80.0])
    assert about["warning"] is None


def test_the_command_says_what_the_file_holds_and_what_to_beware_of(
    policy, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    policy.save(tmp_path / "student")
    words = ["export", "onnx", "student", "--out", "step.onnx"]
    assert main(words) == 0
    assert capsys.readouterr().out == (
        "policy: step.onnx, adaptive-dual-loop with its student, the whole controller on belief "
        "P10 stage: a step every 0.0001 s, 500 numbers of state\n"
    )
    assert main([*words, "--belief", "P10"]) == 0
    assert "taught on a belief with actuator_lag, creep" in capsys.readouterr().out
    content = (tmp_path / "step.onnx").read_bytes()
    assert len(content) < 300_000
    assert b".py" not in content  # where it was made is nobody's business


def test_bad_input_is_one_line_and_leaves_nothing(policy, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    layout = ObservationLayout.for_plant(named_plant("P10"), ts_s=1e-4, preview=8)
    StudentPolicy.untrained(named_plant("P10"), layout, hidden=2).save(tmp_path / "untold")
    policy.save(tmp_path / "student")
    for words, message in (
        (["imitation-stag"], "no policy is at 'imitation-stag'"),
        (["guarded:imitation-stage"], "no policy is at 'guarded:imitation-stage'"),
        (["student", "--out", "a.pt"], "ends in .onnx"),
        (["student", "--belief", "P55"], "'P55' is neither a plant file nor one of"),
        (["student", "--belief", "picma-preisach"], "ONNX takes the core rdpi, rdpi export c"),
        (["imitation-stage"], "the student corrects adaptive-core-bank"),
        (["ppo-increment", "--belief", "P10"], "--belief is of students"),
        (["untold"], "--belief is needed"),
    ):  # fmt: skip
        assert main(["export", "onnx", *words]) == 2
        said = capsys.readouterr().err
        assert message in said
        assert said.count("\n") == 1
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(InputError, match=r"onnx, .*pip install rdpi-gym\[onnx\]"):
        export_student(policy, tmp_path / "a.onnx")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["student", "untold"]
