"""Bad input of the vector environment: one line, and nothing has moved."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.envs.draw_laws import DrawLaw
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.envs.vector.plants import glides_of, wear_of
from rdpi_gym.plant import named_plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.errors import InputError
from tests.looping import over

GOOD = np.zeros((3, 1), dtype=np.float32)


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
        ({"num_envs": 0}, "num_envs is 0; give a whole number of lanes, at least 1"),
        ({"num_envs": -1}, "num_envs is -1"),
        ({"num_envs": 2.0}, "num_envs is 2.0"),
        ({"num_envs": True}, "num_envs is True"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0; give a whole number of steps"),
        ({"threads": 0}, "threads is 0; give a whole number of threads"),
        ({"autoreset_mode": "never"}, "autoreset_mode is 'never'; give one of 'NextStep', 'SameS"),
        ({"plant": "P7"}, "'P7' is neither a plant file nor one of P5"),
        ({"randomise_effects": 1.0}, "randomise_effects is 1.0; give a relative half-width"),
        ({"render_mode": "ansi"}, "render_mode is 'ansi'"),
        ({"action": "correction"}, "action is 'correction' and baseline is None"),
    ],
)
def test_keywords(keywords, expected):
    assert expected in refused(PiezoTrackingVectorEnv, **keywords)


@over("law", [{"ageing": lambda model, rng: model}, {"schedule": lambda model, rng: [(0, model)]}])
def test_a_law_that_is_a_function_is_refused_where_lanes_would_share_it(law):
    (word,) = law
    drawn = DrawLaw((named_plant("P5"),), **law)
    read = {"ageing": lambda: wear_of(drawn), "schedule": lambda: glides_of(drawn, None, 2)}
    line = refused(read[word])
    assert line.startswith(f"{word} <function ")
    assert "is a function, which lanes cannot share; give a " in line


def test_an_unknown_keyword_is_named():
    with pytest.raises(TypeError, match="amplitud"):
        PiezoTrackingVectorEnv(2, amplitud=1.0)


@over(
    "actions, expected",
    [
        (np.array([[0.0], [np.nan], [0.0]], np.float32), "action of lane 1 is nan; give finite"),
        (np.array([[0.0], [0.0], [-np.inf]]), "action of lane 2 is -inf"),
        (
            np.zeros((2, 1), np.float32),
            "shape (2, 1); give a numpy array of numbers of shape (3, 1)",
        ),
        (np.zeros(3, np.float32), "actions are ndarray of shape (3,)"),
        (np.zeros((3, 1), dtype=bool), "give a numpy array of numbers"),
        (np.array([["a"]] * 3), "give a numpy array of numbers"),
        ([[0.0], [0.0], [0.0]], "actions are list of shape (3, 1)"),
        (None, "actions are NoneType"),
    ],
)
def test_actions_leave_the_episodes_as_they_were(actions, expected):
    envs, untouched = (PiezoTrackingVectorEnv(3) for _ in range(2))
    envs.reset(seed=0)
    untouched.reset(seed=0)
    assert expected in refused(envs.step, actions)
    np.testing.assert_array_equal(envs.step(GOOD)[0], untouched.step(GOOD)[0])


@over("actions", [GOOD.astype(float), GOOD.astype(int), GOOD[::-1], GOOD.copy("F")])
def test_actions_of_other_numbers_and_strides_are_read(actions):
    envs = PiezoTrackingVectorEnv(3)
    envs.reset(seed=0)
    assert envs.step(actions)[4]["command_V"].tolist() == [0.0, 0.0, 0.0]


@over(
    "keywords, expected",
    [
        ({"options": {"reset_mask": [True, True, True]}}, "reset_mask is list; give a numpy array"),
        ({"options": {"reset_mask": np.ones(2, dtype=bool)}}, "reset_mask is bool of shape (2,)"),
        ({"options": {"reset_mask": np.ones(3)}}, "reset_mask is float64 of shape (3,)"),
        (
            {"options": {"reset_mask": np.zeros(3, dtype=bool)}},
            "reset_mask is false for every lane",
        ),
        ({"options": {"frequency": 3.0}}, "reset has no option 'frequency'"),
        ({"options": {"reference": "sin"}}, "names no signal"),
        ({"options": {"frequency_hz": -3.0}}, "frequency_hz is -3.0"),
        ({"options": {"weights": [0.0, 1.0]}}, "a_0 is 0.0"),
        ({"options": {"weights": [100.0] * 11}}, "what can be shown ends at"),
        ({"options": {"reference": {"signal": "sine", "amplitude_um": 1e4}}}, "smaller amplitude"),
        (
            {"options": {"plant": "P5"}},
            "plant P5 has 6 gains of the core rdpi, and the lanes of this",
        ),
        (
            {"options": {"plant": replace(named_plant("P10"), effects=(CATALOGUE["creep"](),))}},
            "plant P10 has creep, and the lanes of this environment have no effects",
        ),
        ({"seed": -1}, "the seed of lane 0 is -1; seeds are 0 to 2**64 - 1"),
        ({"seed": 2**64 - 1}, "the seed of lane 1 is 18446744073709551616"),
        ({"seed": 1.5}, "seed is 1.5; give a whole number, or one for each lane"),
        ({"seed": "one"}, "seed is 'one'"),
        ({"seed": [1, 2]}, "2 seeds for 3 lanes"),
        ({"seed": [1, 2, "x"]}, "the seed of lane 2 is 'x'"),
    ],
)
def test_resets_leave_the_environment_usable(keywords, expected):
    envs, untouched = (PiezoTrackingVectorEnv(3) for _ in range(2))
    envs.reset(seed=0)
    untouched.reset(seed=0)
    assert expected in refused(envs.reset, **keywords)
    np.testing.assert_array_equal(envs.step(GOOD)[0], untouched.step(GOOD)[0])


def test_a_plant_that_the_converter_of_the_lanes_does_not_fit():
    envs = PiezoTrackingVectorEnv(2, ts_s=1e-5)
    line = refused(envs.reset, options={"plant": "P10-bench"})
    assert "the converter of plant P10-bench holds another number of samples" in line


def test_a_plant_with_a_longer_delay_than_the_lanes_can_hold():
    def delayed(delay_s):
        return replace(named_plant("P5"), effects=(CATALOGUE["delay"](delay_s=delay_s),))

    envs = PiezoTrackingVectorEnv(2, plant=delayed(3e-4), randomise_effects=0.5)
    envs.reset(seed=0, options={"plant": delayed(4e-4)})
    line = refused(envs.reset, options={"plant": delayed(9e-4)})
    assert "delay of plant P5 needs a longer memory than the lanes" in line


def test_a_random_reference_that_goes_too_far_leaves_the_episodes_as_they_were():
    far = {"signal": "constant", "offset_um": 1e6, "amplitude_um": 0.0}
    envs, untouched = (PiezoTrackingVectorEnv(3, reference="triangle") for _ in range(2))
    envs.reset(seed=0)
    untouched.reset(seed=0)
    mask = np.array([False, True, True])
    line = refused(envs.reset, options={"reference": far, "reset_mask": mask})
    assert "give it a smaller amplitude_um" in line
    for _ in range(5):
        np.testing.assert_array_equal(envs.step(GOOD)[0], untouched.step(GOOD)[0])
