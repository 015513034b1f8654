"""predict: blocks and samples agree, lanes are independent, memory is the caller's, limits hold."""

from __future__ import annotations

import pickle
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from baselines import CONTROLLERS, FEEDFORWARDS, known_controller, make_controller
from baselines.feedforward import StaticGain
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import P5, P10, RDPI, Plant, PlantModel
from rdpi_gym.support.errors import InputError
from tests.baselines.playing import play, rms
from tests.looping import over

TS = 1e-3  # every literal loop is stable here, so traces are reproducible
OFFSET = PlantModel(
    P10.hysteresis.band_limited(300.0), "offset", (5.0, 70.0), (35.0, 15.0), offset_um=3.0
)


def available():
    """Every controller that can be made here."""
    return [name for name in CONTROLLERS if name != "h-infinity" or find_spec("slycot")]


def references(layout, samples=150, lanes=3):
    """Different sines that begin at the plant's rest, as float32 observations show them."""
    plant = Plant(OFFSET if layout.centre_um else P10, TS)
    low, high = layout.command_range_V
    rest_V = min(max(0.0, low), high)
    plant.reset(u0_V=rest_V)
    rest = plant.simulate(np.array([rest_V]))[0]
    t = np.arange(samples)[:, None]
    start = np.minimum(t / 20.0, 1.0)
    sines = layout.centre_um - rest + layout.scale_um * np.sin(t * np.linspace(0.1, 0.3, lanes))
    shown = np.float32((rest + start * sines - layout.centre_um) / layout.scale_um)
    return np.float64(shown) * layout.scale_um + layout.centre_um


@over("belief", [P10, OFFSET])
def test_samples_and_blocks_agree(belief):
    layout = ObservationLayout.for_plant(belief, TS)
    r = references(layout)
    for name in FEEDFORWARDS:
        controller = make_controller(name, belief, layout)
        commands = play(controller, belief, r).commands_V
        state = controller.start(r[0])
        block = controller.command_block(r[1:], state)
        span = np.ptp(layout.command_range_V)
        np.testing.assert_allclose(commands, block, atol=1e-7 * span, err_msg=name)  # float32
        split = controller.start(r[0])
        parts = [controller.command_block(part, split) for part in np.split(r[1:], [1, 60])]
        np.testing.assert_array_equal(np.concatenate(parts), block, name)
        np.testing.assert_array_equal(split, state, name)


def test_actions_are_places_lanes_equal_single_runs_and_wide_increments_set_the_same_commands():
    layout = ObservationLayout.for_plant(P10, TS)
    wide = ObservationLayout.for_plant(P10, TS, action="increment", action_scale_V=30.0)
    r = references(layout)
    truth = P10.with_hysteresis(P10.hysteresis.band_limited(800.0))
    for name in available():
        together = play(make_controller(name, P10, layout), truth, r)
        assert together.actions.shape == (len(r) - 1, 3, 1), name
        assert together.actions.dtype == np.float32, name
        assert np.all(np.abs(together.actions) <= 1.0), name
        alone = play(make_controller(name, P10, layout), truth, r[:, -1:])
        np.testing.assert_allclose(
            together.commands_V[:, -1], alone.commands_V[:, 0], atol=1e-9, err_msg=name
        )
        by_increment = play(make_controller(name, P10, wide), truth, r)
        np.testing.assert_allclose(
            by_increment.commands_V, together.commands_V, atol=1e-3, err_msg=name
        )


def test_an_episode_that_begins_anew_repeats_and_leaves_the_other_lane_alone():
    layout = ObservationLayout.for_plant(P5, TS)
    for name in available():
        controller = make_controller(name, P5, layout)
        rng = np.random.default_rng(0)
        shown = rng.uniform(-0.5, 0.5, (30, 2, layout.size)).astype(np.float32)
        shown[15:, 0] = shown[:15, 0]
        if hasattr(controller, "plan"):
            controller.plan(rng.uniform(-5, 5, (40, 2)))
        state, actions = None, []
        for k, observation in enumerate(shown):
            starts = np.array([k in (0, 15), k == 0])
            action, state = controller.predict(observation, state, starts)
            actions.append(action)
        actions = np.array(actions)
        np.testing.assert_array_equal(actions[15:, 0], actions[:15, 0], name)
        state, plain = None, []
        for observation in shown:
            action, state = controller.predict(observation, state)
            plain.append(action)
        np.testing.assert_array_equal(actions[:, 1], np.array(plain)[:, 1], name)


