"""A reference that is scored is one file: nothing else lists it."""

import subprocess
import sys

import pytest

NEW = """
from benchmarks.tracking.case import Case
from rdpi_gym.signals import Sawtooth

def _sawtooth(amplitude_um, base_hz):
    signal = Sawtooth(amplitude_um=amplitude_um, frequency_hz=base_hz)
    return (Case.smooth(signal, base_hz, start_s=1.0 / base_hz, periods=3),)

REFERENCES = {"sawtooth": _sawtooth}
"""
ASK = """
import sys
from benchmarks.tracking import references
references.__path__.append(sys.argv[1])
from benchmarks.tracking.controllers import code_fingerprint
from benchmarks.tracking.run import benchmark
from benchmarks.tracking.selection import select
from pathlib import Path

selection = select(["none"], ["P5"], ["sawtooth"], [1e-3], [0])
rows = benchmark(selection, Path(sys.argv[1]) / "out", jobs=1).rows
print([(row["controller"], row["reference"], row["frequency_hz"], row["rmse_um"] > 0) for row in rows])
"""


@pytest.mark.slow
def test_a_new_reference_is_one_file(tmp_path):
    (tmp_path / "new.py").write_text(NEW)
    found = subprocess.run(
        [sys.executable, "-c", ASK, str(tmp_path)], capture_output=True, text=True, check=True
    )
    expected = [(name, "sawtooth", 10.0, True) for name in ("none", "full-preview-inversion")]
    assert found.stdout.strip() == str(expected)
