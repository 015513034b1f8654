"""A new effect is three files and a new core one; no other file is touched, and every test passes.

A copy of the checkout gets what CONTRIBUTING.md asks for. A process of its own asks every room for
the effect, and another runs the tests that range over effects or cores.
"""

import json

import pytest

from tests.copied import add, copied, failures, python

FILES = {
    "rdpi_gym/plant/effects/bend.py": '''"""Bend: a lever whose ratio changes with its angle."""
from dataclasses import dataclass

from numba import njit

from rdpi_gym.plant.effects.base import Effect, Parameter


@njit
def bend_block(x, u, p, state, ts, y):
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] + p[0, b] * x[t, b] ** 3


@dataclass(frozen=True)
class Bend(Effect):
    """Cubic distortion of the displacement."""

    share: float = 0.1

    name = "bend"
    slot = "output"
    order = 5
    parameters = (Parameter("share", "1", 0.0, 0.5, (0.05, 0.2), "share at 10 µm", 0.0),)
    equation = "y = y_m (1 + s (y_m / 10 µm)²)"
    source = "A lever that turns by an angle."
    signature = "Third harmonics that grow with the stroke."
    experiment = "Sines of two amplitudes."
    mistaken_for = ()
    block = staticmethod(bend_block)

    def coefficients(self, ts_s, hysteresis):
        return [self.share / 100.0]

    def state_rows(self, ts_s):
        return 0
''',
    "baselines/inverses/bend.py": '''"""Bend undone by Newton's method."""
import numpy as np

from baselines.inverses.base import Inverse


class BendInverse(Inverse):
    """The root of x + c x³ = y."""

    effect = "bend"

    def __init__(self, effect, setting, ahead=0):
        super().__init__(effect, setting, ahead)
        self._cube = effect.coefficients(setting.ts_s, setting.hysteresis)[0]

    def run(self, y, state):
        x = y.copy()
        for _ in range(30):
            x -= (x + self._cube * x**3 - y) / (1.0 + 3.0 * self._cube * x**2)
        return np.ascontiguousarray(x)
''',
    "rdpi_gym/virtual_lab/independent/lever.py": '''"""A lever, independently of the plant's stages."""
from rdpi_gym.virtual_lab.independent.twin import Twin

TWINS = (Twin("bend", 16, 15, lambda grid, share: lambda x: x * (1.0 + share * (x / 10.0) ** 2)),)
''',
    "rdpi_gym/plant/cores/bent.py": '''"""Bent: a slide that relaxes along the way, beside a line that is bent."""
import math
from dataclasses import dataclass, replace

from numba import njit

from rdpi_gym.plant.cores.families import LENGTHS, InnerVariable, check_gain, check_shape
from rdpi_gym.plant.parameters import Parameter


@njit
def bent_block(u, v, p, state, y):
    for b in range(u.shape[1]):
        z, last, limit = state[2, b], state[3, b], p[3, b]
        for t in range(u.shape[0]):
            change = u[t, b] - last
            end = math.copysign(limit, change)
            z = end + (z - end) * math.exp(-abs(change) / limit)
            last = u[t, b]
            bent = limit * math.tanh(last / limit)
            y[t, b] = p[0, b] * last + p[1, b] * z + p[2, b] * bent + p[5, b]
        state[2, b], state[3, b] = z, last


@dataclass(frozen=True)
class Bent(InnerVariable):
    """y = a u + d z + q L tanh(u / L), z relaxes to L or -L along the way."""

    slope: float
    slide: float
    bend: float
    length_V: float
    rate_bandwidth_hz: float | None = None

    name = "bent"
    block = staticmethod(bent_block)
    title = "relaxing slide beside a bent line"
    equation = "y = a u + d z + q L tanh(u / L), z' = u' (1 - z sgn(u') / L)"
    source = "Written by a test of this project."
    signature = "Loops that turn clockwise about a line that is bent."
    experiment = "Triangles of several sizes about rest."
    hardware = "None."
    shape = (Parameter("length_V", "V", 1e-9, 1e9, (1.0, 30.0), "length L"),)
    clockwise = True

    def __post_init__(self):
        for name in ("slope", "slide", "bend"):
            check_gain(name, getattr(self, name))
        check_shape(self)

    @property
    def a0(self):
        return self.slope + self.slide

    @property
    def A(self):
        return self.slope + 2.0 * self.slide + self.bend

    @property
    def gains(self):
        return self.slope, self.slide, self.bend

    @property
    def signed(self):
        return False, False, False

    @property
    def reach_V(self):
        return -self.length_V, self.length_V

    def with_gains(self, gains):
        slope, slide, bend = (max(float(gain), 0.0) for gain in gains)
        return replace(self, slope=max(slope, 1e-9), slide=slide, bend=bend)

    @classmethod
    def starts(cls, scale):
        gain = scale.stroke_um / scale.span_V
        return tuple(cls(gain, gain, 0.1 * gain, k * scale.span_V) for k in LENGTHS)

    def coefficients(self):
        return [*self.gains, self.length_V]
''',
}

TESTS = (
    "tests/plant", "tests/virtual_lab/test_independent.py", "tests/virtual_lab/test_other_cores.py",
    "tests/baselines/test_beliefs_with_effects.py", "tests/baselines/test_core_inverse.py",
    "tests/identification/test_cores.py", "tests/diagnosis/test_believing.py",
    "tests/diagnosis/test_checks_effects.py", "tests/envs/test_vector_twin.py",
    "tests/firmware/test_plants.py", "tests/torch_plant/test_torch_plant.py",
    "tests/cli/test_effects_command.py",
)  # fmt: skip
"""Tests of the first tier that range over effects or cores."""

