"""A rival without refits: E-SINDy on plants of the second study, `python -m studies.sindy_rival`.

What the base model leaves is put to a sparse regression (Fasel, Kutz, Brunton, Brunton, "Ensemble-SINDy",
Proc. R. Soc. A 478, 2022; PySINDy, which `pip install 'rdpi-gym[sindy]'` brings). Its library is what
each effect of the catalogue, at each of the starts that our own search refits it from, changes in the
displacement, the nearest of them; the plays' weights are free beside it. Which columns stay is asked of
resampled rows; how small a coefficient may be, of blocks of the records that are held out. So the rival has our physics and our data, and lacks
what a search adds: forms, refits, splits. An interrupted run continues.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.diagnosis.signatures import (
    best_sparse_models,
    library_of,
    nearest_places,
    signature_rows,
)
from benchmarks.effect_discovery.__main__ import part_of
from benchmarks.effect_discovery.cases import Case
from benchmarks.effect_discovery.foreign import FOREIGN, NUMBERS, make_cases, prepare
from benchmarks.effect_discovery.report import judge
from benchmarks.rows import ROWS_FILE
from rdpi_gym.diagnosis.beam.evidence import Evidence
from rdpi_gym.diagnosis.beam.models import Visited
from rdpi_gym.diagnosis.beam.search import begun
from rdpi_gym.measurement import Record, hold_out_blocks
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.store import Row, named_rows
from rdpi_gym.virtual_lab.draws import MaskedError
from studies.calibration import calibration_error
from studies.runner import Files, Study, study_rows

RESULTS = Path(__file__).parent / "results" / "sindy_rival"
# Share of the resampled models that a column has to be in.
_INCLUDED = 0.5
_ROOMS = ("plant", "signals", "measurement", "identification", "diagnosis")


def run_case(case: Case, code: str) -> Row:
    """Ask E-SINDy what is missing on one plant, and return the row."""
    row: Row = {
        "key": case.key, "code": code, "study": case.study, "subject": list(case.subject),
        "number": case.number, "seed": case.seed,
    }  # fmt: skip
    try:
        prepared = prepare(case)
    except (MaskedError, InputError) as error:
        return row | {"status": "masked", "error": str(error)}
    row |= {"truth": prepared.truth, "noise_um": prepared.truth["noise_um"]}
    began = time.process_time()
    try:
        evidence = Evidence.of(prepared.dataset)
        chances, sizes = included(evidence, begun(evidence), case.number)
    except InputError as error:
        return row | {"status": "failed", "error": str(error)}
    names = sorted(chances, key=lambda name: (-chances[name], -sizes[name]))
    ranking = [{"effect": name, "confidence": chances[name]} for name in names]
    return row | {
        "status": "done", "seconds": time.process_time() - began, "ranking": ranking,
        "steps": ranking[: sum(chances[name] >= _INCLUDED for name in names)],
        # a regression has neither a verdict nor a sentence about what is left
        "validation_um": prepared.truth["noise_um"], "verdict": "unexplained",
        "true_left": {"clean_um": 0.0, "by_input_um": 0.0},
    }  # fmt: skip


def included(
    evidence: Evidence, base: Visited, seed: int
) -> tuple[dict[str, float], dict[str, float]]:
    """Return by effect the share of resampled regressions that have it, and its size there (µm rms)."""
    library = library_of(CATALOGUE, evidence.scale)
    fitted, asked = (signature_rows(base.fit.variant, library, part) for part in _blocks(evidence))
    noise_um = evidence.floor_um(base.lefts)
    moving = nearest_places(library, *fitted, 1e-3 * noise_um)
    size = np.sqrt(np.mean(fitted[0] ** 2, axis=0))[moving]
    x, held = (part[0][:, moving] / size for part in (fitted, asked))
    models = best_sparse_models(x, fitted[1], held, asked[1], noise_um, seed)
    inside = dict(zip((library[k][0] for k in moving), models.T, strict=True))
    still = np.zeros(1)
    chances = {name: float(np.mean(inside.get(name, still) != 0.0)) for name in CATALOGUE}
    sizes = {name: float(abs(np.median(inside.get(name, still)))) for name in CATALOGUE}
    return chances, sizes


def _blocks(evidence: Evidence) -> tuple[Sequence[Record], Sequence[Record]]:
    """Records to fit and to judge by: blocks of each that are held out."""
    if evidence.dataset.holds_out_quarters:
        return evidence.train, evidence.validation
    every = dict.fromkeys((*evidence.train, *evidence.validation))
    fitted, held = zip(*map(hold_out_blocks, every), strict=True)
    return fitted, held


def _study(asked: Namespace) -> Files:
    try:
        import pysindy as _  # noqa: F401
    except ImportError:
        raise InputError(
            "PySINDy is not installed; install it with: pip install 'rdpi-gym[sindy]'"
        ) from None
    cases = part_of(make_cases(list(NUMBERS), None, asked.seed), asked.part)
    rows = study_rows(cases, run_case, asked, _ROOMS, [Path(__file__)])
    keys = {row["key"] for row in rows if row["status"] == "done"}
    ours = [r for k, r in named_rows(asked.ours / ROWS_FILE).rows.items() if k in keys]
    by_name = {"E-SINDy": rows, "this laboratory": ours}
    return {"sindy_rival.md": report(by_name, asked.part, asked.seed)}


def report(by_name: Mapping[str, Sequence[Row]], part: str, seed: int) -> str:
    """Return the table as Markdown."""
    said = []
    for name, rows in by_name.items():
        done = [row for row in rows if row["status"] == "done"]
        frame = pd.DataFrame([judge(row) for row in done])
        single, double = (frame[frame["study"] == study] for study in ("single", "double"))
        none = frame[frame["study"] == "none"]
        there = [
            {h["effect"] for h in r["truth"]["hidden"]} | set(r["truth"]["excused"]) for r in done
        ]
        steps = [
            (step["confidence"], step["effect"] in names)
            for row, names in zip(done, there, strict=True)
            for step in row["steps"]
        ]
        chances, true = (np.array(column, dtype=np.float64) for column in zip(*steps, strict=True))
        said.append(
            {
                "": name, "plants": len(frame),
                "single: first right": _of(single["first_exact"] | single["first_by_class"]),
                "double: both named": _of(double["found_exact"] | double["found_by_class"]),
                "nothing hidden: nothing named": _of(none["additions"] == 0),
                "something falsely added": _of(frame["additions"] > 0),
                "calibration error of its confidence (%)": round(100 * calibration_error(chances, true), 1),
                "s a plant": round(float(frame["seconds"].median()), 1),
            }
        )  # fmt: skip
    return (
        f"# A rival: E-SINDy on the same plants\n\n{frame_table(pd.DataFrame(said))}\n\n"
        "Confidence: of E-SINDy the share of resampled models that have an effect, of the laboratory "
        "the share of splits in which it wins. The laboratory's probabilities are made of more than "
        "that: `python -m studies.calibration`.\n\n"
        f"Made by `python -m studies.sindy_rival --part {part} --seed {seed}`.\n"
    )


def _of(right: pd.Series[bool]) -> str:
    return f"{int(right.sum())} of {len(right)}"


def _more(options: Options) -> None:
    options.add_argument("--part", default="1/8", help="part of the second study's cases")
    meaning = "rows of the search, to compare"
    options.add_argument("--ours", type=Path, default=FOREIGN.out, metavar="DIR", help=meaning)


main = Study("sindy_rival", __doc__, _study, RESULTS, 2027, 2, more=_more)

if __name__ == "__main__":
    sys.exit(main())
