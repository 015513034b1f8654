"""Groups of lanes as one vector environment: each lane is what it is in its own group."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import rdpi_gym  # noqa: F401  # registers the environments
from rdpi_gym.envs.wrappers.history import VectorHistoryObservation
from rdpi_gym.envs.wrappers.side_by_side import SideBySideVectorEnv
from rdpi_gym.support.errors import InputError
from tests.looping import over

ID = "rdpi_gym/PiezoTracking-v0"
SAME, NEXT, NEVER = AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED


def group(plant="P10", count=2, length=7, mode=SAME, **keywords):
    return gym.make_vec(
        ID, num_envs=count, vectorization_mode="vector_entry_point", plant=plant,
        max_episode_steps=length, autoreset_mode=mode, randomise=0.1, noise_um=0.01, **keywords,
    )  # fmt: skip


@over("mode", [SAME, NEXT])
def test_each_lane_is_what_it_is_alone(mode):
    both = SideBySideVectorEnv([group("P10", 2, 7, mode), group("P10-static", 3, 5, mode)])
    alone = [group("P10", 2, 7, mode), group("P10-static", 3, 5, mode)]
    observation, infos = both.reset(seed=11)
    expected = [alone[0].reset(seed=11), alone[1].reset(seed=13)]
    np.testing.assert_array_equal(observation, np.concatenate([one[0] for one in expected]))
    rng = np.random.default_rng(0)
    for _ in range(20):
        actions = rng.uniform(-0.4, 0.4, (5, 1)).astype(np.float32)
        found = both.step(actions)
        parts = [alone[0].step(actions[:2]), alone[1].step(actions[2:])]
        for i in range(4):
            np.testing.assert_array_equal(found[i], np.concatenate([part[i] for part in parts]))
        infos = found[4]
        assert found[0] in both.observation_space
        error = np.concatenate([part[4]["error_um"] for part in parts])
        np.testing.assert_array_equal(infos["error_um"], error)
        assert infos["_error_um"].all()
        over = found[3] if mode is SAME else np.zeros(5, dtype=bool)
        assert ("final_obs" in infos) == over.any()
        if over.any():
            np.testing.assert_array_equal(infos["_final_obs"], over)
            np.testing.assert_array_equal(infos["final_info"]["_error_um"], over)
            for lane in np.flatnonzero(over):
                one, own = (parts[0], lane) if lane < 2 else (parts[1], lane - 2)
                np.testing.assert_array_equal(infos["final_obs"][lane], one[4]["final_obs"][own])
                value = one[4]["final_info"]["error_um"][own]
                assert infos["final_info"]["error_um"][lane] == value


def test_wrappers_and_the_adapter_take_it():
    pytest.importorskip("stable_baselines3")
    from rdpi_gym.envs.wrappers.stable_baselines import StableBaselinesVecEnv

    both = SideBySideVectorEnv([group(length=7), group("P10-static", 3, 5)])
    env = StableBaselinesVecEnv(VectorHistoryObservation(both, 2))
    env.seed(0)
    env.reset()
    for k in range(1, 11):
        _, _, done, infos = env.step(np.zeros((5, 1), dtype=np.float32))
        assert done.tolist() == [k == 7] * 2 + [k % 5 == 0] * 3
        for ended, info in zip(done, infos, strict=True):
            assert set(info) >= ({"terminal_observation"} if ended else set())
            assert ended or info == {}
            assert not ended or info["terminal_observation"].shape == (17,)


@over(
    "groups, message",
    [
        ([], "at least one"),
        ([{}, {"plant": "P5"}], "amplitude"),
        ([{}, {"preview": 3}], "what they show"),
        ([{}, {"mode": NEXT}], "how they are reset"),
        ([{"mode": NEVER}], "SAME_STEP or NEXT_STEP"),
    ],
)
def test_groups_that_do_not_fit_together_are_refused(groups, message):
    with pytest.raises(InputError, match=message):
        SideBySideVectorEnv([group(**each) for each in groups])
