"""Gymnasium's own vector wrappers run on the native vector environment."""

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers

import rdpi_gym  # noqa: F401  # registers the environments
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from tests.looping import over

LANES, LENGTH = 3, 6
MODES = [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED]


def lanes(mode=AutoresetMode.SAME_STEP, **keywords):
    env = gym.make_vec(
        "rdpi_gym/PiezoTracking-v0",
        num_envs=LANES,
        vectorization_mode="vector_entry_point",
        autoreset_mode=mode,
        max_episode_steps=LENGTH,
        randomise=0.1,
        noise_um=0.01,
        **keywords,
    )
    assert isinstance(env.unwrapped, PiezoTrackingVectorEnv)
    return env


def drawn(steps, low=-1.0, high=1.0):
    rng = np.random.default_rng(0)
    return rng.uniform(low, high, (steps, LANES, 1)).astype(np.float32)


def run(env, actions, seed=0):
    """Step through, and collect observations, rewards and the last infos."""
    observation, _ = env.reset(seed=seed)
    observations, rewards = [observation], []
    for action in actions:
        observation, reward, _, _, infos = env.step(action)
        observations.append(observation)
        rewards.append(reward)
    return np.array(observations), np.array(rewards), infos


@over("mode", MODES)
def test_episode_statistics_are_those_of_each_lanes_episodes(mode):
    env = wrappers.RecordEpisodeStatistics(lanes(mode))
    env.reset(seed=0)
    actions, total, taken, ended = drawn(3 * LENGTH), np.zeros(LANES), np.zeros(LANES), 0
    begins = np.zeros(LANES, dtype=bool)
    for action in actions:
        if mode is AutoresetMode.DISABLED and begins.any():
            env.reset(options={"reset_mask": begins})
        _, reward, terminated, truncated, infos = env.step(action)
        counts = ~begins if mode is AutoresetMode.NEXT_STEP else np.ones(LANES, dtype=bool)
        total += np.where(counts, reward, 0.0)
        taken += counts
        begins = terminated | truncated
        assert ("episode" in infos) == begins.any()
        if begins.any():
            ended += 1
            np.testing.assert_allclose(infos["episode"]["r"][begins], total[begins], rtol=1e-5)
            np.testing.assert_array_equal(infos["episode"]["l"][begins], taken[begins])
            np.testing.assert_array_equal(infos["_episode"], begins)
            total[begins], taken[begins] = 0.0, 0
    assert ended >= 2
    assert env.episode_count == ended * LANES
    assert list(env.length_queue) == [LENGTH] * (ended * LANES)


def test_lanes_that_are_reset_apart_have_statistics_of_their_own():
    env = wrappers.RecordEpisodeStatistics(lanes(AutoresetMode.DISABLED))
    env.reset(seed=0)
    still = np.zeros((LANES, 1), dtype=np.float32)
    env.step(still)
    env.step(still)
    env.reset(options={"reset_mask": np.array([True, False, False])})
    for k in range(LENGTH - 2):
        _, _, _, truncated, infos = env.step(still)
        assert truncated.any() == (k == LENGTH - 3)
    np.testing.assert_array_equal(truncated, [False, True, True])
    np.testing.assert_array_equal(infos["episode"]["l"], [0, LENGTH, LENGTH])


def test_observations_are_normalised_by_the_statistics_of_all_that_was_shown():
    actions = drawn(LENGTH)
    plain, *_ = run(lanes(AutoresetMode.NEXT_STEP), actions)
    env = wrappers.NormalizeObservation(lanes(AutoresetMode.NEXT_STEP))
    normalised, *_ = run(env, actions)
    shown = plain.reshape(-1, plain.shape[-1]).astype(np.float64)
    # Gymnasium counts 1e-4 of a sample of mean 0 and variance 1 before the first
    np.testing.assert_allclose(env.obs_rms.mean, shown.mean(axis=0), atol=1e-4)
    np.testing.assert_allclose(env.obs_rms.var, shown.var(axis=0), atol=1e-4)
    expected = (plain[-1] - env.obs_rms.mean) / np.sqrt(env.obs_rms.var + env.epsilon)
    np.testing.assert_allclose(normalised[-1], expected, rtol=1e-3, atol=1e-4)


