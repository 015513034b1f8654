"""The jobs of CONTRIBUTING.md, each done in a copy as it says: then the tests of the rooms pass there."""

import json
import re

import pytest

from tests.copied import add, copied, failures, python
from tests.plant.additions import CORE, EFFECT

SIGNAL = '''"""Trapezoid: a triangle whose turns are cut off."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rdpi_gym.signals.periodic import Periodic


@dataclass(frozen=True, kw_only=True)
class Trapezoid(Periodic):
    """Straight ways between two holds of a quarter of the period each."""

    name: ClassVar[str] = "trapezoid"

    def _place(self, t):
        return 4.0 * (self._cycles(t) % 1.0)

    def _shape(self, t):
        return np.interp(self._place(t), [0.0, 0.5, 1.5, 2.5, 3.5, 4.0], [0.0, 1.0, 1.0, -1.0, -1.0, 0.0])

    def _shape_rate(self, t):
        place = self._place(t)
        slope = np.where((place < 0.5) | (place >= 3.5), 2.0, 0.0) - 2.0 * ((place >= 1.5) & (place < 2.5))
        return 4.0 * self.frequency_hz * slope
'''
OVER_REGISTRIES = [
    f"tests/{path}"
    for path in (
        *(f"baselines/test_{name}.py" for name in (
            "baseline_predict", "baselines_evaluate_policy", "core_inverse", "inverses",
            "loop_stability", "pi_feedback", "preview",
        )),
        "cli/test_effects_command.py",
        "diagnosis/test_golden_texts.py",
        "envs/test_tasks.py", "envs/test_vector_twin.py",
        "face/test_arguments.py", "face/test_lazy.py",
        "firmware/test_controllers.py", "firmware/test_plants.py",
        "firmware/translation/test_kernels.py",
        "plant/cores/test_every_core.py", "plant/effects", "plant/test_chain.py",
        "signals/test_signal_laws.py", "signals/test_signal_registry.py",
        "torch_plant", "test_house.py",
    )
]  # fmt: skip
"""Files whose tests go through a registry entry by entry, or through all that is public."""
NAME_THEIR_CASES = " or ".join((
    "all_effects_together", "bank_of_cores_is_off", "branches_loops_and_places", "every_further_form",
    "fields_in_another_order",
    "gradients_through_time", "kernels_mean_in_c",
    "learned_policies_are", "low_pass_limit", "polynomials_are_the_loops", "resets_are_those", "single_precision",
    "slew_limit_is_exact", "walk_of_the_command",
    "a_new_controller_is_one_file", "plots_alone",
))  # fmt: skip
"""Tests of those files whose cases stand in them or are drawn, which take a second or more: few or none are of
an added file."""
CONTROLLER = '''"""``tenth-rate-inverse``: the classical inverse that believes a tenth of the rate dependence."""

from dataclasses import replace

from baselines.classical import ClassicalReferenceRate


class TenthRateInverse(ClassicalReferenceRate):
    """The classical inverse at the reference's rate, with a tenth of δ2."""

    name = "tenth-rate-inverse"

    def compensator_model(self, hysteresis):
        return replace(hysteresis, delta2_s=0.1 * hysteresis.delta2_s)
'''
TASK = '''"""Stiff: a stage whose mode lies beyond what the references excite."""

from dataclasses import replace

from rdpi_gym.envs.tasks.environment import environments_of
from rdpi_gym.envs.tasks.stages import LAG, MODE, stage
from rdpi_gym.envs.tasks.task import StageTask

STIFF = StageTask(
    "Stiff",
    "A stiff stage",
    "A mode about 2 kHz behind an amplifier that lags.",
    (stage("P10 stiff", LAG, replace(MODE, f0_hz=2000.0)),),
    hidden="the memory of the plays, and the states of lag and mode",
    rank=45,
)
PiezoStiffEnv, stiff_vector = environments_of(STIFF, __name__)
'''
FIELD = {
    'scaling="increments"),\n)': 'scaling="increments"),\n    Field("error", "difference"),\n)',
    "return ahead_um, measured_um, command_V\n": (
        "return ahead_um, measured_um, command_V, now_um - measured_um\n"
    ),
}
"""A field of the observation: what changes in its one file."""
JOBS = {
    "task": {"rdpi_gym/envs/tasks/stiff.py": TASK},
    "signal": {"rdpi_gym/signals/trapezoid.py": SIGNAL},
    "controller": {"baselines/tenth_rate_inverse.py": CONTROLLER},
    "core": CORE,
    "effect": EFFECT,
}
"""Files that each job adds."""

