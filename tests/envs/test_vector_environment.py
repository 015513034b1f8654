"""The vector environment among the ecosystem's tools: registry, spaces, memory, wrappers, threads."""

import pickle
import subprocess
import sys
import warnings

import gymnasium as gym
import numba
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

import rdpi_gym  # noqa: F401  # registers the environments
from rdpi_gym.envs.unit_box import UnitBoxes
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from tests.looping import over

IDS = sorted(name for name in gym.registry if name.startswith("rdpi_gym/"))


def arrays(value):
    """Yield every array of what a reset or a step returned."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, dict | tuple):
        for part in value.values() if isinstance(value, dict) else value:
            yield from arrays(part)


def run(envs, steps=30, seed=0):
    """Return the observations, rewards and infos of some steps, one below the other."""
    envs.reset(seed=seed)
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(steps):
        action = rng.uniform(-1, 1, (envs.num_envs, 1)).astype(np.float32)
        observation, reward, _, _, info = envs.step(action)
        rows.append(np.column_stack([observation, reward, info["displacement_um"]]))
    return np.array(rows)


@over("name", IDS)
def test_every_id_has_a_native_vector(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        envs = gym.make_vec(name, num_envs=3, autoreset_mode="SameStep")
    assert isinstance(envs.unwrapped, PiezoTrackingVectorEnv)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert PiezoTrackingVectorEnv.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert envs.spec.max_episode_steps == gym.spec(name).max_episode_steps
    np.testing.assert_array_equal(run(gym.make_vec(envs.spec)), run(envs))
    assert type(envs.spec).from_json(envs.spec.to_json()).kwargs["num_envs"] == 3


def test_spaces_are_batches_of_the_single_ones():
    single = gym.make("rdpi_gym/PiezoTracking-v0", preview=3)
    envs = PiezoTrackingVectorEnv(4, preview=3)
    assert envs.single_observation_space == single.observation_space
    assert envs.single_action_space == single.action_space
    assert envs.observation_space == batch_space(single.observation_space, 4)
    assert envs.action_space == batch_space(single.action_space, 4)
    observation, _ = envs.reset(seed=0)
    assert observation in envs.observation_space
    observation, reward, *_ = envs.step(envs.action_space.sample())
    assert observation in envs.observation_space
    assert reward.dtype == np.float64


def test_the_action_space_is_uniform_and_seeded():
    ours = UnitBoxes(1001, seed=7)
    drawn = np.array([ours.sample() for _ in range(100)])
    assert all(sample in ours for sample in drawn)
    again = UnitBoxes(1001, seed=7)
    np.testing.assert_array_equal(again.sample(), drawn[0])
    assert pickle.loads(pickle.dumps(ours)) == Box(-1.0, 1.0, (1001, 1), np.float32)
    counts, _ = np.histogram(drawn, bins=20, range=(-1.0, 1.0))
    # 5005 in each with a deviation of 69.
    assert np.abs(counts - drawn.size / 20).max() < 5 * 69
    assert abs(np.corrcoef(drawn[:-1].ravel(), drawn[1:].ravel())[0, 1]) < 0.02
    with pytest.raises(gym.error.Error, match="mask"):
        ours.sample(mask=np.ones(1001))


def test_the_action_space_takes_any_generator():
    space, again = (UnitBoxes(3, np.random.Generator(np.random.MT19937(0))) for _ in range(2))
    drawn = space.sample()
    assert drawn in space
    np.testing.assert_array_equal(again.sample(), drawn)


def test_an_action_is_drawn_by_splitmix64():
    word, mask = int(UnitBoxes(2, seed=3).np_random.bit_generator.random_raw()), 2**64 - 1
    for action in UnitBoxes(2, seed=3).sample()[:, 0]:
        z = (word ^ (word >> 30)) * 0xBF58476D1CE4E5B9 & mask
        z = (z ^ (z >> 27)) * 0x94D049BB133111EB & mask
        assert action == ((z ^ (z >> 31)) >> 40) * 2.0**-23 - 1.0
        word = word + 0x9E3779B97F4A7C15 & mask


@over("mode", ["SameStep", "NextStep"])
def test_what_is_returned_belongs_to_the_caller(mode):
    """Written over at once, it changes nothing that comes later."""
    keywords = {"max_episode_steps": 5, "autoreset_mode": mode, "noise_um": 0.1}
    spoiled, kept = (PiezoTrackingVectorEnv(3, **keywords) for _ in range(2))
    for array in arrays(spoiled.reset(seed=0)):
        array[...] = 0
    kept.reset(seed=0)
    action, held = np.full((3, 1), 0.4, dtype=np.float32), []
    for _ in range(12):
        ours, theirs = spoiled.step(action.copy()), kept.step(action)
        np.testing.assert_array_equal(ours[0], theirs[0])
        for array in arrays(ours):
            assert not any(np.shares_memory(array, other) for other in held)
            held.append(array)
            array[...] = 0
    mask = np.array([True, False, True])
    observation, _ = spoiled.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(observation, kept.reset(options={"reset_mask": mask})[0])


def test_lanes_that_are_not_reset_show_what_they_showed_last():
    """At every place to which observations slide (64 of them), in two blocks of lanes."""
    envs = PiezoTrackingVectorEnv(500, randomise=0.1)
    envs.reset(seed=0)
    mask = np.arange(500) % 7 == 0
    action = np.full((500, 1), 0.2, dtype=np.float32)
    for _ in range(130):
        last = envs.step(action)[0]
        found, _ = envs.reset(options={"reset_mask": mask})
        np.testing.assert_array_equal(found[~mask], last[~mask])
        assert (found[mask, -1] != last[mask, -1]).all()  # the command rests again


@pytest.mark.slow
def test_threads_change_no_bit():
    """1100 lanes are three blocks: one, two or three threads, which take them differently."""
    keywords = {"randomise": 0.3, "noise_um": 0.01, "max_episode_steps": 20}
    found = []
    for threads in (1, 2, 3, 99):
        envs = PiezoTrackingVectorEnv(1100, threads=threads, **keywords)
        assert envs.threads == min(threads, 3)
        found.append(run(envs))
    for other in found[1:]:
        np.testing.assert_array_equal(other, found[0])


def test_threads_are_as_many_as_there_are_lanes_for():
    assert PiezoTrackingVectorEnv(4095).threads == 1
    assert PiezoTrackingVectorEnv(4096).threads == min(2, numba.get_num_threads())


def test_a_lane_does_not_depend_on_how_many_there_are():
    few, many = (run(PiezoTrackingVectorEnv(n, randomise=0.3, frequency_hz=50.0)) for n in (3, 600))
    # run() draws other actions for other numbers of lanes: the first observation is compared.
    np.testing.assert_allclose(few[0][:, :8], many[0][:3, :8], rtol=0, atol=1e-6)


def test_pickled_mid_episode_continues_alike():
    envs = PiezoTrackingVectorEnv(
        3, randomise=0.1, noise_um=0.1, reference=["sine", "triangle"], max_episode_steps=40
    )
    run(envs)
    twin = pickle.loads(pickle.dumps(envs))
    action = np.full((3, 1), -0.3, dtype=np.float32)
    for _ in range(30):
        ours, theirs = envs.step(action), twin.step(action)
        for one, other in zip(arrays(ours), arrays(theirs), strict=True):
            np.testing.assert_array_equal(one, other)


def test_frames_of_every_lane():
    envs = PiezoTrackingVectorEnv(2, render_mode="rgb_array", max_episode_steps=15)
    single = gym.make("rdpi_gym/PiezoTracking-v0", render_mode="rgb_array", max_episode_steps=15)
    envs.reset(seed=4)
    single.reset(seed=4)
    for k in range(12):
        envs.step(np.full((2, 1), 0.02 * k, dtype=np.float32))
        single.step(np.full(1, 0.02 * k, dtype=np.float32))
    frames = envs.render()
    assert [(frame.shape, frame.dtype.name) for frame in frames] == [((480, 960, 3), "uint8")] * 2
    below_title = np.s_[60:]
    np.testing.assert_array_equal(frames[0][below_title], single.render()[below_title])
    assert np.any(frames[0] != frames[1])
    with pytest.warns(UserWarning, match="no render_mode"):
        assert PiezoTrackingVectorEnv(2).render() is None


def test_pickled_lanes_go_on_in_another_process(tmp_path):
    """Kernels lie at other addresses there."""
    envs = gym.make_vec("rdpi_gym/PiezoStage-v0", num_envs=2).unwrapped
    envs.reset(seed=1)
    action = np.full((2, 1), 0.3, dtype=np.float32)
    envs.step(action)
    (tmp_path / "lanes").write_bytes(pickle.dumps((envs, action)))
    code = (
        "import pickle, sys; envs, action = pickle.loads(open(sys.argv[1], 'rb').read()); "
        "print(envs.step(action)[0].tobytes().hex())"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "lanes"], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == envs.step(action)[0].tobytes().hex()
