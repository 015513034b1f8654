"""The registered tasks: their ids, their draws, what changes within an episode."""

import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import rdpi_gym  # noqa: F401  # registers the environments
from rdpi_gym.envs.tasks import TASKS, named_task
from rdpi_gym.envs.tasks.task import ChangingPlant
from rdpi_gym.envs.wrappers.history import History
from rdpi_gym.plant import Plant
from rdpi_gym.support.errors import InputError
from tests.looping import over

REGISTERED = {name for name in gym.registry if name.startswith("rdpi_gym/")}


def test_every_task_is_registered_and_no_other():
    assert {task.id for task in TASKS.values()} == REGISTERED - {"rdpi_gym/PiezoTracking-v0"}
    assert {gym.registry[task.id].max_episode_steps for task in TASKS.values()} == {2500}
    assert {task.samples for task in TASKS.values()} == {2500}


@over("task", TASKS.values())
def test_an_id_is_a_sound_environment_whose_docstring_is_its_page(task):
    env = gym.make(task.id)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)
    assert env.unwrapped.__doc__.startswith(f"{task.title}.")
    assert ("Not Markov" in env.unwrapped.__doc__) is not task.is_markov
    assert env.observation_space.shape == (History(task.layout(), task.history).size,)
    assert pickle.loads(pickle.dumps(env)).reset(seed=1)[0].shape == env.observation_space.shape


# Samples that reach what a task does late: a load that has come, a second block of coloured noise.
SAMPLES = {"Load": 2300, "Rough": 1100}


@over("task", TASKS.values())
def test_a_vector_lane_is_the_single_environment(task):
    """Bit by bit, over an end of the episode too."""
    steps = SAMPLES.get(task.name, 60)
    lanes = gym.make_vec(
        task.id, num_envs=3, max_episode_steps=steps - 20, autoreset_mode="SameStep"
    )
    singles = [gym.make(task.id, max_episode_steps=steps - 20) for _ in range(3)]
    shown, info = lanes.reset(seed=5)
    found = [env.reset(seed=5 + i) for i, env in enumerate(singles)]
    np.testing.assert_array_equal(shown, [each[0] for each in found])
    for action in np.random.default_rng(0).uniform(-0.3, 0.3, (steps, 3, 1)).astype(np.float32):
        shown, reward, _, ended, info = lanes.step(action)
        found = [env.step(action[i]) for i, env in enumerate(singles)]
        np.testing.assert_allclose(reward, [each[1] for each in found], atol=1e-11)
        if ended.any():
            assert ended.all()
            np.testing.assert_array_equal(np.stack(info["final_obs"]), [e[0] for e in found])
            found = [env.reset() for env in singles]
        else:
            for key, value in found[0][4].items():
                np.testing.assert_allclose(info[key][0], value, atol=1e-11)
        np.testing.assert_array_equal(shown, [each[0] for each in found])


def test_draws_come_again_and_the_splits_have_none_in_common():
    task = TASKS["Load"]
    drawn = {
        (split, seed, number): task.draw(split, number, seed)
        for split in ("training", "validation", "test")
        for seed in (0, 2**40)
        for number in range(2)
    }
    again = task.draw("test", 1, 2**40)
    np.testing.assert_array_equal(again.references_um, drawn["test", 2**40, 1].references_um)
    assert again.later == drawn["test", 2**40, 1].later
    assert len({one.truth for one in drawn.values()}) == len(drawn)
    noise = {tuple(one.noises[0].standard_normal(3)) for one in drawn.values()}
    assert len(noise) == len(drawn)


@over("split, number, said", [("tests", 0, "split is 'tests'"), ("test", -1, "number is -1")])
def test_a_draw_that_is_none_is_refused_in_one_line(split, number, said):
    with pytest.raises(InputError, match=said):
        TASKS["Bare"].draw(split, number)


@over("name", ["Load", "Rough"])
def test_a_longer_episode_begins_as_a_short_one(name):
    task, commands = TASKS[name], np.random.default_rng(0).uniform(-20.0, 20.0, (400, 1))
    found = []
    for samples in (task.samples, 4000):
        (lanes,) = task.lanes("validation", 1, samples=samples)
        assert len(lanes.references_um) == samples
        tracked = lanes.track(lanes.layout())
        tracked.reset(lanes.references_um, lanes.noises)
        count = lanes.references_um.shape[1]
        shown = [tracked.step(np.repeat(u, count)).copy() for u in commands]
        found.append((shown, lanes.references_um[: task.samples - 8]))
    for short, long in zip(*found, strict=True):
        np.testing.assert_array_equal(short, long)


def test_an_id_with_a_typing_error_is_answered_with_what_was_meant():
    with pytest.raises(InputError, match="did you mean 'Preisach'"):
        named_task("Preisac")


def test_a_load_slows_the_ringing_down_and_lets_no_displacement_jump():
    task = TASKS["Load"]
    draw = task.draw("test", 0)
    plant = ChangingPlant([draw.truth], task.ts_s, [draw.later])
    plant.reset(u0_V=0.0)
    kick, rest = np.array([[1.0]]), np.array([[0.0]])
    y = np.array([plant.step(kick if 990 <= k < 995 or 2400 <= k < 2405 else rest)[0, 0]
                  for k in range(2500)])  # fmt: skip
    before, after = y[995:1000], y[2405:2500]
    assert np.abs(np.diff(y)).max() < 0.5
    mode = next(e for e in draw.truth.effects if e.name == "resonance").f0_hz
    last = next(e for e in draw.later[max(draw.later)].effects if e.name == "resonance").f0_hz
    crossings = np.flatnonzero(np.diff(np.sign(after - after.mean())))
    half_period = np.diff(crossings)[1:].mean() * task.ts_s
    assert 0.5 / half_period == pytest.approx(last, rel=0.1)
    assert last < 0.81 * mode
    assert before.size  # the kick before the load rang too
    twin = Plant([draw.truth], task.ts_s)
    twin.reset(u0_V=0.0)
    plant.reset(u0_V=0.0)  # the load is gone
    block = np.concatenate([np.zeros(10), np.ones(50)])
    ours = [plant.step(np.array([[u]]))[0, 0] for u in block]
    np.testing.assert_array_equal(ours, twin.simulate(block))


def test_rough_noise_has_the_rms_that_it_states_and_goes_on_between_blocks():
    task = TASKS["Rough"]
    one, other = (task.draw("test", 0).noises[0] for _ in range(2))
    whole = one.standard_normal(3)
    assert whole.shape == (3,)
    many = np.concatenate([other.standard_normal(100_000) for _ in range(4)])
    assert many.std() == pytest.approx(task.noise.rms, rel=0.05)
    steps = np.abs(np.diff(many.reshape(4, -1).mean(axis=1)))
    assert steps.max() < 1.0
