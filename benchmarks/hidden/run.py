"""The study: every case diagnosed, row by row into a store, on as many cores as one likes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed, parallel_config

from benchmarks.hidden.cases import Case, prepare
from benchmarks.hidden.draws import MaskedError
from benchmarks.hidden.fingerprint import study_fingerprint
from benchmarks.hidden.store import Row, RowFile
from rdpi_gym.diagnosis.results import Discovery, Finding
from rdpi_gym.measurement import Dataset

ROWS_FILE = "rows.jsonl"
Engine = Callable[[Dataset, int], Discovery]
"""Called with records and a seed."""


def discover_engine(dataset: Dataset, seed: int) -> Discovery:
    """Look for what is hidden as ``rdpi discover`` does, in this process."""
    from rdpi_gym.diagnosis.discover import discover

    return discover(dataset, jobs=1, seed=seed)


def run_study(
    cases: Sequence[Case],
    out: Path,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    engine: Engine = discover_engine,
    note: Callable[[str], None] | None = None,
) -> list[Row]:
    """Diagnose what is missing in the store and return the rows of all cases.

    Parameters
    ----------
    cases
        What is asked for.
    out
        Folder of the store; rows of code that has changed since are moved aside there.
    jobs
        Processes, of one thread each.
    progress
        Called with the number of cases done, and in all.
    engine
        What is put to the test.
    note
        Called with a sentence where rows were set aside.

    Raises
    ------
    InputError
        The folder cannot be used.
    """
    store = RowFile(out / ROWS_FILE)
    aside = store.set_aside(lambda row: row.get("code") != study_fingerprint())
    if aside is not None and note is not None:
        note(f"rows of code that has changed since were set aside in {aside}")
    missing = [case for case in cases if case.key not in store.rows]
    done = len(cases) - len(missing)
    if progress is not None:
        progress(done, len(cases))
    for row in _run(missing, jobs, engine):
        store.append(row)
        done += 1
        if progress is not None:
            progress(done, len(cases))
    return [store.rows[case.key] for case in cases]


def _run(cases: Sequence[Case], jobs: int, engine: Engine) -> Iterator[Row]:
    if jobs == 1:
        yield from (run_case(case, engine) for case in cases)
        return
    # one case at a time to a worker, each result as soon as it is there: rows are written early
    with parallel_config(backend="loky", inner_max_num_threads=1):
        parallel = Parallel(n_jobs=jobs, batch_size=1, return_as="generator_unordered")
        yield from parallel(delayed(run_case)(case, engine) for case in cases)


def run_case(case: Case, engine: Engine = discover_engine) -> Row:
    """Simulate one case, diagnose it, and return its row.

    A case that cannot be simulated (``masked``) or on which the engine fails (``failed``) is a row
    too.
    """
    row: Row = {
        "key": case.key,
        "study": case.study,
        "subject": list(case.subject),
        "number": case.number,
        "seed": case.seed,
        "variant": case.variant,
        "code": study_fingerprint(),
    }
    try:
        dataset, truth = prepare(case)
    except MaskedError as error:
        return row | {"status": "masked", "error": str(error)}
    row |= {"truth": truth, "noise_um": truth["noise_um"]}
    began = time.perf_counter()
    try:
        discovery = engine(dataset, case.seed)
    except Exception as error:  # one failure must not end a night of work, and it counts
        return row | {"status": "failed", "error": f"{type(error).__name__}: {error}"}
    return row | {"status": "done", "seconds": time.perf_counter() - began} | _found(discovery)


def _found(discovery: Discovery) -> dict[str, Any]:
    floor, unexplained = discovery.noise_floor_um, discovery.unexplained_rmse_um
    return {
        "floor_um": floor,
        "base_um": discovery.base.validation_rmse_um,
        # of the final model, after elimination; never below the noise floor that was found
        "validation_um": math.hypot(floor, unexplained),
        "verdict": discovery.verdict,
        "unexplained_um": unexplained,
        "ranking": [_finding(finding) for finding in discovery.rounds[0]]
        if discovery.rounds
        else [],
        "steps": [_finding(finding) | _details(finding) for finding in discovery.steps],
        "removed": list(discovery.removed),
        "remainder": discovery.remainder,
        "next_experiment": discovery.next_experiment,
        "notes": list(discovery.notes),
    }


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "effect": finding.effect,
        "validation_um": finding.errors.validation_rmse_um,
        "share": finding.share,
        "confidence": finding.confidence,
        "indistinguishable": list(finding.indistinguishable),
    }


def _details(finding: Finding) -> dict[str, Any]:
    return {
        "parameters": dict(finding.parameters),
        "standard_errors": dict(finding.standard_errors),
        "remarks": list(finding.remarks),
    }
