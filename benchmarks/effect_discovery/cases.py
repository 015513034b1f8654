"""Cases of the study, and the sources of truth that make their records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.measurement import Dataset

if TYPE_CHECKING:
    from benchmarks.effect_discovery.degradations import Sampled


@dataclass(frozen=True)
class Case:
    """One data set to diagnose."""

    study: str  # one of the source's ``numbers``
    subject: tuple[str, ...]  # hidden effects, one thing outside the catalogue, or nothing
    number: int  # of the plant
    seed: int = 0  # of the study
    # change of the data set that must not change the diagnosis; empty where a source has none
    variant: str = ""

    @property
    def key(self) -> str:
        """Name of the case in a store."""
        subject = "+".join(self.subject) or "nothing"
        key = f"{self.study}/{subject}/{self.number}/seed {self.seed}"
        return f"{key}/{self.variant}" if self.variant else key


@dataclass(frozen=True, eq=False)
class Prepared:
    """Records of a case."""

    dataset: Dataset  # what the search gets
    truth: dict[str, Any]  # what is true of it, as JSON
    # the simulated records with the truth at every sample, of sources that have it
    records: tuple[Sampled, ...] = field(default=())


def nothing_more(discovery: SearchResult, prepared: Prepared, case: Case) -> dict[str, Any]:
    """Return no further fields of a row."""
    return {}


@dataclass(frozen=True)
class Source:
    """A source of truth: plants with known hidden effects, simulated apart from the package's kernels."""

    module: str  # where it is defined, by name in this package
    command: str  # name of its command, and of its page
    out: Path  # folder of its results
    numbers: Mapping[str, int]  # plants of each study
    effects: tuple[str, ...]  # effects that it can hide
    # cases of studies, of a number of plants, with a seed and effects
    cases: Callable[[Sequence[str], int | None, int, Sequence[str]], list[Case]]
    prepare: Callable[[Case], Prepared]  # records of a case
    # further fields of the row of a case
    further: Callable[[SearchResult, Prepared, Case], dict[str, Any]] = nothing_more
