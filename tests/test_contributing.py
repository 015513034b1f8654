"""The jobs of CONTRIBUTING.md, each done in a copy as it says: then the default tier passes there."""

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
CONTROLLER = '''"""``half-rate-inverse``: the classical inverse that believes half of the rate dependence."""

from dataclasses import replace

from baselines.classical import ClassicalReferenceRate


class HalfRateInverse(ClassicalReferenceRate):
    """The classical inverse at the reference's rate, with half of δ2."""

    name = "half-rate-inverse"

    def compensator_model(self, hysteresis):
        return replace(hysteresis, delta2_s=0.5 * hysteresis.delta2_s)
'''
JOBS = {
    "signal": {"rdpi_gym/signals/trapezoid.py": SIGNAL},
    "controller": {"baselines/half_rate_inverse.py": CONTROLLER},
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
    ["none", "half-rate-inverse"], plants=["P5"], references=["sine"], ts_s=[1e-3], seeds=1, jobs=1
)
print(json.dumps({
    "package": rg.__file__, "signals": list(SIGNALS), "cores": list(CORES), "effects": list(CATALOGUE),
    "controllers": list(scores.ranking["controller"]), "sentence": text_of(Notice(Code.STILL)),
}))
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy in which every job is done."""
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
    assert "bend" in said["effects"]
    assert "half-rate-inverse" in said["controllers"]
    assert said["sentence"] == "Nothing moves."


def test_the_default_tier_passes_after_every_job(copy):
    assert failures(copy) == []
