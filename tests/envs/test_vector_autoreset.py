"""Autoreset, seeds and masks as Gymnasium's own vector of single environments has them."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

import rdpi_gym  # noqa: F401  # registers the environments
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.plant import named_plant
from rdpi_gym.plant.effects import CATALOGUE
from tests.looping import over

NAME = "rdpi_gym/PiezoTracking-v0"
LANES, EPISODE = 5, 8
KEYWORDS = {
    "plant": replace(
        named_plant("P10"), effects=tuple(CATALOGUE[name]() for name in ("creep", "delay"))
    ),
    "randomise": 0.2,
    "randomise_effects": 0.2,
    "noise_um": 0.02,
    "reference": ["sine", "triangle"],
    "max_episode_steps": EPISODE,
}


def pair(mode, **keywords):
    """Return lanes of this package and Gymnasium's, with the same options."""
    keywords = KEYWORDS | keywords
    ours = gym.make_vec(NAME, num_envs=LANES, autoreset_mode=mode, **keywords)
    theirs = gym.make_vec(
        NAME,
        num_envs=LANES,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        **keywords,
    )
    return ours, theirs


def assert_alike(ours, theirs):
    """Compare what two resets or steps returned: arrays, objects, nested infos, masks."""
    if isinstance(theirs, dict):
        assert ours.keys() == theirs.keys()
        for key in theirs:
            assert_alike(ours[key], theirs[key])
    elif isinstance(theirs, tuple):
        assert len(ours) == len(theirs)
        for one, other in zip(ours, theirs, strict=True):
            assert_alike(one, other)
    elif isinstance(theirs, np.ndarray):
        assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape)
        if theirs.dtype == object:
            for one, other in zip(ours, theirs, strict=True):
                assert (one is None) == (other is None)
                if other is not None:
                    assert_alike(one, other)
        elif theirs.dtype == bool:
            np.testing.assert_array_equal(ours, theirs)
        else:
            tolerance = 1e-6 if theirs.dtype == np.float32 else 1e-10
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance)
    else:
        raise AssertionError(f"{type(theirs)} in what an environment returned")


@over("mode", list(AutoresetMode))
def test_all_that_is_returned_is_what_gymnasiums_vector_returns(mode):
    ours, theirs = pair(mode)
    assert ours.metadata["autoreset_mode"] is mode
    assert_alike(ours.reset(seed=3), theirs.reset(seed=3))
    rng = np.random.default_rng(0)
    for step in range(6 * EPISODE):
        action = rng.uniform(-1, 1, (LANES, 1)).astype(np.float32)
        shown = theirs.step(action)
        found = ours.step(action)
        assert_alike(found, shown)
        mask = shown[3].copy() if mode is AutoresetMode.DISABLED else np.zeros(LANES, dtype=bool)
        if step % 3 == 0:  # lanes come out of step with each other
            mask[rng.integers(LANES)] = True
        if mask.any():
            theirs_shown = theirs.reset(options={"reset_mask": mask})
            assert_alike(ours.reset(options={"reset_mask": mask}), theirs_shown)


def test_seeds_of_single_lanes():
    ours, theirs = pair(AutoresetMode.NEXT_STEP)
    seeds = [11, 2**64 - 1, 0, 5, 2**40]
    assert_alike(ours.reset(seed=seeds), theirs.reset(seed=seeds))
    # Those without a seed go on with the generators that they have.
    seeds = [None, 3, None, 3, None]
    mask = np.array([True, True, False, True, True])
    options = {"reset_mask": mask}
    shown = theirs.reset(seed=seeds, options=options.copy())
    assert_alike(ours.reset(seed=seeds, options=options), shown)
    assert options.keys() == {"reset_mask"}
    assert_alike(ours.reset(), theirs.reset())


def test_without_a_seed_episodes_differ_from_lane_to_lane_and_from_run_to_run():
    first, second = (PiezoTrackingVectorEnv(4, randomise=0.5) for _ in range(2))
    action = np.full((4, 1), 0.5, dtype=np.float32)
    displacements = []
    for envs in (first, second):
        envs.reset()
        displacements += envs.step(action)[4]["displacement_um"].tolist()
    assert len(set(displacements)) == 8


def test_options_of_a_reset_fix_the_episodes_of_its_lanes_only():
    ours, theirs = pair(AutoresetMode.NEXT_STEP, plant="P5")
    chosen = {"reference": "triangle", "frequency_hz": 40.0, "delta2_s": 0.0}
    assert_alike(ours.reset(seed=0, options=chosen), theirs.reset(seed=0, options=chosen))
    mask = np.array([False, True, True, False, False])
    for options in ({"plant": "P5-bench"}, {"reference": {"signal": "sine", "phase_rad": 1.0}}):
        both = options | {"reset_mask": mask}
        assert_alike(ours.reset(options=both), theirs.reset(options=both.copy()))
        for _ in range(2 * EPISODE):
            action = np.full((LANES, 1), 0.3, dtype=np.float32)
            assert_alike(ours.step(action), theirs.step(action))


def test_a_lane_that_waits_for_its_reset_is_not_stepped():
    envs = PiezoTrackingVectorEnv(3, max_episode_steps=2, autoreset_mode="Disabled")
    envs.reset(seed=0)
    action = np.zeros((3, 1), dtype=np.float32)
    envs.step(action)
    assert envs.step(action)[3].all()
    envs.reset(options={"reset_mask": np.array([True, False, True])})
    with pytest.raises(ResetNeeded, match="the episode of lane 1 has ended"):
        envs.step(action)
    envs.reset(options={"reset_mask": np.array([False, True, False])})
    assert not envs.step(action)[3].any()


def test_nothing_is_stepped_before_a_reset():
    envs = PiezoTrackingVectorEnv(2)
    with pytest.raises(ResetNeeded, match="reset"):
        envs.step(np.zeros((2, 1), dtype=np.float32))
    with pytest.raises(ResetNeeded, match="all lanes"):
        envs.reset(options={"reset_mask": np.array([True, False])})


def test_an_episode_without_a_limit_goes_on():
    envs = PiezoTrackingVectorEnv(2, max_episode_steps=None)
    envs.reset(seed=0)
    action = np.zeros((2, 1), dtype=np.float32)
    assert not any(envs.step(action)[3].any() for _ in range(2500))