SENTENCE = re.compile(r'(Code\.STILL: )"[^"]*"')
ASK = """
import json
import baselines, rdpi_gym as rg
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.diagnosis.notices import Code, Notice
from rdpi_gym.plant import CORES
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.signals import SIGNALS

scores = rg.benchmark(
    ["none", "tenth-rate-inverse"], plants=["P5"], references=["sine"], ts_s=[1e-3], seeds=1, jobs=1
)
print(json.dumps({
    "package": rg.__file__, "signals": list(SIGNALS), "cores": list(CORES), "effects": list(CATALOGUE),
    "controllers": list(scores.ranking["controller"]), "sentence": text_of(Notice(Code.STILL)),
}))
"""


OBSERVE = """
import gymnasium as gym
import numpy as np
import rdpi_gym
from baselines import make_controller
from rdpi_gym.plant import P10 as plant
from rdpi_gym.envs.layout import DEFAULT_FIELDS, ObservationLayout
from rdpi_gym.envs.tasks import TASKS
from rdpi_gym.envs.wrappers.history import HistoryObservation
from rdpi_gym.envs.wrappers.scaling import ScaledObservation

assert list(TASKS).index("Stiff") == 4
fields = ("error", *DEFAULT_FIELDS)
own = dict(fields=fields, noise_um=0.01)
for name in ("rdpi_gym/PiezoTracking-v0", "rdpi_gym/PiezoStiff-v0"):
    env, plain = (gym.make(name, **more) for more in (own, {"noise_um": 0.01}))
    lanes = gym.make_vec(name, num_envs=3, **own)
    seen = env.reset(seed=4)[0], plain.reset(seed=4)[0], lanes.reset(seed=4)[0]
    for k in range(100):
        one, other, many = seen
        assert env.observation_space.contains(one) and len(one) == 12
        np.testing.assert_array_equal(one[1:], other)
        np.testing.assert_allclose(many[0], one, rtol=0, atol=2e-6)
        np.testing.assert_allclose(one[0], one[1] - one[-2], atol=1e-6)
        action = np.array([np.sin(0.1 * k)], dtype=np.float32)
        seen = env.step(action)[0], plain.step(action)[0], lanes.step(np.tile(action, (3, 1)))[0]
stacked = ScaledObservation(HistoryObservation(gym.make("rdpi_gym/PiezoTracking-v0", **own), 4))
assert stacked.reset(seed=1)[0].shape == (12 + 4 * 4,)
assert np.linalg.matrix_rank(stacked.scaling.matrix) == 28
shown = np.random.default_rng(0).uniform(-0.3, 0.3, (20, 12)).astype(np.float32)
for name in ("pi-preview", "lqg-preview", "learned:ppo-increment", "learned:imitation-stage"):
    for given, observations in ((fields, shown), (DEFAULT_FIELDS, shown[:, 1:])):
        made = make_controller(name, plant, ObservationLayout.for_plant(plant, 1e-4, 8, fields=given))
        actions, state = [], None
        for each in observations:
            action, state = made.predict(each, state)
            actions.append(action)
        if given == fields:
            found = actions
    np.testing.assert_array_equal(found, actions)
print("observed")
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy in which every job but that of the field is done."""
    folder = copied(tmp_path_factory.mktemp("jobs") / "copy")
    for files in JOBS.values():
        add(folder, files)
    (holder,) = [
        path
        for path in (folder / "rdpi_gym/diagnosis").rglob("*.py")
        if SENTENCE.search(path.read_text(encoding="utf-8"))
    ]
    text = holder.read_text(encoding="utf-8")
    holder.write_text(SENTENCE.sub(r'\1"Nothing moves."', text), encoding="utf-8")
    written = python(folder, "-m", "tests.diagnosis.golden_texts")
    assert written.returncode == 0, written.stderr[-2000:]
    return folder


def test_a_new_file_is_found_without_a_list(copy):
    run = python(copy, "-c", ASK)
    assert run.returncode == 0, run.stderr[-2000:]
    said = json.loads(run.stdout.splitlines()[-1])
    assert said["package"].startswith(str(copy))
    assert "trapezoid" in said["signals"]
    assert "bent" in said["cores"]
    assert "lever_ratio" in said["effects"]
    assert "tenth-rate-inverse" in said["controllers"]
    assert said["sentence"] == "Nothing moves."


def test_laws_of_what_is_registered_hold_after_every_job(copy):
    assert failures(copy, OVER_REGISTRIES, "-m", "", "-k", f"not ({NAME_THEIR_CASES})") == []


def test_a_field_of_the_observation_reaches_environments_history_and_controllers(copy):
    """The last job: every kernel of the environments is compiled again for it."""
    layout = copy / "rdpi_gym/envs/layout.py"
    for old, new in FIELD.items():
        text = layout.read_text(encoding="utf-8")
        assert text.count(old) == 1, old
        layout.write_text(text.replace(old, new), encoding="utf-8")
    for compiled in (copy / "rdpi_gym/envs").rglob("*.nb[ic]"):
        compiled.unlink()
    run = python(copy, "-c", OBSERVE)
    assert run.stdout == "observed\n", run.stderr[-2000:]
