"""The search by one law beside today's, paired on plants of both studies, and PICMA on its four splits.

    python -m studies.one_law --plants 40 --seed 11 --picma

Plants are drawn over the strata of the study of foreign effects and, a fifth of them, of the study
of hidden effects. Each is diagnosed by both searches in one process each; times are processor time.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from benchmarks.effect_discovery.cases import Case, Source, found
from benchmarks.effect_discovery.foreign import FOREIGN
from benchmarks.effect_discovery.independent import INDEPENDENT
from benchmarks.effect_discovery.report import judge
from benchmarks.rows import run_rows, stored_rows
from rdpi_gym.diagnosis.beam import Diagnosis, diagnose
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.measurement import DATA_HINT, Dataset, load, measured_data
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.fingerprint import code_parts, fingerprint, room_files
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.store import Row
from rdpi_gym.virtual_lab.draws import MaskedError
from studies.measured_effects import splits
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results" / "one_law"
Engine = Literal["today", "beam"]
SHARES: Mapping[str, tuple[Source, str, float]] = {
    "single": (FOREIGN, "single", 0.3),
    "double": (FOREIGN, "double", 0.2),
    "triple": (FOREIGN, "triple", 0.1),
    "nothing": (FOREIGN, "none", 0.1),
    "outside": (FOREIGN, "outside", 0.1),
    "first study, single": (INDEPENDENT, "single", 0.1),
    "first study, pairs": (INDEPENDENT, "pairs", 0.1),
}
"""Strata: source, its study, and share of the plants."""


@dataclass(frozen=True)
class Unit:
    """One plant and one search."""

    stratum: str
    case: Case
    engine: Engine

    @property
    def key(self) -> str:
        """Name of its row."""
        return f"{self.engine}/{self.stratum}/{self.case.key}"


def units(plants: int, seed: int, engine: Engine) -> list[Unit]:
    """List the plants of all strata for one search; any beginning of them is a fair sample."""
    chosen: list[tuple[float, Unit]] = []
    for stratum, (source, study, share) in SHARES.items():
        count = max(round(share * plants), 1)
        cases = source.cases([study], count, seed, source.effects)
        step = max(len(cases) // count, 1)  # of the first study every subject has so many
        own = cases[::step][:count]
        chosen += [((k + 0.5) / count, Unit(stratum, case, engine)) for k, case in enumerate(own)]
    return [unit for _, unit in sorted(chosen, key=lambda each: each[0])]


def run_unit(unit: Unit, code: str) -> Row:
    """Diagnose one plant; one that cannot be seen, or a failure, is a row too."""
    case, source = unit.case, SHARES[unit.stratum][0]
    row: Row = {
        "key": unit.key, "engine": unit.engine, "stratum": unit.stratum, "study": case.study,
        "subject": list(case.subject), "number": case.number, "seed": case.seed, "code": code,
    }  # fmt: skip
    try:
        prepared = source.prepare(case)
    except (MaskedError, InputError) as error:
        return row | {"status": "masked", "error": str(error)}
    row |= {"truth": prepared.truth, "noise_um": prepared.truth["noise_um"]}
    began = time.process_time()
    try:
        said = ENGINES[unit.engine](prepared.dataset)
    except Exception as error:  # one failure must not end the study, and it counts
        return row | {"status": "failed", "error": f"{type(error).__name__}: {error}"}
    return row | {"status": "done", "seconds": time.process_time() - began} | said


def _today(dataset: Dataset) -> dict[str, Any]:
    result = discover(dataset, jobs=1)
    findings = [{"kind": finding.kind} for finding in result.findings]
    return found(result) | {"findings": findings, "core": result.plant.hysteresis.name}


def _beam(dataset: Dataset) -> dict[str, Any]:
    return said_of(diagnose(dataset))


def said_of(found: Diagnosis) -> dict[str, Any]:
    """Return what a row says of a diagnosis, in the fields that the studies judge."""
    graded = [
        {"effect": n.name, "form": n.form, "grade": n.grade, "probability": n.probability}
        for n in found.names
    ]
    named = [each for each in graded if each["grade"] in ("found", "likely")]
    return {
        "ranking": [{"effect": each["effect"]} for each in named or graded[:1]],
        "steps": named,
        "graded": graded[:8],
        "something_else": found.something_else,
        "validation_um": found.rmse_um,
        "floor_um": found.floor_um,
        "base_um": found.base_um,
        "sets": len(found.sets),
        "core": found.core[0],
        "findings": [{"kind": finding.kind} for finding in found.findings],
        "verdict": "",
    }


ENGINES: Mapping[Engine, Callable[[Dataset], dict[str, Any]]] = {"today": _today, "beam": _beam}
_ROOMS = ("plant", "measurement", "identification", "diagnosis")


def _code(engine: Engine) -> str:
    files = room_files(*_ROOMS)
    kept = files if engine == "beam" else [f for f in files if "beam" not in f.parts]
    return fingerprint(code_parts(kept))


def _rows(chosen: Namespace, engine: Engine) -> list[Row]:
    code, asked = _code(engine), units(chosen.plants, chosen.seed, engine)
    if chosen.tables:
        return stored_rows(asked, chosen.out / engine)
    run = partial(run_unit, code=code)
    with progress_bar() as show:
        return run_rows(asked, chosen.out / engine, run, code, chosen.jobs, show)


def judged(row: Row) -> dict[str, Any]:
    """Judge a row as the studies do, with the grades of wrong names."""
    verdict = judge(row)
    right = set(row["subject"]) | set(row.get("truth", {}).get("excused", ()))
    for name in row["subject"]:
        right |= set(row.get("truth", {}).get("alike", {}).get(name, ()))
    wrong = [
        s for s in row.get("steps", ()) if s["effect"] not in right or row["study"] == "outside"
    ]
    found = [s for s in wrong if s.get("grade", "found") == "found"]
    return {
        "engine": row["engine"], "stratum": row["stratum"], "subject": verdict["subject"],
        "form": verdict["form"], "degraded": verdict["degraded"], "status": row["status"],
        "named": verdict["steps"], "exact": bool(verdict["found_exact"]),
        "found": bool(verdict["found"]), "first_right": bool(verdict["first_right"]),
        "wrong": bool(wrong), "wrong_found": bool(found), "ratio": verdict["ratio"],
        "core": row.get("core", ""), "seconds": row.get("seconds"),
    }  # fmt: skip


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Shares by stratum and search (%), and the median ratio of processor times."""
    wide = rows.pivot_table(index=["stratum", "subject"], columns="engine", values="seconds")
    lines = []
    for stratum in (*dict.fromkeys(rows["stratum"]), "all"):
        part = rows if stratum == "all" else rows[rows["stratum"] == stratum]
        times = wide if stratum == "all" else wide.loc[[stratum]]
        line: dict[str, Any] = {"stratum": stratum, "plants": len(part) // 2}
        for name in ("exact", "found", "wrong", "wrong_found"):
            for engine in ENGINES:
                own = part[part["engine"] == engine]
                line[f"{name}, {engine}"] = round(100.0 * float(own[name].mean()), 1)
        line["time ratio"] = round(float((times["beam"] / times["today"]).median()), 2)
        lines.append(line)
    return pd.DataFrame(lines)


def picma(folder: Path, engine: Engine) -> list[dict[str, Any]]:
    """Diagnose PICMA on its four splits."""
    lines = []
    for name, dataset in splits(load(folder)).items():
        began = time.process_time()
        said = ENGINES[engine](dataset)
        lines.append({
            "split": name, "engine": engine, "error_um": said["validation_um"],
            "named": "+".join(f"{s['effect']} {s.get('grade', '')}".strip() for s in said["steps"]),
            "seconds": time.process_time() - began,
        })  # fmt: skip
    return lines


def _plant(row: Row) -> str:
    return str(row["key"]).partition("/")[2]


def _more(options: Options) -> None:
    options.add_argument(
        "--tables",
        action="store_true",
        help="write the tables of the rows that are there; run nothing",
    )
    options.add_argument(
        "--picma", action="store_true", help="diagnose PICMA on its splits as well"
    )


def _files(chosen: Namespace) -> Files:
    rows = [row for engine in ENGINES for row in _rows(chosen, engine)]
    both = set.intersection(*({_plant(r) for r in rows if r["engine"] == e} for e in ENGINES))
    frame = pd.DataFrame([judged(r) for r in rows if r["status"] == "done" and _plant(r) in both])
    text = (
        "# The search by one law beside today's\n\n"
        f"Made by `python -m studies.one_law --plants {chosen.plants} --seed {chosen.seed}`; the "
        f"{len(both)} plants that both have done, shares in per cent, processor time of the beam "
        "over that of today's search.\n\n"
        f"{frame_table(table(frame), digits=None, rule='plain')}\n"
    )
    files: dict[str, str | bytes | pd.DataFrame] = {"plants.csv": frame}
    folder = measured_data("picma")
    if chosen.picma and folder is None:
        raise InputError(f"no measured records; {DATA_HINT}")
    if chosen.picma and folder is not None:
        lines = [line for engine in ENGINES for line in picma(folder, engine)]
        files["picma.csv"] = pd.DataFrame(lines)
        text += f"\n## PICMA\n\n{frame_table(pd.DataFrame(lines), digits=3, rule='plain')}\n"
    return files | {"one_law.md": text}


main = Study(
    "one_law", __doc__, _files, RESULTS, seed=11, jobs=1, csv="%.6g",
    numbers=(("--plants", 40, "drawn over the strata"),), more=_more,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
