"""Bad input: one line that says what is wrong and what would be right."""

import gymnasium as gym
import numpy as np
import pytest

from rdpi_gym.envs import PiezoTrackingEnv
from rdpi_gym.support.errors import InputError
from tests.looping import over


def refused(call, *args, **keywords):
    """Return the line with which a call is refused."""
    with pytest.raises(InputError) as caught:
        call(*args, **keywords)
    line = str(caught.value)
    assert "\n" not in line
    return line


@over(
    "keywords, expected",
    [
        ({"plant": "P7"}, "'P7' is neither a plant file nor one of P5"),
        ({"plant": 5}, "plant is 5; give the name"),
        ({"plant": {"name": "x"}}, "needs the keys hysteresis"),
        ({"ts_s": 0.0}, "ts_s is 0.0; give a sampling time above 0 s"),
        ({"ts_s": -1e-4}, "ts_s is -0.0001"),
        ({"ts_s": float("nan")}, "ts_s is nan"),
        ({"plant": "P5-bench", "ts_s": 3e-5}, "does not divide the converter period"),
        ({"rate_bandwidth_hz": 0.0}, "rate_bandwidth_hz is 0.0"),
        ({"reference": "sin"}, "reference 'sin' names no signal; the signals are "),
        ({"reference": []}, "reference is empty"),
        ({"reference": 3}, "reference 3 is int"),
        ({"reference": ["sine", None]}, "reference None is NoneType"),
        ({"reference": {"frequency_hz": 3.0}}, "names no signal"),
        ({"reference": {"signal": "sine", "frequency": 3.0}}, "unknown field 'frequency'"),
        ({"frequency_hz": 0.0}, "frequency_hz is 0.0"),
        ({"frequency_hz": (100.0, 1.0)}, r"frequency_hz is (100.0, 1.0)"),
        ({"frequency_hz": (1.0, 2.0, 3.0)}, "or the lowest and the highest"),
        ({"frequency_hz": "fast"}, "frequency_hz is 'fast'"),
        ({"amplitude_um": 0.0}, "scale_um is 0.0"),
        ({"offset_um": float("inf")}, "centre_um is inf"),
        ({"smooth_start_s": -1.0}, "smooth_start_s is -1.0"),
        ({"preview": 0}, "preview is 0"),
        ({"preview": 2.5}, "preview is 2.5"),
        ({"action": "voltage"}, "action 'voltage' is unknown; choose command, increment"),
        ({"action_scale_V": 0.0}, "action_scale_V is 0.0"),
        ({"action": "correction"}, "action is 'correction' and baseline is None"),
        ({"baseline": "pi"}, "action is 'command' and baseline is 'pi'"),
        ({"belief": "P7"}, "'P7' is neither a plant file"),
        ({"noise_um": -1.0}, "sensor noise_um is -1.0"),
        ({"resolution_um": float("nan")}, "sensor resolution_um is nan"),
        ({"randomise": 1.0}, "randomise is 1.0"),
        ({"randomise": -0.1}, "randomise is -0.1"),
        ({"command_cost": -1.0}, "command_cost is -1.0"),
        ({"render_mode": "ansi"}, "render_mode is 'ansi'; give 'rgb_array' or None"),
    ],
)
def test_keywords(keywords, expected):
    def make_and_reset():
        PiezoTrackingEnv(**keywords).reset(seed=0)

    assert expected in refused(make_and_reset)


@over(
    "options, expected",
    [
        ({"frequency": 3.0}, "reset has no option 'frequency'; it has reference, frequency_hz"),
        ({"reference": "sin"}, "names no signal"),
        ({"frequency_hz": -3.0}, "frequency_hz is -3.0"),
        ({"plant": "P7"}, "'P7' is neither"),
        ({"weights": [0.0, 1.0]}, "a_0 is 0.0"),
        ({"weights": [1.0, 1.0]}, "10 thresholds for 1 play weights"),
        ({"thresholds_V": [2.0] * 10}, "thresholds increase"),
        ({"delta2_s": "long"}, "delta2_s is 'long'; expected a number"),
        ({"weights": [100.0] * 11}, "what can be shown ends at"),
        ({"reference": {"signal": "sine", "amplitude_um": 1e4}}, "give it a smaller amplitude_um"),
    ],
)
def test_options_leave_the_environment_usable(options, expected):
    env = PiezoTrackingEnv()
    assert expected in refused(env.reset, seed=0, options=options)
    observation, _ = env.reset(seed=0)
    fresh, _ = PiezoTrackingEnv().reset(seed=0)
    np.testing.assert_array_equal(observation, fresh)


@over(
    "action, expected",
    [
        (np.array([np.nan], dtype=np.float32), "action is nan; give a finite number of -1 to 1"),
        (np.array([np.inf], dtype=np.float32), "action is inf"),
        (np.array([-np.inf], dtype=np.float32), "action is -inf"),
        (np.zeros(2, dtype=np.float32), "give a numpy array of shape (1,)"),
        (np.zeros((1, 1), dtype=np.float32), "give a numpy array of shape (1,)"),
        (np.zeros(0, dtype=np.float32), "give a numpy array of shape (1,)"),
        (np.float32(0.0), "give a numpy array of shape (1,)"),
        (0.5, "give a numpy array of shape (1,)"),
        ("up", "give a numpy array of shape (1,)"),
    ],
)
def test_actions_leave_the_episode_as_it_was(action, expected):
    env, untouched = PiezoTrackingEnv(), PiezoTrackingEnv()
    env.reset(seed=0)
    untouched.reset(seed=0)
    assert expected in refused(env.step, action)
    good = np.array([0.5], dtype=np.float32)
    assert env.step(good)[4] == untouched.step(good)[4]


def test_step_before_reset():
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        PiezoTrackingEnv().step(np.zeros(1, dtype=np.float32))
