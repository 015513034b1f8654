"""``python -m studies.third_effects``: all cases of the third study, or a check of their draws."""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

import studies.third_effects as package
from benchmarks.effect_discovery.cases import Case, Engine, Prepared, discover_engine, found
from benchmarks.effect_discovery.foreign import FOREIGN, further_fields
from benchmarks.effect_discovery.report import (
    Target,
    foreign_targets,
    group_table,
    judge,
    name_targets,
)
from benchmarks.rows import ROWS_FILE, paragraphs
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.parallel import run_cases
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.store import Row, named_rows
from studies.runner import RESULTS, Files, Study, study_rows
from studies.third_effects.draws import is_drawn_as, make_cases, prepare, sums

OUT = RESULTS / "third"
DRAWN = "drawn.csv"
"""Sums of the records (V, µm), as they were drawn before the search that they judge."""
POINTS = 5.0
"""By which the figures of the second study may be missed (%)."""
_ROOMS = ("plant", "signals", "measurement", "identification", "diagnosis")
_COLUMNS = (
    "cases", "failed", "first_percent", "named_exact", "named_by_class", "wrong_found", "wrong",
    "explained", "sentences_true", "median_ratio", "median_seconds", "first_instead",
)  # fmt: skip


def draw(case: Case) -> Row:
    """Return the sums of a case."""
    prepared = prepare(case)
    return {
        "key": case.key,
        "records": len(prepared.dataset.records),
        "samples": prepared.truth["samples"],
        **sums(prepared.dataset),
    }


def stored_draws(folder: Path = OUT) -> dict[str, dict[str, float]]:
    """Return the committed sums by case."""
    path = folder / DRAWN
    if not path.is_file():
        raise InputError(f"{path} is missing; it holds the sums of the records: restore it")
    table = pd.read_csv(path, index_col="key")
    return {str(key): dict(row) for key, row in table.iterrows()}


def run_case(
    case: Case,
    code: str,
    drawn: Mapping[str, Mapping[str, float]],
    engine: Engine = discover_engine,
) -> Row:
    """Draw one case, search it, and return its row."""
    row: Row = {
        "key": case.key, "code": code, "study": case.study, "subject": list(case.subject),
        "number": case.number, "seed": case.seed,
    }  # fmt: skip
    prepared = prepare(case)
    if not is_drawn_as(sums(prepared.dataset), drawn[case.key]):
        raise InputError(f"{case.key} is not drawn as {OUT / DRAWN} says")
    row |= {"truth": prepared.truth, "noise_um": prepared.truth["noise_um"]}
    began = time.process_time()
    try:
        discovery = engine(prepared.dataset, case.seed)
    except Exception as error:  # one failure must not end a night of work, and it counts
        return row | {"status": "failed", "error": f"{type(error).__name__}: {error}"}
    row |= {"status": "done", "seconds": time.process_time() - began}
    return row | found(discovery) | _further(discovery, prepared, case)


def _further(discovery: Any, prepared: Prepared, case: Case) -> Row:
    document = discovery.to_dict()
    hidden = replace(case, subject=_effects(prepared.truth))
    return further_fields(discovery, prepared, hidden) | {
        "probabilities": document.get("probabilities") or {},
        "core": document.get("core") or {},
    }


def _effects(truth: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(h["effect"] for h in truth["hidden"])


def judge_row(row: Row) -> dict[str, Any]:
    """Judge one row: names, sentences and clocks as in the second study, and the kind of hysteresis."""
    truth, core = row["truth"], row.get("core", {})
    kinds = {core.get("kind"), *core.get("alike", ())}
    return judge(row | {"subject": list(_effects(truth))}) | {
        "subject": "+".join(row["subject"]) or "nothing",
        "kind_right": bool(kinds & set(truth["kinds"])) if truth["kinds"] else None,
    }


def page(rows: Sequence[Row], second: Sequence[Row]) -> str:
    """Return the page of the study, beside the rows of the second."""
    j = pd.DataFrame([judge_row(row) for row in rows])
    before = {(t.study, t.asks): t for t in foreign_targets(second)}
    figures = [
        {
            "study": t.study,
            "figure": t.asks,
            "asked of the second study": t.asked,
            "second study": _share(before[t.study, t.asks]),
            "this study": _share(t),
            f"within {POINTS:g} points": "yes" if _is_within(t, before[t.study, t.asks]) else "no",
        }
        for t in name_targets(j)
    ]
    kinds = j[j["study"] == "kind"].groupby("subject").agg(
        cases=("study", "size"), kind_right=("kind_right", _count)
    ).reset_index()  # fmt: skip
    faults = j[j["study"] == "fault"].groupby("subject").agg(
        cases=("study", "size"), noticed=("noticed", "sum"), findings=("findings", "unique")
    ).reset_index()  # fmt: skip
    code, seed = (", ".join(sorted({str(row[of]) for row in rows})) for of in ("code", "seed"))

    def shares(part: pd.DataFrame, *by: str) -> str:
        return frame_table(group_table(part, by, _COLUMNS))

    return paragraphs(
        [
            "# The third study: forms, protocols and faults of neither other",
            f"Written by `python -m studies.third_effects`; {len(rows)} cases, seed {seed}, code {code}.",
            frame_table(pd.DataFrame(figures)),
            "## By study",
            shares(j, "study"),
            "## Single effects",
            shares(j[j["study"] == "single"], "subject"),
            "## Outside the catalogue",
            shares(j[j["study"] == "outside"], "subject"),
            "## Kinds of hysteresis",
            frame_table(kinds),
            "## Faults of records",
            frame_table(faults.assign(findings=faults["findings"].map(_joined))),
        ]
    )


def _count(right: pd.Series[Any]) -> str:
    """Count the cases whose kind is right, where the catalogue has it."""
    return "no name" if right.isna().all() else str(int(right.sum()))


def _joined(findings: Iterable[str]) -> str:
    return ", ".join(filter(None, findings)) or "none"


def _share(target: Target) -> str:
    return f"{target.reached_percent:.1f} % ({target.reached} of {target.cases})"


def _is_within(target: Target, before: Target) -> bool:
    """Whether a share is worse than before by no more than the points that are asked for."""
    change = target.reached_percent - before.reached_percent
    return (-change if target.at_most else change) >= -POINTS


def _files(asked: Namespace) -> Files:
    cases = make_cases()
    if not asked.check:
        run = partial(run_case, drawn=stored_draws())
        rows = study_rows(cases, run, asked, _ROOMS, sorted(Path(package.__path__[0]).glob("*.py")))
        second = named_rows(FOREIGN.out / ROWS_FILE).rows.values()
        return {f"{main.name}.md": page(rows, list(second))}
    drawn: list[Row] = []
    with progress_bar() as show:
        for row in run_cases(draw, cases, asked.jobs):
            drawn.append(row)
            show("drawing", len(drawn), len(cases))
    if not (OUT / DRAWN).exists():
        return {DRAWN: pd.DataFrame(drawn)}
    stored = stored_draws()
    other = [row["key"] for row in drawn if not is_drawn_as(row, stored[row["key"]])]
    if other:
        raise InputError(
            f"{len(other)} of {len(drawn)} cases are not drawn as {OUT / DRAWN} says: {', '.join(other[:3])}"
        )
    print(f"{len(drawn)} cases are drawn as {OUT / DRAWN} says")
    return {}


def _more(options: Options) -> None:
    options.add_argument(
        "--check", action="store_true", help="draw and validate all cases, without a search"
    )


main = Study("third_effects", package.__doc__, _files, OUT, jobs=2, csv="%.9g", more=_more)

if __name__ == "__main__":
    sys.exit(main())
