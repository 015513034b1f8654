"""Linear feedback: what is designed is what runs, modes are damped, and certificates hold."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from baselines import make_controller
from baselines.loops import LinearSystem, belief_path, certify, gain, integrator, unit_delay
from baselines.registry import CONTROLLERS
from rdpi_gym.envs import ObservationLayout, TrackingTask
from rdpi_gym.envs.tasks import TASKS
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import load_effect
from rdpi_gym.support.errors import InputError
from tests.baselines.playing import play

TS = 1e-4
STATIC = P10.with_hysteresis(P10.hysteresis.static())
DAMPERS = ("integral-resonant", "positive-position", "dual-loop")
LOOPS = ("pi-preview", *DAMPERS, "smith-predictor", "lqg-preview", "h-infinity")


def stage(**values):
    effects = {
        "resonance": {"f0_hz": 739.0, "damping": 0.03},
        "delay": {"delay_s": 1e-4},
        "sensor_lag": {"time_constant_s": 1e-4},
    }
    made = tuple(load_effect(name)(**{**effects[name], **values.get(name, {})}) for name in effects)
    return replace(STATIC, name="stage", effects=made)


STAGE = stage()


def layout_of(plant):
    return ObservationLayout.for_plant(plant, TS, preview=8)


def made(name, belief, settings=None):
    factory = CONTROLLERS[name]
    return factory(
        belief, layout_of(belief), **({} if settings is None else {"settings": settings})
    )


@pytest.mark.parametrize("name", LOOPS)
def test_the_loop_that_runs_is_the_loop_that_was_designed(name):
    assert_runs_as_designed(made(name, STAGE, {}), STAGE)


def assert_runs_as_designed(controller, plant):
    """On its belief, with sticking plays, noise that enters is answered by -P C / (1 + P C)."""
    task = TrackingTask(plant, controller.layout)
    rest = np.zeros((600, 1))
    observation = task.reset(rest)
    kick = np.zeros(600)
    kick[5] = 1e-3 * controller.layout.scale_um
    y, state = np.empty(599), None
    for k in range(599):
        shown = observation.astype(np.float64)
        shown[0, -2] += kick[k] / controller.layout.scale_um
        y[k] = task.displacement_um[0]
        action, state = controller.predict(shown, state)
        observation = task.step(controller.layout.place_to_V(action[:, 0].astype(np.float64)))
    loop = controller.open_loops[0]
    closed = loop.closed() + gain(-1.0)  # 1 / (1 + L) - 1 = -L / (1 + L)
    x, expected = np.zeros(closed.order), np.empty(599)
    for k in range(599):
        expected[k] = closed.c @ x + closed.d * kick[k]
        x = closed.a @ x + closed.b * kick[k]
    assert np.abs(expected).max() > 1e-4  # it does answer
    assert np.abs(y - expected).max() < 0.03 * np.abs(expected).max() + 2e-5  # actions are float32


def test_a_damper_damps_its_mode_and_one_that_has_moved():
    for name in DAMPERS:
        controller = made(name, STAGE, {})
        for factor in (1.0, 0.85, 1.15):
            moved = belief_path(stage(resonance={"f0_hz": 739.0 * factor}), TS).dynamics
            loop = unit_delay() * controller.feedback * moved
            z = np.exp(2j * np.pi * TS * 739.0 * factor * np.linspace(0.98, 1.02, 41))
            left = np.abs(1.0 / (1.0 + loop.response(z)))
            assert loop.closed().radius < 1.0, name
            assert left.max() < (0.5 if factor == 1.0 else 1.0), name


def test_a_loop_that_a_load_makes_unstable_is_withdrawn_and_does_not_ring_on():
    controller = made("dual-loop", STAGE, {"gain_share": 1.5, "damping_share": 1.0})
    loaded = stage(resonance={"f0_hz": 400.0})
    moved = belief_path(loaded, TS).dynamics
    assert (unit_delay() * controller.feedback * moved).closed().radius > 1.01
    r = 20.0 * np.sin(2.0 * np.pi * 30.0 * TS * np.arange(3000))[:, None]
    errors = np.abs(play(controller, loaded, r).errors_um)
    assert errors.max() < 30.0
    assert errors[-500:].max() < 2.0


def test_a_belief_without_a_mode_gives_a_controller_without_notch_or_damper():
    lagging = replace(STATIC, effects=STAGE.effects[1:])
    for name in ("pi-preview", *DAMPERS):
        plain, ringing = made(name, lagging, {}), made(name, STAGE, {})
        assert plain.path.mode is None
        assert plain.feedback.order < ringing.feedback.order
        assert "has no mode, and one below" in plain.warning()
        assert ringing.warning() is None


def test_pi_warns_of_a_mode_that_its_belief_lacks_and_is_right():
    banded = P10.with_hysteresis(P10.hysteresis.band_limited(800.0))
    mode = load_effect("resonance")(f0_hz=1000.0, damping=0.02)
    truth = replace(banded, effects=(mode,))
    layout = ObservationLayout.for_plant(banded, TS)
    r = 20.0 * np.sin(2.0 * np.pi * 50.0 * TS * np.arange(600))[:, None]
    largest = []
    for belief in (banded, truth):
        controller = make_controller("pi-classical-reference-rate", belief, layout)
        largest.append(np.abs(play(controller, truth, r).errors_um).max())
        said = controller.warning()
        assert (said is None) == (belief is truth)
        assert belief is truth or float(said.split("below ")[1].split(" Hz")[0]) > 1000.0
        assert controller.certificate() is not None
    assert largest[0] > 100.0  # five times the reference
    assert largest[1] < 2.0


def test_the_certificate_is_as_strong_as_the_loop():
    z = np.exp(1j * np.geomspace(1e-4, np.pi, 500))
    for samples, gain_per_sample, word in (
        (1, 0.3, "passive"), (2, 0.4, "small gain"), (4, 0.2, "small gain in part"), (4, 0.6, None),
    ):  # fmt: skip
        loop = integrator(1.0).times(gain_per_sample)
        for _ in range(samples):
            loop = unit_delay() * loop
        found = certify([loop], z, (0.5, 2.0))
        line = found.line()
        assert (line is None) == (word is None)
        assert line is None or line.startswith(f"{word}:")
        rng = np.random.default_rng(0)
        low, high = found.sector
        largest = worst_growth(loop, low**found.share, high**found.share, rng)
        assert word is None or largest < 1.0, word


def worst_growth(loop: LinearSystem, low, high, rng):
    """Growth over 400 samples of changes that a gain between two bounds answers, ten courses."""
    growth = []
    for _ in range(10):
        x, held = rng.standard_normal(loop.order), None
        first = np.linalg.norm(x)
        for k in range(400):
            if k % 7 == 0:
                held = rng.choice([low, high])
            e = -held * (loop.c @ x) / (1.0 + held * loop.d)
            x = loop.a @ x + loop.b * e
        growth.append(np.linalg.norm(x) / first)
    return max(growth)


def bandwidth_hz(controller):
    """Frequency (Hz) up to which plays that stick leave the amplitude of the reading within 3 dB."""
    frequencies_hz = np.geomspace(1.0, 1500.0, 400)
    z = np.exp(2j * np.pi * TS * frequencies_hz)
    tracking = 1.0 - 1.0 / (1.0 + controller.open_loops[0].response(z))
    within = np.abs(20.0 * np.log10(np.abs(tracking))) <= 3.0
    return frequencies_hz[np.argmin(within) - 1]


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("dual-loop", {"damping_share": 0.9, "corner_share": 0.85, "gain_share": 0.54,
                       "proportional_s": 1e-5, "lowpass_hz": 2100.0}),
        ("h-infinity", {"bandwidth_hz": 500.0, "effort": 7e-3, "roll_off_hz": 4000.0}),
    ],
)  # fmt: skip
def test_damped_feedback_alone_reaches_beyond_the_mode(name, settings):
    """Bandwidth of the loop that runs, on the stage of arXiv 2412.18374: a mode at 739 Hz."""
    banded = P10.with_hysteresis(P10.hysteresis.band_limited(800.0))
    ringing = replace(banded, effects=STAGE.effects[:1])
    controller = made(name, ringing, settings)
    assert_runs_as_designed(controller, ringing)
    assert bandwidth_hz(controller) >= 739.0
    z = np.exp(2j * np.pi * TS * np.geomspace(1.0, 1500.0, 400))
    assert max(np.abs(1 / (1 + each.response(z))).max() for each in controller.open_loops) < 2.2
    assert bandwidth_hz(made("pi-preview", ringing, {})) < 0.5 * bandwidth_hz(controller)


def test_feedback_takes_off_what_an_adaptive_feedforward_leaves():
    (lanes,) = TASKS["Bare"].lanes("training", 1)
    left = {}
    for name in ("adaptive-feedforward", "adaptive-dual-loop"):
        controller = CONTROLLERS[name](lanes.belief, lanes.layout(), settings={})
        task, state, errors = lanes.track(lanes.layout()), None, []
        observation = task.reset(lanes.references_um, lanes.draws[0].noises)
        for _ in range(1200):
            action, state = controller.predict(observation, state)
            observation = task.step(controller.layout.place_to_V(np.float64(action[:, 0])))
            errors.append(task.error_um.copy())
        left[name] = float(np.sqrt(np.mean(np.square(errors[600:]))))
    assert left["adaptive-dual-loop"] < 0.8 * left["adaptive-feedforward"]


def test_h_infinity_says_what_it_needs(monkeypatch):
    """Without slycot, python-control would have it that no controller exists for these weights."""
    pytest.importorskip("control", reason="h-infinity needs the extra robust")
    monkeypatch.setitem(sys.modules, "slycot", None)
    with pytest.raises(InputError, match=r"needs python-control and slycot, .* rdpi-gym\[robust\]"):
        made("h-infinity", STAGE, {"bandwidth_hz": 61.5})
