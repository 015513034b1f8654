"""The adapter: what Stable-Baselines3 sees is what the vector environment does."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import rdpi_gym  # noqa: F401  # registers the environments
from rdpi_gym.envs import PiezoTrackingEnv
from rdpi_gym.envs.wrappers.history import HistoryObservation, VectorHistoryObservation
from rdpi_gym.envs.wrappers.scaling import ScaledObservation, VectorScaledObservation
from rdpi_gym.support.errors import InputError

pytest.importorskip("stable_baselines3")

import stable_baselines3 as sb3
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecCheckNan, VecFrameStack, VecMonitor, VecNormalize

from rdpi_gym.envs.wrappers.stable_baselines import StableBaselinesVecEnv
from tests.looping import over

ID = "rdpi_gym/PiezoTracking-v0"
WAYS = ["sync", "vector_entry_point"]


def lanes(way="sync", count=3, length=20, mode=AutoresetMode.SAME_STEP, **keywords):
    if way == "sync":
        reset = {"vector_kwargs": {"autoreset_mode": mode}}
    else:
        reset = {"autoreset_mode": mode}
    keywords = {"randomise": 0.1, "noise_um": 0.01} | keywords
    return gym.make_vec(
        ID, num_envs=count, vectorization_mode=way, max_episode_steps=length, **reset, **keywords
    )


def adapted(way="sync", **keywords):
    return StableBaselinesVecEnv(lanes(way, **keywords))


def actions(count, steps, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.3, 0.3, (steps, count, 1)).astype(np.float32)


@over("way", WAYS)
def test_each_lane_is_the_single_environment_with_its_seed_across_an_episodes_end(way):
    env = adapted(way, length=20)
    singles = [gym.make(ID, randomise=0.1, noise_um=0.01, max_episode_steps=20) for _ in range(3)]
    assert list(env.seed(7)) == [7, 8, 9]
    first = [single.reset(seed=7 + i)[0] for i, single in enumerate(singles)]
    np.testing.assert_allclose(env.reset(), first, atol=1e-6)
    for k, action in enumerate(actions(3, 45), start=1):
        observation, reward, done, infos = env.step(action)
        assert reward.dtype == np.float32
        for i, single in enumerate(singles):
            expected, value, terminated, truncated, _ = single.step(action[i])
            assert reward[i] == pytest.approx(value, abs=1e-6)
            assert done[i] == (terminated or truncated) == (k % 20 == 0)
            if done[i]:
                last = infos[i]["terminal_observation"]
                np.testing.assert_allclose(last, expected, atol=1e-6)
                assert infos[i]["TimeLimit.truncated"] is True
                expected, _ = single.reset()
            else:
                assert infos[i] == {}
            np.testing.assert_allclose(observation[i], expected, atol=1e-6)


def test_what_a_caller_writes_into_an_info_is_not_there_at_the_next_step():
    env = adapted()
    env.reset()
    still = np.zeros((3, 1), dtype=np.float32)
    _, _, _, infos = env.step(still)
    infos[1]["mine"] = 1
    infos[2] = {"other": 2}
    assert env.step(still)[3] == [{}, {}, {}]
    assert infos[1] == {"mine": 1}


def test_the_last_observation_of_an_episode_is_the_callers_own():
    env = adapted(length=2)
    env.reset()
    still = np.zeros((3, 1), dtype=np.float32)
    env.step(still)
    observation, _, _, infos = env.step(still)
    kept = [info["terminal_observation"].copy() for info in infos]
    observation[:] = 9.0
    for _ in range(3):
        env.step(still)
    np.testing.assert_array_equal([info["terminal_observation"] for info in infos], kept)


@over("way", WAYS)
def test_chosen_infos_are_handed_on(way):
    env = StableBaselinesVecEnv(lanes(way, length=3), info_keys=["error_um", "command_V"])
    env.seed(0)
    env.reset()
    for k in range(1, 4):
        _, _, done, infos = env.step(np.full((3, 1), 0.1, dtype=np.float32))
        for info in infos:
            assert set(info) >= {"error_um", "command_V"}
            assert (k == 3) == bool(done[0]) == ("terminal_observation" in info)
            assert info["command_V"] == pytest.approx(8.0)  # of the episode's end, not of the next


@over("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED])
def test_another_way_of_autoreset_is_refused(mode):
    with pytest.raises(InputError, match=rf"{mode.name}; Stable-Baselines3 needs .*SAME_STEP"):
        StableBaselinesVecEnv(lanes(mode=mode))


@over("way", WAYS)
def test_an_action_that_is_not_finite_is_refused(way):
    env = adapted(way)
    env.reset()
    with pytest.raises(InputError, match="nan"):
        env.step(np.array([[0.0], [np.nan], [0.0]], dtype=np.float32))


def test_options_reach_every_lane_and_differing_ones_are_refused():
    env = StableBaselinesVecEnv(lanes(), info_keys=["displacement_um"])
    env.set_options({"plant": "P10", "frequency_hz": 50.0})
    env.reset()
    assert [truth.name for truth in env.get_attr("truth")] == ["P10"] * 3
    assert [s.frequency_hz for s in env.get_attr("signal")] == [50.0] * 3
    env.reset()  # options hold for one reset
    assert [s.frequency_hz for s in env.get_attr("signal")] != [50.0] * 3
    env.set_options([{"frequency_hz": 50.0}, {}, {}])
    with pytest.raises(InputError, match="different options"):
        env.reset()


def test_attributes_and_methods_of_lanes_that_are_environments():
    env = adapted(way="sync")
    env.reset()
    assert [layout.preview for layout in env.get_attr("layout")] == [8, 8, 8]
    assert len(env.get_attr("layout", indices=1)) == 1
    env.set_attr("mark", 5, indices=[0, 2])
    marks = [getattr(each.unwrapped, "mark", None) for each in env.vector_env.envs]
    held = [each.get_wrapper_attr("mark") for each in (env.vector_env.envs[i] for i in (0, 2))]
    assert held == [5, 5]
    assert marks[1] is None
    assert [value.shape for value in env.env_method("reset", seed=1, indices=[1])[0][:1]] == [(11,)]
    assert env.env_is_wrapped(gym.wrappers.TimeLimit) == [True] * 3
    assert env.env_is_wrapped(VectorHistoryObservation) == [False] * 3


def test_a_wrapper_around_all_lanes_is_found():
    env = StableBaselinesVecEnv(VectorHistoryObservation(lanes(), 2))
    assert env.env_is_wrapped(VectorHistoryObservation, indices=0) == [True]


def test_one_native_environment_answers_for_all_its_lanes():
    env = adapted("vector_entry_point")
    assert len(env.get_attr("layout")) == 3
    assert env.get_attr("render_mode") == [None] * 3
    env.set_attr("mark", 5)
    assert env.get_attr("mark", indices=[0, 1]) == [5, 5]
    assert env.env_is_wrapped(gym.wrappers.TimeLimit) == [False] * 3
    with pytest.raises(InputError, match="lanes"):
        env.set_attr("mark", 6, indices=1)


def test_frames_of_all_lanes_are_tiled():
    env = adapted(render_mode="rgb_array", count=2)
    env.reset()
    assert env.render_mode == "rgb_array"
    assert env.render().shape == (480 * 2, 960, 3)
    assert len(env.get_images()) == 2


@over("way", WAYS)
def test_its_own_wrappers_run_on_it(way):
    env = VecFrameStack(VecNormalize(VecCheckNan(VecMonitor(adapted(way, length=5)))), 2)
    env.seed(0)
    assert env.reset().shape == (3, 22)
    for _ in range(5):
        _, _, done, infos = env.step(np.zeros((3, 1), dtype=np.float32))
    assert done.all()
    assert [info["episode"]["l"] for info in infos] == [5, 5, 5]


def test_episodes_recorded_by_gymnasium_are_episodes_to_it():
    env = StableBaselinesVecEnv(gym.wrappers.vector.RecordEpisodeStatistics(lanes(length=4)))
    env.seed(0)
    env.reset()
    total = np.zeros(3)
    for _ in range(4):
        _, reward, _, infos = env.step(np.zeros((3, 1), dtype=np.float32))
        total += reward
    np.testing.assert_allclose([info["episode"]["r"] for info in infos], total, rtol=1e-5)
    assert [info["episode"]["l"] for info in infos] == [4, 4, 4]


def test_its_checker_accepts_the_wrapped_environment():
    check_env(ScaledObservation(HistoryObservation(PiezoTrackingEnv(preview=2), 3)))


SMALL = {
    "PPO": {"n_steps": 16, "batch_size": 24},
    "SAC": {"learning_starts": 10, "buffer_size": 500},
    "TD3": {"learning_starts": 10, "buffer_size": 500},
}


@pytest.mark.slow
@over("way", WAYS)
@over("name", SMALL)
def test_it_trains(name, way):
    stacked = VectorScaledObservation(VectorHistoryObservation(lanes(way), 2))
    env = VecMonitor(StableBaselinesVecEnv(stacked))
    options = {"policy_kwargs": {"net_arch": [8]}, "seed": 0, "device": "cpu"}
    model = getattr(sb3, name)("MlpPolicy", env, **SMALL[name], **options)
    before = [p.detach().clone() for p in model.policy.parameters()]
    model.learn(200)
    after = list(model.policy.parameters())
    assert all(bool(p.isfinite().all()) for p in after)
    assert any(not a.equal(b) for a, b in zip(after, before, strict=True))
    assert len(model.ep_info_buffer) >= 6
    mean, _ = evaluate_policy(model, env, 3)
    assert np.isfinite(mean)
    assert mean < 0.0


def test_off_policy_transitions_end_at_the_last_observation_of_the_episode():
    env = adapted(length=5)
    model = sb3.SAC("MlpPolicy", env, buffer_size=60, learning_starts=1000, seed=3, device="cpu")
    model.learn(30)
    buffer = model.replay_buffer
    np.testing.assert_array_equal(buffer.timeouts[:10, 0], np.tile([0, 0, 0, 0, 1], 2))
    going = buffer.timeouts[:9, 0] == 0
    same = (buffer.next_observations[:9, 0] == buffer.observations[1:10, 0]).all(axis=-1)
    np.testing.assert_array_equal(same, going)
