"""Fingerprint: whether a stored row still says what the code does."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import rdpi_gym
from rdpi_gym.support.fingerprint import code_parts, fingerprint

# What a row depends on; neither who runs the cases nor tables and pages made of rows are among it.
_ROOMS = ("plant", "signals", "measurement", "identification", "diagnosis", "virtual_lab")
_STUDY = ("case_row", "cases", "outside", "plants", "transform")


@cache
def study_fingerprint() -> str:
    """Return a hash of the code that a row depends on; comments, docstrings and imports are not.

    Examples
    --------
    >>> len(study_fingerprint())
    16
    """
    here = Path(__file__).parent
    files = [f for room in _ROOMS for f in Path(rdpi_gym.__file__).parent.glob(f"{room}/**/*.py")]
    return fingerprint(code_parts([*files, *(here / f"{name}.py" for name in _STUDY)]))
