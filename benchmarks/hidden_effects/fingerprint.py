"""Fingerprint: whether a stored row still says what the code does."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rdpi_gym.support.fingerprint import code_parts, fingerprint, room_files

# What a row depends on; neither who runs the cases nor tables and pages made of rows are among it.
_ROOMS = ("plant", "signals", "measurement", "identification", "diagnosis", "virtual_lab")
_STUDY = ("case_row", "cases", "outside", "plants", "transform")


@cache
def study_fingerprint() -> str:
    """Return a hash of the code that a row depends on; comments, docstrings and imports are not."""
    here = Path(__file__).parent
    own = [here / f"{name}.py" for name in _STUDY]
    return fingerprint(code_parts([*room_files(*_ROOMS), *own]))
