"""``python -m studies.third_effects``: all cases of the third study, or a check of their draws."""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import pandas as pd

import studies.third_effects as package
from benchmarks.effect_discovery.cases import Case, Engine, Prepared, discover_engine, found
from benchmarks.effect_discovery.foreign import further_fields
from benchmarks.effect_discovery.report import group_table, judge
from benchmarks.rows import paragraphs
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.parallel import run_cases
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.store import Row
from studies.runner import RESULTS, Files, Study, study_rows
from studies.third_effects.draws import SEED, is_drawn_as, make_cases, prepare, sums

OUT = RESULTS / "third"
DRAWN = "drawn.csv"
"""Sums of the records (V, µm), as they were drawn before the search that they judge."""
FOUND, LIKELY = 0.9, 0.5
"""Probabilities from which on an effect is found, or likely."""
_ROOMS = ("plant", "signals", "measurement", "identification", "diagnosis")
_COLUMNS = (
    "cases", "failed", "first_percent", "named_exact", "named_by_class", "wrong", "explained",
    "sentences_true", "median_ratio", "median_seconds", "first_instead",
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
    """Judge one row: effects as in the other studies, kinds, faults and wrong names by their grade."""
    truth = row["truth"]
    judged = judge(row | {"subject": list(_effects(truth))})
    right = {*_effects(truth), *truth["excused"], *chain.from_iterable(truth["alike"].values())}
    stated = row.get("probabilities", {}).get("effects", {})
    wrong = [p for name, p in stated.items() if name not in right]
    core = row.get("core", {})
    kinds = {core.get("kind"), *core.get("alike", ())}
    return judged | {
        "subject": "+".join(row["subject"]) or "nothing",
        "wrong_found": any(p >= FOUND for p in wrong),
        "wrong_likely": any(p >= LIKELY for p in wrong),
        "kind_right": bool(kinds & set(truth["kinds"])) if truth["kinds"] else None,
        "other": row.get("probabilities", {}).get("other"),
        "noticed": bool(judged["findings"]),
    }


def page(rows: Sequence[Row]) -> str:
    """Return the page of the study."""
    j = pd.DataFrame([judge_row(row) for row in rows])
    grades = j.groupby("study", sort=False).agg(
        cases=("study", "size"), wrong_found=("wrong_found", "sum"),
        wrong_likely=("wrong_likely", "sum"), mean_other=("other", "mean"),
    ).reset_index()  # fmt: skip
    kinds = j[j["study"] == "kind"].groupby("subject").agg(
        cases=("study", "size"), kind_right=("kind_right", "sum")
    ).reset_index()  # fmt: skip
    sound = j[j["study"].isin(("none", "single", "double", "triple"))]
    faults = j[j["study"] == "fault"].groupby("subject").agg(
        cases=("study", "size"), noticed=("noticed", "sum")
    ).reset_index()  # fmt: skip
    code = ", ".join(sorted({row["code"] for row in rows}))
    return paragraphs(
        [
            "# The third study: forms, protocols and faults of neither other",
            f"Written by `python -m studies.third_effects`; {len(rows)} cases, seed {SEED}, code {code}.",
            frame_table(group_table(j, ["study"], _COLUMNS)),
            f"Names that are wrong with a probability of {FOUND:.0%} (found) or {LIKELY:.0%} (likely):",
            frame_table(grades),
            "## Outside the catalogue, and kinds",
            frame_table(group_table(j[j["study"] == "outside"], ["subject"], _COLUMNS)),
            frame_table(kinds),
            "## Faults",
            f"Findings on records without a fault: {int(sound['noticed'].sum())} of {len(sound)}.",
            frame_table(faults),
        ]
    )


def _files(asked: Namespace) -> Files:
    cases = make_cases()
    if not asked.check:
        run = partial(run_case, drawn=stored_draws())
        rows = study_rows(cases, run, asked, _ROOMS, sorted(Path(package.__path__[0]).glob("*.py")))
        return {f"{main.name}.md": page(rows)}
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
