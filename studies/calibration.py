"""Calibration of the probabilities of searches: `python -m studies.calibration`.

The searches of the first study (`benchmarks.hidden_effects`), of the second
(`benchmarks.foreign_effects`) and of the third (`studies.third_effects`) state how probable each effect,
something outside the catalogues of effects and kinds, and nothing is. The tables hold that beside how
often it was true.
"""

from __future__ import annotations

import math
import sys
from argparse import Namespace
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.effect_discovery.foreign import FOREIGN
from benchmarks.effect_discovery.independent import INDEPENDENT
from benchmarks.rows import ROWS_FILE
from rdpi_gym.plant import CORES
from rdpi_gym.report.chart import Axis, Panel, Series, side_by_side
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.report.style import MUTED, PALETTE
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.store import Row, named_rows
from studies.chromium import small_png
from studies.runner import Files, Study
from studies.third_effects.__main__ import OUT

RESULTS = Path(__file__).parent / "results" / "calibration"
FOLDERS = {"first": INDEPENDENT.out, "second": FOREIGN.out, "third": OUT}
"""Rows of each study."""
_BINS = 10
KINDS = {
    "added": "an effect that was added",
    "class": "an effect that was added, or one indistinguishable from it",
    "not added": "an effect that was tried and not added",
    "other": "something outside the catalogues of effects and kinds",
    "none": "no missing effect",
}
"""Events of the probabilities, by their names in the tables."""


def answers(row: Row) -> dict[str, list[tuple[float, bool]]]:
    """Return probabilities that a search stated, each with what is true, by what is asked."""
    truth: Mapping[str, Any] = row["truth"]
    no_effect = row["study"] == "outside"
    outside = no_effect and row["subject"][0].replace("-", "_") not in CORES
    outside |= row["study"] == "kind" and not truth["kinds"]
    hidden = frozenset() if no_effect else frozenset(h["effect"] for h in truth["hidden"])
    there = hidden | frozenset(truth.get("excused", ()))
    alike = frozenset(n for names in truth.get("alike", {}).values() for n in names)
    stated, added = row["probabilities"], {step["effect"]: step for step in row["steps"]}
    rivals = {n: frozenset((n, *step["indistinguishable"])) for n, step in added.items()}
    return {
        "added": [(p, n in there) for n, p in stated["effects"].items() if n in added],
        "class": [
            (stated["classes"][n], bool(those & (there | alike))) for n, those in rivals.items()
        ],
        "not added": [(p, n in there) for n, p in stated["effects"].items() if n not in added],
        "other": [(stated["something else"], outside)],
        "none": [(stated["none"], not hidden and not outside)],
    }


def calibration_error(chances: Array, true: Array) -> float:
    """Return the mean distance of probability and frequency, over ten bins of equal counts."""
    order = np.argsort(chances, kind="stable")
    parts = np.array_split(order, min(_BINS, len(order)))
    gaps = [abs(float(np.mean(chances[k]) - np.mean(true[k]))) * len(k) for k in parts]
    return round(sum(gaps) / len(order), 12)


def _study(asked: Namespace) -> Files:
    text, judged = report({f"{which} study": _rows(getattr(asked, which)) for which in FOLDERS})
    return {"calibration.md": text, "reliability.png": small_png(picture(judged))}


def _rows(folder: Path) -> list[Row]:
    """Read the searches of a study that came to an end."""
    stored = named_rows(folder / ROWS_FILE).rows
    if not stored:
        raise InputError(f"{folder / ROWS_FILE} has no rows; run the study first")
    return [row for row in stored.values() if row["status"] == "done"]


Judged = Mapping[str, Mapping[str, tuple[Array, Array]]]


def report(rows_of: Mapping[str, Sequence[Row]]) -> tuple[str, Judged]:
    """Return the tables as Markdown, and the probabilities with what is true, by study and question."""
    errors, sets, judged = [], [], {}
    for study, rows in rows_of.items():
        pairs: dict[str, list[tuple[float, bool]]] = {name: [] for name in KINDS}
        for row in rows:
            for name, own in answers(row).items():
                pairs[name] += own
        judged[study] = {
            name: (np.array([p for p, _ in own]), np.array([t for _, t in own], dtype=np.float64))
            for name, own in pairs.items()
            if own
        }
        for name, (chances, true) in judged[study].items():
            errors.append(
                {
                    "study": study, "of": KINDS[name], "answers": len(true),
                    "true (%)": round(100.0 * float(true.mean()), 1),
                    "said (%)": round(100.0 * float(chances.mean()), 1),
                    "calibration error (%)": round(100.0 * calibration_error(chances, true), 1),
                }
            )  # fmt: skip
        told = [
            ({h["effect"] for h in row["truth"]["hidden"]} <= set(probable), len(probable))
            for row in rows
            if row["study"] != "outside" and row["truth"]["hidden"]
            for probable in (row["probabilities"]["probable"],)
        ]
        if told:
            held, size = np.mean(told, axis=0)
            sets.append(
                {
                    "study": study, "plants": len(told),
                    "sets that hold all that is hidden (%)": round(100.0 * float(held), 1),
                    "effects in a set": round(float(size), 1),
                }
            )  # fmt: skip
    worst = float(pd.DataFrame(errors)["calibration error (%)"].max())
    text = (
        "# Are the probabilities true?\n\n"
        f"The largest calibration error is {worst} % (asked: at most 3).\n\n"
        f"{frame_table(pd.DataFrame(errors))}\n\n"
        "Sets of all effects from 10 % on (asked: 88 to 92 % hold all that is hidden):\n\n"
        f"{frame_table(pd.DataFrame(sets))}\n\nMade by `python -m studies.calibration`.\n"
    )
    return text, judged


def picture(judged: Judged) -> bytes:
    """Draw observed frequency over probability, one panel a study."""
    panels = []
    for study, results in judged.items():
        marks = [Series([0.0, 100.0], [0.0, 100.0], colour=MUTED, width=1.0)]
        for name, colour in zip(("added", "class", "not added"), PALETTE, strict=False):
            if name not in results:
                continue
            chances, true = results[name]
            parts = np.array_split(np.argsort(chances, kind="stable"), min(_BINS, len(true)))
            x = [100.0 * float(chances[k].mean()) for k in parts]
            y = [100.0 * float(true[k].mean()) for k in parts]
            bars = [100.0 * float(true[k].std() / math.sqrt(len(k))) for k in parts]
            marks.append(
                Series(x, y, KINDS[name], colour, None, marker="circle", errors=(bars, bars))
            )
        panels.append(Panel(marks, Axis("said (%)"), Axis("true (%)"), study))
    chart = side_by_side(panels, legend="below", shared="y")
    return chart_png(chart, (4.6 * len(panels), 4.8))


def _more(options: Options) -> None:
    for which, folder in FOLDERS.items():
        meaning = f"rows of the {which} study"
        options.add_argument(f"--{which}", type=Path, default=folder, metavar="DIR", help=meaning)


main = Study("calibration", __doc__, _study, RESULTS, more=_more)

if __name__ == "__main__":
    sys.exit(main())