def test_memory_belongs_to_the_caller_and_controllers_can_be_pickled():
    layout = ObservationLayout.for_plant(P5, TS)
    for name in available():
        controller = make_controller(name, P5, layout)
        if hasattr(controller, "plan"):
            controller.plan(np.linspace(0, 5, 40)[:, None])
        rng = np.random.default_rng(1)
        observation = rng.uniform(-0.5, 0.5, layout.size).astype(np.float32)
        _, state = controller.predict(observation)
        kept = state.copy()
        first, later = controller.predict(observation, state)
        controller.predict(-observation, state)
        controller.predict(-observation)
        again, _ = controller.predict(observation, state)
        np.testing.assert_array_equal(state, kept, name)
        np.testing.assert_array_equal(first, again, name)
        assert first.shape == (1,), name
        assert not np.shares_memory(state, later), name
        copy = pickle.loads(pickle.dumps(controller))
        np.testing.assert_array_equal(copy.predict(observation, state)[0], first, name)


def test_commands_stay_in_range_and_increments_in_theirs():
    narrow = replace(P10, command_range_V=(-20.0, 25.0))
    r = references(ObservationLayout.for_plant(P10, TS))
    for name in available():
        for options in ({}, {"action": "increment", "action_scale_V": 1.5}):
            layout = ObservationLayout.for_plant(narrow, TS, **options)
            commands = play(make_controller(name, narrow, layout), narrow, r).commands_V
            assert commands.min() >= -20.0 - 1e-5, name
            assert commands.max() <= 25.0 + 1e-5, name
            if options:
                steps = np.abs(np.diff(commands, axis=0, prepend=0.0))
                assert steps.max() == pytest.approx(1.5, rel=1e-5), name
            else:
                assert commands.max() == pytest.approx(25.0, rel=1e-6), name


def test_a_feedforward_knows_which_increments_were_applied():
    layout = ObservationLayout.for_plant(P10, TS, action="increment", action_scale_V=1.5)
    r = references(layout)
    for name in FEEDFORWARDS:
        controller = make_controller(name, P10, layout)
        block = controller.command_block(r[1:], controller.start(r[0]))
        assert np.abs(np.diff(block, axis=0)).max() == pytest.approx(1.5), name
        applied = play(controller, P10, r).commands_V
        np.testing.assert_allclose(applied, block, atol=1e-5, err_msg=name)


def test_where_the_command_is_clipped_the_inversion_free_memory_is_the_plant_s():
    narrow = replace(P10, command_range_V=(-20.0, 25.0))
    layout = ObservationLayout.for_plant(narrow, TS)
    r = references(ObservationLayout.for_plant(P10, TS))
    controller = make_controller("inversion-free-literal", narrow, layout)
    state = controller.start(r[0])
    plant = Plant([narrow] * r.shape[1], TS)
    plant.reset(u0_V=0.0)
    plant.simulate(controller.command_block(r, state))
    np.testing.assert_allclose(state[2:-1], plant.memory, atol=1e-12)


def test_the_belief_is_read_and_the_offset_compensated():
    layout = ObservationLayout.for_plant(OFFSET, TS)
    r = references(layout)
    for name in ("inversion-free-literal", "classical-literal", "classical-low-passed"):
        errors = play(make_controller(name, OFFSET, layout), OFFSET, r).errors_um
        plain = play(make_controller("none", OFFSET, layout), OFFSET, r).errors_um
        assert rms(errors) < 0.5 * rms(plain), name


def test_static_gain_is_the_chord_of_the_virgin_curve():
    static = P10.with_hysteresis(P10.hysteresis.static())
    layout = ObservationLayout.for_plant(static, TS)
    controller = StaticGain(static, layout)
    u = np.linspace(0.0, 40.0 / controller.gain_um_V, 200)
    assert Plant(static, TS).simulate(u)[-1] == pytest.approx(40.0, rel=1e-12)


def test_a_static_plant_is_inverted_exactly_by_the_static_inverse():
    static = P10.with_hysteresis(P10.hysteresis.static())
    layout = ObservationLayout.for_plant(static, TS)
    r = references(layout)
    u = make_controller("classical-static", static, layout).command_block(r)
    np.testing.assert_allclose(Plant(static, TS, lanes=3).simulate(u), r, atol=1e-12 * 40.0)


