"""Cases of the study, their sources of truth, and the row of a case."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from rdpi_gym.diagnosis.results import Candidate, SearchResult
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.measurement.record import BoolArray
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.fingerprint import code_parts, fingerprint, room_files, used_files
from rdpi_gym.support.store import Row
from rdpi_gym.virtual_lab.draws import MaskedError


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
class Sampled:
    """One record with what is true of it at its samples."""

    record: Record  # as it will be given away
    # displacement without noise, and the part of it that follows from the input, ``(T,)``
    clean_um: Array
    by_input_um: Array
    is_sound: BoolArray  # samples whose measurement is what the sensor would show, ``(T,)``


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
    # what ``seconds`` of its rows are read from
    clock: Callable[[], float] = time.perf_counter


Engine = Callable[[Dataset, int], SearchResult]
"""Called with records and a seed."""

# What a row depends on; neither who runs the cases nor tables and pages made of rows are among it.
_ROOMS = ("plant", "signals", "measurement", "identification", "diagnosis", "virtual_lab")


def source_files(module: str) -> list[Path]:
    """Return the files of this package that the rows of a source depend on."""
    beside = (
        f"{__name__.rpartition('.')[0]}.{module}"  # the package's name as text would be all of it
    )
    return used_files([__name__, beside], Path(__file__).parents[1])


@cache
def study_fingerprint(module: str = "independent") -> str:
    """Return a hash of the code that the rows of a source depend on, its text for readers left out."""
    return fingerprint(code_parts([*room_files(*_ROOMS), *source_files(module)]))


def discover_engine(dataset: Dataset, seed: int) -> SearchResult:
    """Look for hidden effects as ``rdpi discover`` does, in this process."""
    from rdpi_gym.diagnosis.search.discover import discover

    return discover(dataset, jobs=1, seed=seed)


def run_case(case: Case, source: Source, engine: Engine = discover_engine) -> Row:
    """Simulate one case, diagnose it, and return its row.

    A case that cannot be seen (``masked``), or on which reading or the engine fails (``failed``),
    is a row too.
    """
    row: Row = {
        "key": case.key,
        "study": case.study,
        "subject": list(case.subject),
        "number": case.number,
        "seed": case.seed,
        **({"variant": case.variant} if case.variant else {}),
        "code": study_fingerprint(source.module),
    }
    try:
        prepared = source.prepare(case)
    except MaskedError as error:
        return row | {"status": "masked", "error": str(error)}
    except InputError as error:  # a file that a user would have, and that is refused
        return row | {"status": "failed", "error": f"{type(error).__name__}: {error}"}
    row |= {"truth": prepared.truth, "noise_um": prepared.truth["noise_um"]}
    began = source.clock()
    try:
        discovery = engine(prepared.dataset, case.seed)
    except Exception as error:  # one failure must not end a night of work, and it counts
        return row | {"status": "failed", "error": f"{type(error).__name__}: {error}"}
    row |= {"status": "done", "seconds": source.clock() - began}
    return row | found(discovery) | source.further(discovery, prepared, case)


def found(discovery: SearchResult) -> dict[str, Any]:
    """Return what a row says of a discovery, as JSON (errors in µm)."""
    floor, unexplained = discovery.noise_floor_um, discovery.unexplained_rmse_um
    return {
        "floor_um": floor,
        "base_um": discovery.base.validation_rmse_um,
        # of the final model, after elimination; never below the noise floor that was found
        "validation_um": math.hypot(floor, unexplained),
        "verdict": discovery.verdict,
        "unexplained_um": unexplained,
        "ranking": [_candidate(candidate) for candidate in discovery.candidates],
        # what a candidate leaves beside what was added before it
        "later_rounds": [
            {c.effect: c.errors.validation_rmse_um for c in tried if c.parameters}
            for tried in discovery.rounds[1:]
        ],
        "steps": [
            _candidate(added) | _details(added) | {"grade": discovery.grade(added)}
            for added in discovery.named
        ],
        "removed": list(discovery.removed),
        "probabilities": None
        if discovery.probabilities is None
        else discovery.probabilities.to_dict(),
        "remainder": discovery.remainder,
        "next_experiment": discovery.next_experiment,
        "notes": list(discovery.notes),
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    return {
        "effect": candidate.effect,
        "validation_um": candidate.errors.validation_rmse_um,
        "share": candidate.share,
        "confidence": candidate.confidence,
        "indistinguishable": list(candidate.indistinguishable),
    }


def _details(candidate: Candidate) -> dict[str, Any]:
    return {
        "parameters": dict(candidate.parameters),
        "standard_errors": dict(candidate.standard_errors),
        "remarks": list(candidate.remarks),
        "instead": dict(candidate.instead),
    }
