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
    """One data set to diagnose.

    Parameters
    ----------
    study
        One of the source's ``numbers``.
    subject
        Hidden effects, one thing outside the catalogue, or nothing.
    number
        Of the plant.
    seed
        Of the study.
    variant
        Change of the data set that must not change the diagnosis; empty where a source has none.
    """

    study: str
    subject: tuple[str, ...]
    number: int
    seed: int = 0
    variant: str = ""

    @property
    def key(self) -> str:
        """Name of the case in a store."""
        subject = "+".join(self.subject) or "nothing"
        key = f"{self.study}/{subject}/{self.number}/seed {self.seed}"
        return f"{key}/{self.variant}" if self.variant else key


@dataclass(frozen=True, eq=False)
class Prepared:
    """Records of a case.

    Parameters
    ----------
    dataset
        What the search gets.
    truth
        What is true of it, as JSON.
    records
        The simulated records with the truth at every sample, of sources that have it.
    """

    dataset: Dataset
    truth: dict[str, Any]
    records: tuple[Sampled, ...] = field(default=())


def nothing_more(discovery: SearchResult, prepared: Prepared, case: Case) -> dict[str, Any]:
    """Return no further fields of a row."""
    return {}


@dataclass(frozen=True)
class Source:
    """A source of truth: plants with known hidden effects, simulated apart from the package's kernels.

    Parameters
    ----------
    module
        Where it is defined, by name in this package.
    command
        Name of its command, and of its page.
    out
        Folder of its results.
    numbers
        Plants of each study.
    effects
        Effects that it can hide.
    cases
        Cases of studies, of a number of plants, with a seed and effects.
    prepare
        Records of a case.
    further
        Further fields of the row of a case.
    """

    module: str
    command: str
    out: Path
    numbers: Mapping[str, int]
    effects: tuple[str, ...]
    cases: Callable[[Sequence[str], int | None, int, Sequence[str]], list[Case]]
    prepare: Callable[[Case], Prepared]
    further: Callable[[SearchResult, Prepared, Case], dict[str, Any]] = nothing_more