SCRIPT = '''"""Ask every room for the new effect, and print what it said as JSON."""
import contextlib
import io
import json
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np

import rdpi_gym
from baselines import make_controller
from rdpi_gym.cli import main
from rdpi_gym.envs import ObservationLayout, TrackingTask
from rdpi_gym.measurement import Record, write_csv
from rdpi_gym.plant import P5, Plant, PlantModel
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.virtual_lab import Truth, simulate_dataset

said = {"package": str(Path(rdpi_gym.__file__).parent), "catalogue": list(CATALOGUE)}
BENT = replace(P5, effects=(CATALOGUE["bend"](share=0.1),))


def command(*words):
    with contextlib.redirect_stdout(io.StringIO()):
        assert main(list(words)) == 0


def record(name, frequency_hz, seed):
    t = np.arange(1200) * 1e-3
    u = 20.0 * np.sin(2 * np.pi * frequency_hz * t) * (0.4 + 0.6 * np.sin(2 * np.pi * 0.7 * t))
    y = Plant(BENT, 1e-3).simulate(u) + 0.005 * np.random.default_rng(seed).standard_normal(t.size)
    write_csv(Record(name, t, u, y, ts_s=1e-3), Path("data") / f"{name}.csv")


command("effects", "--out", "effects")
said["effects"] = [e["effect"] for e in json.loads(Path("effects/effects.json").read_text())["effects"]]

command("simulate", "--model", "P5", "--hide", "bend", "--ts-factor", "4", "--out", "hidden")
said["hidden"] = [e["effect"] for e in json.loads(Path("hidden/truth.json").read_text())["hidden"]]

truth = simulate_dataset(Truth(P5, BENT.effects, noise_um=0.0, seed=0)).records[0]
own = Plant(BENT, truth.ts_s).simulate(truth.u_V)
said["truth less plant (µm)"] = float(np.abs(truth.y_um - own).max())

for number, frequency_hz in enumerate((3.0, 7.0, 11.0)):
    record(f"run-{number}" if number < 2 else "validation", frequency_hz, number)
command("diagnose", "data", "--model", "P5", "--jobs", "1", "--out", "diagnosis")
found = json.loads(Path("diagnosis/diagnosis.json").read_text())["candidates"]
said["candidates"] = [candidate["effect"] for candidate in found]

keywords = {"plant": BENT, "randomise_effects": 0.2}
single = gym.make("rdpi_gym/PiezoTracking-v0", **keywords)
lanes = gym.make_vec("rdpi_gym/PiezoTracking-v0", num_envs=2, **keywords)
single.reset(seed=3)
lanes.reset(seed=3)
apart = 0.0
for place in np.sin(0.05 * np.arange(200)):
    one = single.step(np.array([place], dtype=np.float32))[4]
    many = lanes.step(np.full((2, 1), place, dtype=np.float32))[4]
    apart = max(apart, abs(one["displacement_um"] - many["displacement_um"][0]))
said["vector less single (µm)"] = apart

layout = ObservationLayout.for_plant(BENT, ts_s=1e-4, preview=8)
reference = 8.0 * np.sin(2 * np.pi * 20.0 * layout.ts_s * np.arange(1000))[:, None]


def rmse_um(belief):
    controller = make_controller("extended-inverse", belief, layout)
    task, state, errors = TrackingTask(BENT, layout), None, []
    observation = task.reset(reference)
    for k in range(900):
        action, state = controller.predict(observation, state, np.array([k == 0]), True)
        observation = task.step(layout.place_to_V(np.asarray(action, dtype=float)[:, 0]))
        errors.append(task.error_um[0])
    return float(np.sqrt(np.mean(np.square(errors))))


said["rmse unknown (µm)"] = rmse_um(replace(BENT, effects=()))
said["rmse known (µm)"] = rmse_um(BENT)
said["json"] = PlantModel.from_dict(json.loads(json.dumps(BENT.to_dict()))) == BENT
print(json.dumps(said))
'''


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    home = copied(tmp_path_factory.mktemp("copy") / "home")
    add(home, FILES)
    return home


@pytest.fixture(scope="module")
def said(home):
    (home / "ask.py").write_text(SCRIPT, encoding="utf-8")
    result = python(home, "ask.py")
    assert result.returncode == 0, result.stderr[-3000:]
    answer = json.loads(result.stdout.splitlines()[-1])
    assert answer["package"] == str(home / "rdpi_gym")
    return answer


def test_the_catalogue_and_the_command_list_it(said):
    assert "bend" in said["catalogue"]
    assert said["effects"] == said["catalogue"]
    assert said["catalogue"].index("creep") < said["catalogue"].index("bend")
    assert said["catalogue"].index("bend") < said["catalogue"].index("resonance")
    assert said["json"]


def test_it_can_be_hidden_and_its_twin_agrees_with_its_stage(said):
    assert said["hidden"] == ["bend"]
    assert said["truth less plant (µm)"] < 1e-4


def test_the_diagnosis_tries_it_and_finds_it(said):
    assert sorted(said["candidates"]) == sorted(said["catalogue"])
    assert said["candidates"][0] == "bend"


def test_single_and_vector_environments_run_it_alike(said):
    assert said["vector less single (µm)"] < 1e-9


def test_a_compensator_that_knows_it_undoes_it(said):
    assert said["rmse unknown (µm)"] > 0.2
    assert said["rmse known (µm)"] < 0.2 * said["rmse unknown (µm)"]


def test_every_test_that_ranges_over_effects_or_cores_passes(home):
    assert failures(home, TESTS) == []
