"""One case of the study, from its plant to its row."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from benchmarks.foreign_effects.cases import Case, Prepared, prepare
from benchmarks.foreign_effects.sentences import what_is_left
from benchmarks.hidden_effects.case_row import Engine, discover_engine, found, study_fingerprint
from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.store import Row
from rdpi_gym.virtual_lab.draws import MaskedError


def run_case(
    case: Case,
    engine: Engine = discover_engine,
    make: Callable[[Case], Prepared] = prepare,
) -> Row:
    """Take the records of a case, diagnose them, and return its row.

    A case that cannot be seen (``masked``), or on which reading or the engine fails (``failed``),
    is a row too.
    """
    row: Row = {
        "key": case.key,
        "study": case.study,
        "subject": list(case.subject),
        "number": case.number,
        "seed": case.seed,
        "code": study_fingerprint("foreign_effects"),
    }
    try:
        prepared = make(case)
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
    seconds = time.process_time() - began
    return (
        row
        | {"status": "done", "seconds": seconds}
        | found(discovery)
        | said(discovery)
        | {"true_left": what_is_left(discovery, prepared.records, case.subject)}
    )


def said(discovery: SearchResult) -> dict[str, Any]:
    """Return what a result says about what is left, about sampling and about the data, as JSON."""
    document = discovery.to_dict()
    names = ("left", "findings", "sampling", "undecided")
    kept = {name: document[name] for name in names if name in document}
    kept["numerical_floor_um"] = discovery.numerical_floor_um
    forms = {step["effect"]: step["form"] for step in document.get("steps", []) if step.get("form")}
    return kept | {"forms": forms}
