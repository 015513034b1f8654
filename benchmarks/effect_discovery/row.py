"""The row of a case, from its plant to what was found."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.effect_discovery.cases import Case, Source
from rdpi_gym.diagnosis.results import Candidate, SearchResult
from rdpi_gym.measurement import Dataset
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.fingerprint import code_parts, fingerprint, room_files, used_files
from rdpi_gym.support.store import Row
from rdpi_gym.virtual_lab.draws import MaskedError

Engine = Callable[[Dataset, int], SearchResult]
"""Called with records and a seed."""

# What a row depends on; neither who runs the cases nor tables and pages made of rows are among it.
_ROOMS = ("plant", "signals", "measurement", "identification", "diagnosis", "virtual_lab")


@cache
def study_fingerprint(module: str = "independent") -> str:
    """Return a hash of the code that the rows of a source depend on, its text for readers left out."""
    own = used_files(
        [f"benchmarks.effect_discovery.{name}" for name in ("row", module)],
        Path(__file__).parents[1],
    )
    return fingerprint(code_parts([*room_files(*_ROOMS), *own]))


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
    began = time.process_time()
    try:
        discovery = engine(prepared.dataset, case.seed)
    except Exception as error:  # one failure must not end a night of work, and it counts
        return row | {"status": "failed", "error": f"{type(error).__name__}: {error}"}
    row |= {"status": "done", "seconds": time.process_time() - began}
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
        "steps": [_candidate(added) | _details(added) for added in discovery.added],
        "removed": list(discovery.removed),
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