def test_a_model_without_plays_is_a_gain():
    model = PlantModel(RDPI((2.0,), (), 0.0), "gain", (-9.0, 9.0), (0.0, 10.0))
    layout = ObservationLayout.for_plant(model, TS)
    r = references(layout)
    for name in (*FEEDFORWARDS, "preview-inversion"):
        commands = play(make_controller(name, model, layout), model, r).commands_V
        np.testing.assert_allclose(commands, r[1:] / 2.0, atol=1e-5, err_msg=name)


def test_bad_input_is_one_line():
    layout = ObservationLayout.for_plant(P5, TS)
    controller = make_controller("classical-static", P5, layout)
    _, state = controller.predict(np.zeros((2, layout.size), dtype=np.float32))
    correction = ObservationLayout.for_plant(P5, TS, action="correction")
    bad = np.zeros((5, 2))
    bad[3, 1] = np.nan
    calls = {
        "this layout shows 7 numbers": lambda: controller.predict(np.zeros(6)),
        "a state of 2 episodes": lambda: controller.predict(np.zeros((3, layout.size)), state),
        "action 'command' or 'increment'": lambda: make_controller("pi", P5, correction),
        "sample 3 of lane 1": lambda: controller.command_block(bad),
        "give (samples, lanes)": lambda: controller.command_block(np.zeros(5)),
        "did you mean 'classical-static'": lambda: make_controller("clasic-static", P5, layout),
        "no controller is named 'xyz'": lambda: make_controller("xyz", P5, layout),
        "cannot be imported": lambda: make_controller("no_such_module:x", P5, layout),
        "without predict": lambda: make_controller("math:pi", P5, layout),
    }
    for expected, call in calls.items():
        with pytest.raises(InputError) as caught:
            call()
        assert expected in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_controller_of_one_s_own_by_module_and_attribute():
    layout = ObservationLayout.for_plant(P5, TS)
    made = make_controller("baselines.classical:ClassicalStatic", P5, layout)
    assert type(made) is FEEDFORWARDS["classical-static"]


def test_every_feedforward_is_there_with_feedback_too():
    assert {"none", "classical-static", "inversion-free-literal", "extended-inverse"} <= set(
        FEEDFORWARDS
    )
    feedback = {"pi", *(f"pi-{name}" for name in FEEDFORWARDS)}
    tuned = {name for name, make in CONTROLLERS.items() if hasattr(make, "knobs")}
    assert set(CONTROLLERS) - tuned == {*FEEDFORWARDS, *feedback, "preview-inversion"}
    assert {"pi-preview", "dual-loop", "h-infinity"} <= tuned
    for name, kind in FEEDFORWARDS.items():
        assert kind.name == name


NEW = """
from baselines.feedforward import StaticGain

class Twice(StaticGain):
    name = "twice"

class Quiet(StaticGain):
    pass
"""
ASK = """
import sys, baselines
baselines.__path__.append(sys.argv[1])
new = [name for name in baselines.CONTROLLERS if "twice" in name]
print(new, baselines.known_controller("twice").__module__)
"""


@pytest.mark.slow
def test_a_new_controller_is_one_file(tmp_path):
    (tmp_path / "new.py").write_text(NEW)
    found = subprocess.run(
        [sys.executable, "-c", ASK, str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert found.stdout == "['twice', 'pi-twice'] baselines.new\n"


ENTRY = "[rdpi_gym.controllers]\nlab-gain = lab:Gain\nlab-broken = lab:nothing\n"


def test_an_installed_package_brings_controllers_by_entry_point(tmp_path, monkeypatch):
    (tmp_path / "lab.py").write_text(
        "from baselines.feedforward import StaticGain\nclass Gain(StaticGain): ...\n"
    )
    info = tmp_path / "lab-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRY)
    monkeypatch.syspath_prepend(tmp_path)
    layout = ObservationLayout.for_plant(P5, TS)
    assert type(make_controller("lab-gain", P5, layout)).__module__ == "lab"
    with pytest.raises(InputError, match=r"'lab-broken' \(lab:nothing\) cannot be imported"):
        make_controller("lab-broken", P5, layout)
    with pytest.raises(InputError, match="did you mean 'lab-gain'"):
        make_controller("lab-gian", P5, layout)
    with pytest.raises(InputError, match="no controller of this package"):  # out of a file
        known_controller("lab-gain")


def test_names_out_of_files_come_from_the_closed_list():
    assert known_controller("pi-none")(P5, ObservationLayout.for_plant(P5, TS))
    for name in ("os:system", "learned:ppo", "baselines.pi:PI", "", None, 3, ["pi"], {}):
        with pytest.raises(InputError, match="no controller of this package"):
            known_controller(name)
