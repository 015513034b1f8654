"""Keywords of the wrong type: an error of one line that a person can act on, or an environment."""

import dataclasses
import inspect
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import rdpi_gym  # noqa: F401  # registers the environments
from rdpi_gym.envs import ObservationLayout, PiezoTrackingEnv, TrackingTask
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.envs.wrappers.history import HistoryObservation, VectorHistoryObservation
from rdpi_gym.envs.wrappers.scaling import ScaledObservation, VectorScaledObservation
from rdpi_gym.plant import P5, RDPI, Converter, Plant, PlantModel, Sensor, find_plant, named_plant
from rdpi_gym.plant.effects import CATALOGUE, effect_from_dict, load_effect
from rdpi_gym.signals import SIGNALS, make_signal, signal_from_dict
from rdpi_gym.support.errors import InputError
from tests.looping import over

NAME = "rdpi_gym/PiezoTracking-v0"
ODD: tuple[Any, ...] = (
    None, True, 0, -1, 7, 2**70, 10**400, 10**5000, 0.0, -0.5, 1e-4, 1e300, float("nan"),
    float("inf"), 1j, Decimal(3), Fraction(1, 3), "", "text", "1e-4", "a\nb", "\0", "x" * 5000,
    b"bytes", [], [1], [1.0, 2.0], [2.0, 1.0], ["a", "b"], [[1.0], [2.0, 3.0]], (), (None, None),
    {}, {"a": 1}, {1: 2}, {"signal": "sine", 3: 4}, {"signal": ["sine"]}, {"hysteresis": 5}, set(),
    object(), int, len, Path("nowhere"), np.float32(0.5), np.int64(3), np.bool_(True),
    np.array(1.0), np.array([1.0, 2.0]), np.array(["a"]), np.array([None]), range(3),
)  # fmt: skip


def outcome(make: Callable[[], Any]) -> Any:
    """What is made, or None where it was refused in one line."""
    try:
        return make()
    except InputError as error:
        line = str(error)
        assert "\n" not in line
        assert 10 < len(line) < 1020
        return None


def keywords_of(kind: Any) -> list[str]:
    return [name for name in inspect.signature(kind).parameters if name != "options"]


def use(env: gym.Env) -> None:
    if outcome(lambda: env.reset(seed=0)) is None:
        return  # a reference that goes too far
    observation, reward, *_ = env.step(np.zeros(1, dtype=np.float32))
    assert env.observation_space.contains(observation)
    assert np.isfinite(reward)


@over("keyword", keywords_of(PiezoTrackingEnv))
def test_keywords_of_the_environment(keyword):
    for value in ODD:
        for more in ({}, {"action": "correction"}, {"baseline": "pi"}):
            given = {**more, keyword: value}
            env = outcome(lambda given=given: PiezoTrackingEnv(**given))
            if env is not None:
                use(env)


def test_gymnasium_make_hands_the_line_on():
    for value in ODD[:30]:
        outcome(lambda value=value: gym.make(NAME, ts_s=value))


@over("keyword", [*keywords_of(PiezoTrackingVectorEnv), "plant", "preview", "reference", "ts_s"])
def test_keywords_of_the_vector_environment(keyword):
    for value in ODD:
        envs = outcome(lambda value=value: PiezoTrackingVectorEnv(**{keyword: value}))
        if envs is not None and outcome(lambda envs=envs: envs.reset(seed=0)) is not None:
            actions = np.zeros((envs.num_envs, 1), dtype=np.float32)
            assert envs.observation_space.contains(envs.step(actions)[0])


@over("kind", [PiezoTrackingEnv, PiezoTrackingVectorEnv])
def test_what_a_reset_is_given(kind):
    env = kind()
    names = ("reference", "frequency_hz", "plant", "weights", "thresholds_V", "delta2_s")
    for value in ODD:
        outcome(lambda value=value: env.reset(seed=value))
        outcome(lambda value=value: env.reset(options=value))
        for name in (*names, "reset_mask"):
            outcome(lambda value=value, name=name: env.reset(options={name: value}))
    assert env.reset(seed=0)[0].dtype == np.float32


@over("kind", [PiezoTrackingEnv, PiezoTrackingVectorEnv])
def test_actions(kind):
    env = kind()
    env.reset(seed=0)
    for value in ODD:
        outcome(lambda value=value: env.step(value))


@over("name", SIGNALS)
def test_fields_of_signals(name):
    for field in dataclasses.fields(SIGNALS[name]):
        for value in ODD:
            given = {field.name: value}
            outcome(lambda given=given: make_signal(name, **given))
            signal = outcome(lambda given=given: signal_from_dict({"signal": name, **given}))
            if signal is not None:
                assert np.isfinite(signal([0.0, 0.1])).all()


@over("name", CATALOGUE)
def test_parameters_of_effects(name):
    for parameter in CATALOGUE[name].parameters:
        for value in ODD:
            outcome(lambda value=value, p=parameter: CATALOGUE[name](**{p.name: value}))
            document = {**CATALOGUE[name]().to_dict(), parameter.name: value}
            outcome(lambda document=document: effect_from_dict(CATALOGUE, document, "model.json"))


BASES = {
    RDPI: {"weights": (1.0, 0.5), "thresholds_V": (1.0,), "delta2_s": 0.0},
    PlantModel: {field.name: getattr(P5, field.name) for field in dataclasses.fields(P5)},
    Sensor: {},
    Converter: {},
    ObservationLayout: {
        "preview": 1, "centre_um": 0.0, "scale_um": 1.0, "command_range_V": (0.0, 1.0), "ts_s": 1e-4,
    },
    TrackingTask: {"models": P5, "layout": ObservationLayout.for_plant(P5, 1e-4)},
    Plant: {"models": P5, "ts_s": 1e-4},
}  # fmt: skip


@over("kind", BASES)
def test_fields_of_plants(kind):
    for keyword in keywords_of(kind):
        if (kind, keyword) in ((TrackingTask, "layout"), (Plant, "lanes")):
            continue  # no keyword of a user's; a number of lanes that no memory holds
        for value in ODD:
            given = {**BASES[kind], keyword: value}
            outcome(lambda given=given: kind(**given))


def test_plants_from_json_and_by_name():
    document = P5.to_dict()
    for value in ODD:
        outcome(lambda value=value: find_plant(value) if isinstance(value, str) else None)
        outcome(lambda value=value: named_plant(value) if isinstance(value, str) else None)
        outcome(lambda value=value: load_effect(value) if isinstance(value, str) else None)
        for key in (*document, "a"):
            changed = {**document, key: value}
            outcome(lambda changed=changed: PlantModel.from_dict(changed))
            within = {**document["hysteresis"], key: value}
            outcome(lambda within=within: PlantModel.from_dict({**document, "hysteresis": within}))


def test_keywords_of_the_wrappers():
    for value in ODD:
        for single, lanes in (
            (HistoryObservation, VectorHistoryObservation),
            (ScaledObservation, VectorScaledObservation),
        ):
            if single is HistoryObservation and isinstance(value, int) and value >= 2**70:
                continue  # a history that no memory holds
            outcome(lambda value=value, kind=single: kind(PiezoTrackingEnv(), value))
            outcome(lambda value=value, kind=lanes: kind(PiezoTrackingVectorEnv(), value))
