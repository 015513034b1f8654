"""A new hysteresis core is one file: it is found, saved and loaded, and runs wherever a plant does."""

import sys
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import rdpi_gym  # noqa: F401  # registers the environments
import rdpi_gym.plant.cores as room
from rdpi_gym.plant import CORES, P5, RDPI, Plant, PlantModel
from rdpi_gym.plant.cores import base
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.plugins import Members

TS_S = 1e-4

FILE = '''"""A branch that bends towards the other one."""
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core


@njit
def bent_block(u, v, p, state, y):
    for b in range(u.shape[1]):
        last, h = state[3, b], state[2, b]
        for t in range(u.shape[0]):
            change = u[t, b] - last
            h = p[1, b] * np.sign(change) + (h - p[1, b] * np.sign(change)) * np.exp(-abs(change))
            last = u[t, b]
            y[t, b] = p[0, b] * u[t, b] - h + p[3, b]
        state[3, b], state[2, b] = last, h


@dataclass(frozen=True)
class Bent(Core):
    """y = a u - h, where h relaxes to ±w along the way."""

    gain: float
    width: float
    rate_bandwidth_hz: float | None = None

    name = "bent"
    block = staticmethod(bent_block)

    @property
    def n(self):
        return 2

    @property
    def a0(self):
        return self.gain - 2.0 * self.width

    @property
    def A(self):
        return self.gain + self.width

    @property
    def gains(self):
        return self.gain, self.width

    @property
    def signed(self):
        return False, False

    def with_gains(self, gains):
        return replace(self, gain=gains[0], width=gains[1])

    def responses(self, u, v, memory):
        one = replace(self, gain=0.0, width=1.0)
        p, y = np.array([[0.0], [1.0], [0.0], [0.0]]), np.empty((len(u), 1))
        state = np.concatenate([[0.0, 0.0], memory / [self.width, 1.0]])[:, None]
        one.block(u[:, None], v[:, None], p, state, y)
        return np.hstack([u[:, None], y])

    @classmethod
    def starts(cls, scale):
        gain = scale.stroke_um / scale.span_V
        return (cls(gain, 0.1 * gain),)

    def coefficients(self):
        return [self.gain, self.width]

    def settled(self, turns_V):
        last = turns_V[-1]
        h = self.width * np.sign(last) * (1.0 - np.exp(-abs(last)))
        return np.array([h, last])

    def resting(self, memory, u0_V):
        return np.stack([memory[0], u0_V])
'''


@pytest.fixture
def bent(tmp_path, monkeypatch):
    (tmp_path / "bent.py").write_text(FILE, encoding="utf-8")
    monkeypatch.setattr(room, "__path__", [*room.__path__, str(tmp_path)])
    found = Members("rdpi_gym.plant.cores", base.Core)
    monkeypatch.setattr("rdpi_gym.plant.model.CORES", found)
    yield found["bent"](gain=1.0, width=0.3)
    sys.modules.pop("rdpi_gym.plant.cores.bent", None)


@pytest.fixture
def model(bent):
    return PlantModel(bent, "with a core of its own", (-20.0, 20.0), (0.0, 8.0))


def test_cores_of_the_package_are_found_by_their_files():
    assert CORES["rdpi"] is RDPI
    for name, kind in CORES.items():
        assert kind.name == name


def test_it_is_saved_by_its_name_and_loaded_back(model, tmp_path):
    document = model.to_dict()
    assert document["hysteresis"] == {
        "core": "bent", "gain": 1.0, "width": 0.3, "rate_bandwidth_hz": None,
    }  # fmt: skip
    assert PlantModel.load(model.save(tmp_path / "model.json")) == model
    assert "core" not in P5.to_dict()["hysteresis"]
    document["hysteresis"]["core"] = "os:system"
    with pytest.raises(InputError, match=r"no core is named 'os:system'; known are .*bent, .*rdpi"):
        PlantModel.from_dict(document)


def test_a_plant_runs_it_in_blocks_in_steps_in_lanes_and_with_effects(model):
    effects = tuple(CATALOGUE[name]() for name in ("actuator_lag", "congruency", "creep", "delay"))
    u = 15.0 * np.sin(np.linspace(0.0, 20.0, 400))
    for plant in (model, replace(model, effects=effects, offset_um=2.0)):
        whole = Plant(plant, TS_S).simulate(u)
        assert np.ptp(whole) > 20.0
        parts, steps = Plant(plant, TS_S), Plant(plant, TS_S)
        split = np.concatenate([parts.simulate(u[:123]), parts.simulate(u[123:])])
        np.testing.assert_array_equal(split, whole)
        single = [float(steps.step(np.array([[value]]))[0, 0]) for value in u]
        np.testing.assert_allclose(single, whole, rtol=1e-13)
        lanes = Plant(plant, TS_S, lanes=3).simulate(np.repeat(u[:, None], 3, axis=1))
        np.testing.assert_allclose(lanes, whole[:, None] * np.ones(3), rtol=1e-13)
    settled = Plant(replace(model, effects=(CATALOGUE["initial_memory"](extremum_V=9.0),)), TS_S)
    np.testing.assert_allclose(settled.memory[:, 0], model.hysteresis.settled((9.0,)))
    settled.reset(u0_V=4.0)
    assert settled.memory[1, 0] == 4.0


def test_lanes_of_two_cores_are_refused(model):
    with pytest.raises(InputError, match="lanes with the cores bent and rdpi"):
        Plant([model, P5], TS_S)


@pytest.mark.slow
def test_the_environment_and_its_vector_twin_run_it(model):
    options = {"plant": model, "randomise": 0.1}
    singles = [gym.make("rdpi_gym/PiezoTracking-v0", **options) for _ in range(3)]
    lanes = gym.make_vec("rdpi_gym/PiezoTracking-v0", num_envs=3, **options)
    lanes.reset(seed=0)
    for seed, env in enumerate(singles):
        env.reset(seed=seed)
    for _ in range(50):
        action = lanes.action_space.sample()
        _, _, _, _, info = lanes.step(action)
        for lane, env in enumerate(singles):
            observation, _, _, _, own = env.step(action[lane])
            assert env.observation_space.contains(observation)
            assert abs(info["displacement_um"][lane] - own["displacement_um"]) < 1e-12
    assert len(set(info["displacement_um"].tolist())) == 3
