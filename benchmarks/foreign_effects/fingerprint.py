"""Fingerprint: whether a stored row still says what the code does."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rdpi_gym.support.fingerprint import code_parts, fingerprint, room_files

# What a row depends on; tables made of rows are not among it.
_ROOMS = ("plant", "signals", "measurement", "identification", "diagnosis", "virtual_lab")
_STUDY = (
    "case_row", "cases", "chain", "degradations", "drives", "forms", "outside", "physics", "plants",
    "protocols", "sentences", "visible",
)  # fmt: skip

_OF_THE_FIRST = ("case_row", "outside")  # what is taken from the first study


@cache
def study_fingerprint() -> str:
    """Return a hash of the code that a row depends on; comments, docstrings and imports are not."""
    here = Path(__file__).parent
    own = [here / f"{name}.py" for name in _STUDY]
    own += [here.parent / "hidden_effects" / f"{name}.py" for name in _OF_THE_FIRST]
    return fingerprint(code_parts([*room_files(*_ROOMS), *own]))
