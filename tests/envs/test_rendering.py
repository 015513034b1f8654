"""Frames show the loop and the tracking, of the running episode only."""

import pickle
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest

import rdpi_gym  # noqa: F401  # registers the environments


def frames(env, seed, actions, every=50):
    """Return the frames of an episode."""
    env.reset(seed=seed)
    shown = [env.render()]
    for k, action in enumerate(actions, start=1):
        env.step(np.array([action], dtype=np.float32))
        if k % every == 0:
            shown.append(env.render())
    return shown


def has_colour(frame, rgb, at_least):
    """Say whether so many pixels are about of a colour."""
    return np.sum(np.all(np.abs(frame.astype(int) - rgb) < 45, axis=2)) >= at_least


def test_frames_are_pictures_that_change():
    env = gym.make("rdpi_gym/PiezoTracking-v0", render_mode="rgb_array", frequency_hz=50.0)
    shown = frames(env, 0, 0.4 * np.sin(0.03 * np.arange(300)))
    assert {(frame.shape, frame.dtype.name) for frame in shown} == {((480, 960, 3), "uint8")}
    assert all(np.any(a != b) for a, b in pairwise(shown))
    for colour in ((224, 123, 57), (31, 111, 180), (184, 51, 106)):
        assert has_colour(shown[-1], colour, at_least=150)


def test_an_episode_is_drawn_alike_after_another():
    env = gym.make("rdpi_gym/PiezoTracking-v0", render_mode="rgb_array")
    actions = np.linspace(0.0, 1.0, 100)
    first = frames(env, 1, actions)
    frames(env, 2, -actions)
    for before, after in zip(first, frames(env, 1, actions), strict=True):
        np.testing.assert_array_equal(before, after)
    assert not np.shares_memory(first[0], first[1])


def test_pickled_mid_episode_draws_alike():
    env = gym.make("rdpi_gym/PiezoTracking-v0", render_mode="rgb_array")
    last = frames(env, 3, np.linspace(0.0, 1.0, 100))[-1]
    twin = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(twin.render(), last)


def test_what_leaves_the_axes_widens_them():
    env = gym.make(
        "rdpi_gym/PiezoTracking-v0",
        render_mode="rgb_array",
        reference="constant",
        smooth_start_s=0.0,
    )
    far = frames(env, 0, np.ones(300), every=300)[-1]
    # The displacement's line runs at 2.4 times the amplitude: it is inside the widened axes.
    assert has_colour(far, (31, 111, 180), at_least=300)


def test_no_render_mode_draws_nothing_and_says_so():
    env = gym.make("rdpi_gym/PiezoTracking-v0")
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="no render_mode"):
        assert env.unwrapped.render() is None
