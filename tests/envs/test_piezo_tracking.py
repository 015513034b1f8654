"""What the environment promises of actions, rewards, references, truth and belief."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rdpi_gym.envs import PiezoTrackingEnv
from rdpi_gym.envs.truth import limit_band, randomise_plant
from rdpi_gym.plant import RDPI, PlantModel, Sensor, named_plant
from rdpi_gym.signals import Measured, Sine, make_signal
from tests.looping import over


def act(value):
    """Return an action."""
    return np.array([value], dtype=np.float32)


def follow(env, values):
    """Step through actions; return displacements (µm), commands (V), rewards and the last info."""
    rows = []
    for value in values:
        _, reward, _, _, info = env.step(act(value))
        rows.append((info["displacement_um"], info["command_V"], reward))
    return (*np.array(rows).T, info)


def test_command_is_the_place_in_the_range():
    env = PiezoTrackingEnv(plant="P5")
    env.reset(seed=0)
    for value, command in ((-1.0, -25.0), (0.0, 0.0), (0.5, 12.5), (1.0, 25.0)):
        assert env.step(act(value))[4]["command_V"] == command
        assert env.step(act(value))[4]["saturated"] == 0.0


def test_increments_add_up_to_commands():
    commands, steps = (
        PiezoTrackingEnv(plant="P5"),
        PiezoTrackingEnv(plant="P5", action="increment", action_scale_V=2.5),
    )
    commands.reset(seed=0)
    steps.reset(seed=0)
    place = np.linspace(0.0, 0.8, 65)[1:]  # exact in float32
    y, u, _, _ = follow(commands, place)
    y2, u2, _, _ = follow(steps, 10.0 * np.diff(place, prepend=0.0))
    np.testing.assert_allclose(u2, u, rtol=1e-6)
    np.testing.assert_allclose(y2, y, rtol=1e-6)


def test_what_is_out_of_range_is_clipped_and_counted():
    env = PiezoTrackingEnv(plant="P5", action="increment", action_scale_V=20.0)
    env.reset(seed=0)
    found = [env.step(act(value))[4] for value in (1.0, 0.25, 0.25, -1.5)]
    assert [info["command_V"] for info in found] == [20.0, 25.0, 25.0, 5.0]
    assert [info["saturated"] for info in found] == [0.0, 0.0, 1.0, 2.0]
    assert env.reset()[1]["saturated"] == 0.0


def test_reward_is_minus_the_error_in_units_of_the_reference_and_the_price():
    env = PiezoTrackingEnv(plant="P5", command_cost=3.0)
    env.reset(seed=0)
    last = 0.0
    for value in (0.1, -0.2, 0.7):
        _, reward, terminated, truncated, info = env.step(act(value))
        change = abs(info["command_V"] - last) / 50.0
        assert reward == pytest.approx(-abs(info["error_um"]) / 10.0 - 3.0 * change, abs=1e-12)
        assert info["error_um"] == info["reference_um"] - info["displacement_um"]
        assert (type(reward), terminated, truncated) == (float, False, False)
        assert all(type(value) is float for value in info.values())
        last = info["command_V"]


def test_preview_is_the_future_of_the_reference():
    env = PiezoTrackingEnv(plant="P10", preview=5, frequency_hz=80.0)
    shown = [env.reset(seed=0)[0]]
    shown += [env.step(act(0.0))[0] for _ in range(60)]
    for k in range(len(shown) - 5):
        for ahead in range(6):
            assert shown[k][ahead] == shown[k + ahead][0]


def test_reference_is_the_signal_however_long_the_episode():
    env = PiezoTrackingEnv(plant="P5", frequency_hz=7.0, ts_s=1e-3, smooth_start_s=0.2)
    env.reset(seed=0)
    found = [env.step(act(0.0))[4]["reference_um"] for _ in range(5000)]
    sine = Sine(amplitude_um=10.0, frequency_hz=7.0, smooth_start_s=0.2)
    np.testing.assert_array_equal(found, sine(1e-3 * np.arange(1, 5001)))


def triangle_loop(ts_s, rate_bandwidth_hz):
    """Return displacements (µm) every 0.1 ms of a triangle that turns at samples of every Ts here."""
    env = PiezoTrackingEnv(plant="P10", ts_s=ts_s, rate_bandwidth_hz=rate_bandwidth_hz)
    env.reset(seed=0)
    t = ts_s * np.arange(1, round(0.02 / ts_s) + 1)
    corners = np.interp(t, [0.0, 0.005, 0.015, 0.02], [0.0, 0.4, -0.4, 0.0])
    every = round(1e-4 / ts_s)
    return follow(env, corners)[0][every - 1 :: every]


def test_sampling_time_does_not_change_the_loop():
    """Theory, section 4: the same command at two sampling times traces the same loop."""
    literal = [triangle_loop(ts_s, None) for ts_s in (1e-4, 5e-5, 2e-5)]
    # Actions are float32, 80 V * 6e-8 apart: over 20 µs that shifts thresholds by up to 1e-4 V.
    np.testing.assert_allclose(literal[1], literal[0], atol=1e-3)
    np.testing.assert_allclose(literal[2], literal[0], atol=1e-3)


@over("ts_s", [1e-4, 5e-5, 2e-5])
def test_band_limited_loop_depends_on_sampling_only_within_one_sample(ts_s):
    """The low-pass is exact along a ramp; behind a corner, |v| is smallest between two samples."""
    model = named_plant("P10").hysteresis.band_limited(800.0)
    turn_V_s = 2.0 * 0.4 * 80.0 / 0.005
    largest_um = model.S * model.delta2_s * turn_V_s * (1.0 - model.rate_pole(ts_s))
    difference = np.abs(triangle_loop(ts_s, 800.0) - triangle_loop(1e-5, 800.0)).max()
    assert difference < 0.5 * largest_um


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.0, 0.9))
def test_randomised_parameters_stay_within_their_bounds(seed, half_width):
    nominal = named_plant("P10")
    drawn = randomise_plant(nominal, half_width, np.random.default_rng(seed)).hysteresis
    low, high = 1.0 - half_width - 1e-12, 1.0 + half_width + 1e-12
    for name in ("weights", "thresholds_V", "delta2_s"):
        ratio = np.array(getattr(drawn, name)) / np.array(getattr(nominal.hysteresis, name))
        assert np.all((low <= ratio) & (ratio <= high))


def test_truth_is_drawn_anew_and_belief_is_not():
    env = PiezoTrackingEnv(plant="P5", randomise=0.1)
    nominal = limit_band(named_plant("P5"), 800.0)
    truths = []
    for _ in range(3):
        env.reset(seed=0 if not truths else None)
        truths.append(env.truth)
        assert env.belief == env.nominal == nominal
        assert env.truth != env.belief
    assert len({truth.hysteresis for truth in truths}) == 3


def test_band_limit_is_a_cap():
    assert PiezoTrackingEnv().nominal.hysteresis.rate_bandwidth_hz == 800.0
    assert PiezoTrackingEnv(rate_bandwidth_hz=None).nominal == named_plant("P10")
    slow = named_plant("P10").with_hysteresis(named_plant("P10").hysteresis.band_limited(300.0))
    assert PiezoTrackingEnv(plant=slow).nominal == slow


def test_a_plant_comes_by_name_path_dictionary_or_model(tmp_path):
    model = named_plant("P5")
    path = model.save(tmp_path / "mine.json")
    made = [PiezoTrackingEnv(plant=plant) for plant in ("P5", str(path), model.to_dict(), model)]
    assert len({env.nominal.hysteresis for env in made}) == 1
    assert {env.layout for env in made} == {made[0].layout}


def test_sensor_keywords_replace_the_plants():
    env = PiezoTrackingEnv(plant="P5-bench", noise_um=0.0, resolution_um=0.5)
    assert env.nominal.sensor == Sensor(resolution_um=0.5, noise_um=0.0)
    observation, _ = env.reset(seed=0)
    observation, *_, info = env.step(act(0.3))
    assert env.layout.measured_um(observation) == pytest.approx(
        0.5 * round(info["displacement_um"] / 0.5), abs=1e-5
    )


def test_noise_and_randomisation_leave_the_references_alone():
    plain = PiezoTrackingEnv(reference=["sine", "multisine", "triangle"])
    other = PiezoTrackingEnv(
        reference=["sine", "multisine", "triangle"], noise_um=0.1, randomise=0.2
    )
    for episode in range(6):
        seed = 0 if episode == 0 else None
        plain.reset(seed=seed)
        other.reset(seed=seed)
        one, two = follow(plain, [0.0] * 20)[3], follow(other, [0.0] * 20)[3]
        assert one["reference_um"] == two["reference_um"]


def test_frequencies_are_drawn_log_uniformly_within_their_bounds():
    env = PiezoTrackingEnv(frequency_hz=(1.0, 100.0))
    drawn = []
    for episode in range(400):
        env.reset(seed=0 if episode == 0 else None)
        drawn.append(env.signal.frequency_hz)
    assert 1.0 <= min(drawn) <= max(drawn) <= 100.0
    # Half of the draws of a log-uniform law lie below the geometric mean: 200 with deviation 10.
    assert abs(np.sum(np.array(drawn) < 10.0) - 200) < 50


def test_every_reference_of_a_sequence_comes_up_and_random_ones_differ():
    env = PiezoTrackingEnv(reference=["sine", {"signal": "multisine", "lines": 4}])
    seen = []
    for episode in range(40):
        env.reset(seed=1 if episode == 0 else None)
        seen.append(env.signal)
    assert {signal.name for signal in seen} == {"sine", "multisine"}
    seeds = [signal.seed for signal in seen if signal.name == "multisine"]
    assert len(set(seeds)) == len(seeds)


def test_dictionaries_keep_what_they_say_and_signals_stay_as_they_are():
    env = PiezoTrackingEnv(
        reference={"signal": "triangle", "amplitude_um": 3.0, "frequency_hz": 4.0},
        smooth_start_s=0.0,
    )
    env.reset(seed=0)
    assert env.signal == make_signal("triangle", amplitude_um=3.0, frequency_hz=4.0)
    recorded = Measured(times_s=[0.0, 1.0], values_um=[0.0, 20.0])
    env.reset(options={"reference": recorded})
    assert env.signal is recorded
    env.reset(options={"reference": {"signal": "measured", "times_s": [0, 1], "values_um": [0, 9]}})
    assert env.signal(1.0) == 9.0


def test_options_fix_the_episode_and_only_that_one():
    env = PiezoTrackingEnv(plant="P5", randomise=0.1, smooth_start_s=0.0)
    env.reset(seed=0, options={"reference": "triangle", "frequency_hz": 33.0, "delta2_s": 0.0})
    assert env.signal == make_signal("triangle", amplitude_um=10.0, frequency_hz=33.0)
    assert env.truth.hysteresis == env.nominal.hysteresis.static()
    weights = np.array(env.nominal.hysteresis.weights) * 1.5
    env.reset(options={"weights": weights, "plant": "P5"})
    assert env.truth.hysteresis.weights == tuple(weights)
    env.reset(options={"plant": "P10"})
    assert env.truth.hysteresis.n == 10
    assert env.layout.command_range_V == (-25.0, 25.0)
    env.reset()
    assert env.truth.hysteresis.n == 5
    assert env.signal.name == "sine"


def test_a_plant_without_hysteresis_is_tracked_exactly():
    linear = PlantModel(RDPI((2.0,), (), 0.0), "linear", (-10.0, 10.0), (0.0, 10.0))
    env = gym.make("rdpi_gym/PiezoTracking-v0", plant=linear, frequency_hz=50.0)
    layout = env.unwrapped.layout
    observation, _ = env.reset(seed=0)
    for _ in range(300):
        command = layout.reference_um(observation)[1] / 2.0
        observation, reward, *_ = env.step(layout.action_for(command, observation))
        assert reward > -1e-6  # the action is float32
