"""What is scored: the references of every file in ``references``, the seeds, the sampling times."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

from benchmarks.tracking import references as folder
from benchmarks.tracking.case import Case, References
from rdpi_gym.support.plugins import modules_of

SUITE_VERSION = 2
SEEDS = 5
TS_S = (5e-5, 1e-4, 2e-4, 1e-3)
"""Sampling times (s) of a plant that was identified at rates like those of references about 10 Hz."""
SLOW_TS_S = (1e-3, 5e-3)
"""Those (s) of a plant that was identified only at lower rates; references are about 1 Hz there."""


def _found() -> References:
    stated = [module.REFERENCES for module in modules_of(folder.__name__)]
    return MappingProxyType({name: make for each in stated for name, make in each.items()})


REFERENCES = _found()
"""What makes the cases of a reference, by its name."""


def cases(references: Sequence[str], amplitude_um: float, base_hz: float) -> tuple[Case, ...]:
    """Build the cases of some references."""
    return tuple(case for name in references for case in REFERENCES[name](amplitude_um, base_hz))
