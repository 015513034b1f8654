"""What was shown before: the same law in one environment, in lanes of them, and in any autoreset."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from hypothesis import given
from hypothesis import strategies as st

import rdpi_gym  # noqa: F401  # registers the environments
from rdpi_gym.envs import ObservationLayout, PiezoTrackingEnv
from rdpi_gym.envs.wrappers.history import History, HistoryObservation, VectorHistoryObservation
from rdpi_gym.envs.wrappers.scaling import ScaledObservation, Scaling, VectorScaledObservation
from rdpi_gym.plant import named_plant
from rdpi_gym.support.errors import InputError
from tests.looping import over

ID = "rdpi_gym/PiezoTracking-v0"
SAME, NEXT, NEVER = AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED
WAYS = ["sync", "vector_entry_point"]
OPTIONS = {"preview": 2, "randomise": 0.1, "noise_um": 0.02}


def layout(preview=2):
    return ObservationLayout.for_plant(named_plant("P10"), ts_s=1e-4, preview=preview)


def lanes(way, mode, count=3, length=9):
    reset = (
        {"vector_kwargs": {"autoreset_mode": mode}} if way == "sync" else {"autoreset_mode": mode}
    )
    return gym.make_vec(
        ID, num_envs=count, vectorization_mode=way, max_episode_steps=length, **reset, **OPTIONS
    )


def wrapped(env, history=4):
    return ScaledObservation(HistoryObservation(env, history))


def vector_wrapped(env, history=4):
    return VectorScaledObservation(VectorHistoryObservation(env, history))


def actions(steps, count=3):
    rng = np.random.default_rng(1)
    return rng.uniform(-0.5, 0.5, (steps, count, 1)).astype(np.float32)


@given(steps=st.integers(0, 5), preview=st.integers(1, 4), seed=st.integers(0, 99))
def test_a_stacked_observation_holds_reference_reading_and_command_of_the_samples_before(
    steps, preview, seed
):
    history = History(layout(preview), steps)
    shown = np.random.default_rng(seed).normal(size=(9, 2, preview + 3)).astype(np.float32)
    past = history.begin(shown[0])
    for k in range(9):
        stacked = history.stack(shown[k], past)
        assert stacked.shape == (2, history.size)
        np.testing.assert_array_equal(stacked[:, : preview + 3], shown[k])
        for j in range(1, steps + 1):
            before = shown[max(k - j, 0)][:, [0, preview + 1, preview + 2]]
            at = preview + 3 * j
            np.testing.assert_array_equal(stacked[:, at : at + 3], before)
        past = history.past(shown[k], past)


@given(steps=st.integers(0, 6), preview=st.integers(1, 9))
def test_scaling_loses_nothing(steps, preview):
    scaling = Scaling(History(layout(preview), steps))
    assert np.linalg.matrix_rank(scaling.matrix) == len(scaling.matrix)


def test_scaled_errors_and_increments_are_in_their_units():
    ts_s, hz = 1e-4, 100.0
    scaling = Scaling(History(layout(preview=3), 2), frequency_hz=hz, error=0.01)
    k = np.arange(-2, 4)
    r = np.sin(2 * np.pi * hz * ts_s * k)
    measured, command = r - 0.01 * (k + 3), 0.4 * r
    shown = np.concatenate([r[2:6], [measured[2], command[2]]])
    past = np.ravel([[r[i], measured[i], command[i]] for i in (1, 0)])
    (scaled,) = scaling(np.concatenate([shown, past])[None].astype(np.float32))
    moved = np.diff(r) / (2 * np.pi * hz * ts_s)
    expected = [r[2], *moved[2:], moved[1], moved[0], 3.0, 2.0, 1.0, command[2]]
    np.testing.assert_allclose(scaled, [*expected, 0.4 * moved[1], 0.4 * moved[0]], atol=1e-5)
    assert np.abs(moved).max() == pytest.approx(1.0, abs=1e-3)


@over("way", WAYS)
def test_a_lane_sees_what_the_single_environment_sees_with_same_step_autoreset(way):
    vector = vector_wrapped(lanes(way, SAME))
    singles = [wrapped(gym.make(ID, max_episode_steps=9, **OPTIONS)) for _ in range(3)]
    observation, _ = vector.reset(seed=3)
    expected = [single.reset(seed=3 + i)[0] for i, single in enumerate(singles)]
    np.testing.assert_allclose(observation, expected, atol=1e-5)
    for action in actions(30):
        observation, _, terminated, truncated, infos = vector.step(action)
        for i, single in enumerate(singles):
            shown, _, _, over, _ = single.step(action[i])
            assert over == (terminated[i] or truncated[i])
            if over:
                np.testing.assert_allclose(infos["final_obs"][i], shown, atol=1e-5)
                shown, _ = single.reset()
            np.testing.assert_allclose(observation[i], shown, atol=1e-5)
        assert vector.observation_space.contains(observation)


@over("way", WAYS)
def test_with_next_step_autoreset_the_past_begins_a_step_after_the_end(way):
    vector = vector_wrapped(lanes(way, NEXT))
    singles = [wrapped(gym.make(ID, max_episode_steps=9, **OPTIONS)) for _ in range(3)]
    vector.reset(seed=3)
    for i, single in enumerate(singles):
        single.reset(seed=3 + i)
    over = np.zeros(3, dtype=bool)
    for action in actions(30):
        observation, _, terminated, truncated, _ = vector.step(action)
        for i, single in enumerate(singles):
            shown = single.reset()[0] if over[i] else single.step(action[i])[0]
            np.testing.assert_allclose(observation[i], shown, atol=1e-5)
        over = terminated | truncated


@over("way", WAYS)
def test_without_autoreset_only_the_lanes_of_the_mask_begin_anew(way):
    vector = VectorHistoryObservation(lanes(way, NEVER, length=100), 4)
    vector.reset(seed=0)
    for action in actions(6):
        before, *_ = vector.step(action)
    mask = np.array([False, True, False])
    observation, _ = vector.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(observation[~mask], before[~mask])
    first = observation[1]
    np.testing.assert_array_equal(first[5:], np.tile(first[[0, 3, 4]], 4))
    after, *_ = vector.step(actions(1)[0])
    np.testing.assert_array_equal(after[0, 5:8], before[0, [0, 3, 4]])
    np.testing.assert_array_equal(after[1, 5:8], first[[0, 3, 4]])


def test_observations_are_the_callers_own():
    env = wrapped(PiezoTrackingEnv(**OPTIONS))
    expected = wrapped(PiezoTrackingEnv(**OPTIONS))
    observation, _ = env.reset(seed=0)
    expected.reset(seed=0)
    for action in actions(6, 1):
        observation[:] = 7.0
        observation, *_ = env.step(action[0])
        np.testing.assert_array_equal(observation, expected.step(action[0])[0])


@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version")
def test_gymnasiums_checker_accepts_both_and_a_spec_remakes_them():
    check_env(wrapped(PiezoTrackingEnv(**OPTIONS)), skip_render_check=True)
    env = wrapped(gym.make(ID, **OPTIONS))
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert again.observation_space == env.observation_space
    np.testing.assert_array_equal(env.reset(seed=1)[0], again.reset(seed=1)[0])


@over("steps", [-1, 1.5])
def test_a_history_that_is_no_number_of_samples_is_refused(steps):
    with pytest.raises(InputError, match="history"):
        HistoryObservation(PiezoTrackingEnv(), steps)


@over("units", [{"error": 0.0}, {"frequency_hz": float("nan")}])
def test_a_unit_that_is_not_above_zero_is_refused(units):
    with pytest.raises(InputError, match=next(iter(units))):
        ScaledObservation(PiezoTrackingEnv(), **units)


def test_another_environment_is_refused():
    with pytest.raises(InputError, match="layout"):
        HistoryObservation(gym.make("CartPole-v1"), 3)