def test_normalised_rewards_are_rewards_by_one_positive_factor_a_step():
    actions = drawn(20)
    _, plain, _ = run(lanes(), actions)
    _, normal, _ = run(wrappers.NormalizeReward(lanes(), gamma=0.9), actions)
    factor = normal / plain
    np.testing.assert_allclose(factor, np.repeat(factor[:, :1], LANES, axis=1), rtol=1e-5)
    assert (factor > 0).all()


def test_clipped_rewards():
    actions = drawn(20)
    _, plain, _ = run(lanes(), actions)
    _, clipped, _ = run(wrappers.ClipReward(lanes(), -0.2, 0.0), actions)
    np.testing.assert_array_equal(clipped, np.clip(plain, -0.2, 0.0))
    assert (plain < -0.2).any()
    assert (plain > -0.2).any()


def test_rescaled_actions_reach_the_same_commands():
    actions = drawn(10)
    _, _, plain = run(lanes(), actions)
    wide = wrappers.RescaleAction(
        lanes(), np.full(1, -80.0, np.float32), np.full(1, 80.0, np.float32)
    )
    assert (wide.single_action_space.low, wide.single_action_space.high) == (-80.0, 80.0)
    _, _, rescaled = run(wide, actions * np.float32(80.0))
    np.testing.assert_allclose(rescaled["command_V"], plain["command_V"], atol=1e-4)


def test_clipped_actions_are_not_counted_as_saturated():
    actions = np.full((3, LANES, 1), 7.0, dtype=np.float32)
    _, _, plain = run(lanes(), actions)
    _, _, clipped = run(wrappers.ClipAction(lanes()), actions)
    np.testing.assert_array_equal(clipped["command_V"], plain["command_V"])
    np.testing.assert_array_equal(plain["saturated"], 3)
    np.testing.assert_array_equal(clipped["saturated"], 0)


@over("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED])
def test_observations_are_flattened_reshaped_transformed_and_of_another_type(mode):
    actions = drawn(LENGTH)
    plain, *_ = run(lanes(mode), actions)
    flat, *_ = run(wrappers.FlattenObservation(lanes(mode)), actions)
    np.testing.assert_array_equal(flat, plain)
    column, *_ = run(wrappers.ReshapeObservation(lanes(mode), (11, 1)), actions)
    np.testing.assert_array_equal(column, plain[..., None])
    doubled, *_ = run(wrappers.TransformObservation(lanes(mode), lambda x: 2.0 * x), actions)
    np.testing.assert_array_equal(doubled, 2.0 * plain)
    env = wrappers.DtypeObservation(lanes(mode), np.float64)
    precise, *_ = run(env, actions)
    assert precise.dtype == env.single_observation_space.dtype == np.float64
    np.testing.assert_array_equal(precise, plain)


def test_infos_as_a_list_of_dictionaries():
    env = wrappers.DictInfoToList(lanes(AutoresetMode.NEXT_STEP))
    _, infos = env.reset(seed=0)
    assert [info["displacement_um"] for info in infos] == [0.0] * LANES
    *_, infos = env.step(np.full((LANES, 1), 0.1, dtype=np.float32))
    np.testing.assert_allclose([info["command_V"] for info in infos], 8.0, rtol=1e-6)


def test_a_stack_of_them_with_the_packages_own():
    from rdpi_gym.envs.wrappers.history import VectorHistoryObservation
    from rdpi_gym.envs.wrappers.scaling import VectorScaledObservation

    own = VectorScaledObservation(VectorHistoryObservation(lanes(preview=2), 2))
    env = wrappers.RecordEpisodeStatistics(
        wrappers.ClipReward(wrappers.NormalizeReward(own), -10.0, 10.0)
    )
    observations, rewards, infos = run(env, drawn(2 * LENGTH))
    assert observations.shape == (2 * LENGTH + 1, LANES, 11)
    assert np.isfinite(observations).all()
    np.testing.assert_allclose(infos["episode"]["r"], rewards[LENGTH:].sum(axis=0), rtol=1e-5)
