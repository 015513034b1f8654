"""Runs of the benchmark: diagnosers on drawn plants, the rows of an interrupted run kept."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.diagnosis.answers import Answer, checked_answer
from benchmarks.diagnosis.draws import drawn_cases
from benchmarks.diagnosis.entries import base_model, find_diagnoser, named_diagnosers, simulated
from benchmarks.diagnosis.scoring import (
    UNINFORMED,
    explained,
    losses,
    mean_square,
    outcomes_of,
    withheld,
)
from benchmarks.diagnosis.worker import DiagnoserFailed, diagnose_apart
from benchmarks.rows import Outcome, RowFormat, complete, paragraphs
from benchmarks.stages.isolation import own_code
from benchmarks.stages.run import TestSeed
from benchmarks.tracking.episode import one_line
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.fingerprint import code_parts, fingerprint, room_files, used_files
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row
from rdpi_gym.support.words import quoted
from rdpi_gym.virtual_lab.draws import MaskedError

PLANTS = 20
"""Plants where no number is given."""
_ROOMS = ("plant", "signals", "measurement", "identification", "diagnosis", "virtual_lab")
DiagnosisKey = tuple[str, str, int]
"""Diagnoser, draws, number of the plant."""


def _key(row: Mapping[str, Any]) -> DiagnosisKey:
    if type(row["plant"]) is not int:
        raise TypeError(f"plant is {row['plant']!r}")
    return str(row["diagnoser"]), str(row["draws"]), row["plant"]


DIAGNOSES = RowFormat(
    "diagnosis-rows.jsonl",
    "rdpi-diagnosis-rows",
    _key,
    ("diagnoser", "draws", "study", "stamp", "failure"),
    ("log_loss", "brier", "false_names", "hidden", "found", "explained", "seconds"),
)
"""One diagnoser on one drawn plant."""


@dataclass(frozen=True)
class Unit:
    """One diagnoser on one plant."""

    diagnoser: str
    seed: int
    draws: str  # the seed in words
    plant: int
    stamp: str
    # of a private seed it runs in a process of its own, with a copy of its code, if it has any
    is_apart: bool = False
    code: Path | None = None

    @property
    def key(self) -> DiagnosisKey:
        """Name of the row."""
        return self.diagnoser, self.draws, self.plant


def run_unit(unit: Unit) -> list[Row]:
    """Diagnose one plant and score the answer; a diagnoser that fails is a row that says why."""
    source, case = drawn_cases(unit.seed)[unit.plant]
    row: Row = {
        "diagnoser": unit.diagnoser, "draws": unit.draws, "plant": unit.plant,
        "study": f"{source.module} {case.study}", "stamp": unit.stamp, "failure": "",
    }  # fmt: skip
    try:
        prepared = source.prepare(case)
        given, asked = withheld(prepared.dataset)
        base = Answer({}, 0.0, partial(simulated, base_model(given)))
        reference = mean_square(base, asked)
    except (MaskedError, InputError):  # a plant that nobody can be asked about
        return [row | {"study": MASKED}]
    true = outcomes_of(case, prepared.truth)
    try:
        answer, row["seconds"] = _answer(unit, given, asked)
        left = mean_square(answer, asked)
    except Exception as error:  # a stranger's code may raise anything
        kind = "" if isinstance(error, DiagnoserFailed) else f"{type(error).__name__}: "
        reason = one_line(f"{kind}{error}")
        brier = 0.25 * UNINFORMED / math.log(2.0)
        return [
            row
            | {"failure": reason, "log_loss": UNINFORMED, "brier": brier, "false_names": 0,
               "hidden": len(true.there), "found": 0, "explained": 0.0}
        ]  # fmt: skip
    share = explained(reference, left, float(prepared.truth["noise_um"]))
    return [row | losses(answer, true) | {"explained": share}]


def _answer(unit: Unit, given: Dataset, asked: Sequence[Record]) -> tuple[Answer, float]:
    """Return the answer of a diagnoser, and the processor time (s) that it took."""
    if unit.is_apart:
        told = diagnose_apart(unit.diagnoser, unit.code, given, asked)
        return told.answer, told.seconds
    began = time.process_time()
    answer = checked_answer(find_diagnoser(unit.diagnoser)(given))
    return answer, time.process_time() - began


MASKED = "masked"
"""Study of a plant whose effects no draw shows, or whose records the base model cannot be fitted to."""


def run_diagnosers(
    diagnosers: Sequence[str],
    plants: int,
    out: Path,
    *,
    seed: TestSeed | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
    ray_address: str | None = None,
) -> Outcome:
    """Compute the rows that a folder does not have, and return all that were asked for."""
    drawn = TestSeed() if seed is None else seed
    most = len(drawn_cases(drawn.seed))
    if not 1 <= plants <= most:
        raise InputError(f"--draws is {plants}; give 1 to {most} plants")
    names = named_diagnosers(diagnosers)
    codes = {name: own_code(name) if ":" in name else None for name in names}
    if not drawn.is_public:
        for name, code in codes.items():
            if ":" in name and code is None:
                raise InputError(
                    f"{quoted(name)} is not of a single file; write a diagnoser as one module, "
                    "for example my_diagnoser.py"
                )
    stamped = {name: _stamp(name, code) for name, code in codes.items()}
    units = [
        Unit(name, drawn.seed, drawn.label, plant, stamped[name], not drawn.is_public, codes[name])
        for plant in range(plants)
        for name in names
    ]
    store, notes, stamps = DIAGNOSES.open(out), list[str](), {u.key: u.stamp for u in units}
    computed = complete(
        store, units, run_unit, lambda unit: [unit.key],
        lambda row: stamps.get(_key(row), row["stamp"]) != row["stamp"],
        name=_key, note=notes.append,
        stale="Rows of changed code or diagnosers were set aside in {.name}.", stage="diagnosing",
        jobs=jobs, progress=progress, ray_address=ray_address,
    )  # fmt: skip
    return Outcome([store.rows[unit.key] for unit in units], computed, tuple(notes))


def _stamp(name: str, code: Path | None) -> str:
    """Return a hash of the code that the rows of a diagnoser depend on."""
    own = b"" if code is None else code.read_bytes()
    return fingerprint([_code().encode(), name.encode(), own])


@cache
def _code() -> str:
    used = used_files([__name__], Path(__file__).parents[1])
    return fingerprint(code_parts([*room_files(*_ROOMS), *used]))


# --- tables ---

LEGEND = (
    "Log loss and Brier score: of the probabilities of 15 effects and of something else, summed, a "
    "plant's mean; smaller is better. False names: effects with a probability of one half or more "
    "that are not there, in 100 plants. Found: of the hidden effects, how many have one half or "
    "more. Explained: median share of the squared error between base model and noise that a "
    "prediction of withheld records explains. Seconds: median processor time a plant."
)


def ranking(rows: Sequence[Row]) -> pd.DataFrame:
    """Return the table of diagnosers, the smallest log loss first."""
    lines = []
    for name, part in _scored(rows).groupby("diagnoser", sort=False):
        losses_of = part["log_loss"]
        lines.append(
            {
                "diagnoser": name,
                "plants": len(part),
                "log loss": losses_of.mean(),
                "± (95 %)": 1.96 * losses_of.std(ddof=1) / math.sqrt(len(part)),
                "Brier": part["brier"].mean(),
                "false names": 100.0 * part["false_names"].mean(),
                "found (%)": 100.0 * part["found"].sum() / max(part["hidden"].sum(), 1),
                "explained (%)": 100.0 * part["explained"].astype(float).median(),
                "seconds": part["seconds"].astype(float).median(),
                "failed": int((part["failure"] != "").sum()),
            }
        )
    table = pd.DataFrame(lines)
    return table.sort_values("log loss", ignore_index=True).round(3) if lines else table


def firsts(rows: Sequence[Row]) -> pd.DataFrame:
    """Return who is first at what: the mean log loss of each study by diagnoser, and the smallest."""
    table = _scored(rows).pivot_table("log_loss", "study", "diagnoser", sort=False)
    return table.round(3).assign(first=table.idxmin(axis=1)).reset_index()


def _scored(rows: Sequence[Row]) -> pd.DataFrame:
    frame = pd.DataFrame([row for row in rows if row["study"] != MASKED])
    return frame.reindex(columns=[*DIAGNOSES.texts, *DIAGNOSES.numbers, "plant"])


def write_page(rows: Sequence[Row], out: Path, command: str) -> Path:
    """Write the tables as a page."""
    draws = ", ".join(dict.fromkeys(row["draws"] for row in rows))
    masked = len({row["plant"] for row in rows if row["study"] == MASKED})
    page = paragraphs(
        [
            "# Who diagnoses best",
            f"Written by `{command}`; {draws}; {masked} plants that cannot be asked about are left out.",
            frame_table(ranking(rows)),
            LEGEND,
            "## Who is first at what",
            "Mean log loss by study and number of hidden effects:",
            frame_table(firsts(rows)),
        ]
    )
    return write_atomic(out / "diagnosis.md", page)
