"""From how a search went to probabilities: `python -m studies.calibration`.

The rows of the second study (`benchmarks.foreign_effects`) with an even number are fitted: what an
effect's share, the error left and its rivals say about whether it is there. Those with an odd number,
and all of the first study (`benchmarks.hidden_effects`: other plants, protocols, noise and forms), are
checked. The fit is written to the package, the check to the results, with its reliability diagram.
"""

from __future__ import annotations

import math
import sys
from argparse import Namespace
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.effect_discovery.foreign import FOREIGN
from benchmarks.effect_discovery.independent import INDEPENDENT
from benchmarks.rows import ROWS_FILE
from rdpi_gym.diagnosis import probability
from rdpi_gym.diagnosis.probability import (
    COVERED,
    ELSE,
    IN_CLASS,
    NAMED,
    NOTHING,
    UNNAMED,
    Calibration,
    Course,
    Probabilities,
    chance,
    probabilities,
)
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import kin_of
from rdpi_gym.report.chart import Axis, Panel, Series, side_by_side
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.report.style import MUTED, PALETTE
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_json
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.store import Row, named_rows
from studies.chromium import small_png
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results" / "calibration"
_PACKAGE = Path(probability.__file__).with_name("probabilities.json")
# Price of the squares of the weights, of features of unit spread.
_RIDGE = 1.0
_BINS = 10
# A feature that does not vary is not read.
_STILL = 1e-9
KINDS = {
    "added": "an effect that was added",
    "class": "an effect that was added, or one indistinguishable from it",
    "not added": "an effect that was tried and not added",
    "other": "something outside the catalogue",
    "none": "no missing effect",
}
"""Events of the probabilities, by their names in the tables."""


@dataclass(frozen=True)
class Candidate:
    """Candidate in a row of a study."""

    effect: str
    share: float
    confidence: float
    indistinguishable: tuple[str, ...]


@dataclass(frozen=True)
class Known:
    """A search whose truth is known."""

    course: Course  # how it went
    hidden: frozenset[str]  # what was hidden
    # what is there as well, or cannot be told: by the protocol, not drawn
    excused: frozenset[str]
    alike: frozenset[str]  # what the records do not tell from what is hidden
    outside: bool  # whether something outside the catalogue was hidden

    @classmethod
    def of(cls, row: Row) -> Known:
        """Read a row of either study."""
        truth: Mapping[str, Any] = row["truth"]
        floor_um = math.hypot(row["floor_um"], row.get("numerical_floor_um") or 0.0)
        steps, ranking = (tuple(map(_candidate, row[key])) for key in ("steps", "ranking"))
        course = Course(row["base_um"], row["validation_um"], floor_um, steps, ranking)
        outside = row["study"] == "outside"
        hidden = frozenset() if outside else frozenset(h["effect"] for h in truth["hidden"])
        alike = frozenset(n for names in truth.get("alike", {}).values() for n in names)
        return cls(course, hidden, frozenset(truth.get("excused", ())), alike, outside)

    @property
    def there(self) -> frozenset[str]:
        """Whatever is there."""
        return self.hidden | self.excused

    def samples(self) -> dict[str, list[tuple[dict[str, float], bool]]]:
        """Return features and what is true, by what is asked."""
        course, names = self.course, {sign.effect for sign in self.course.added}
        others = [s for s in course.tried if s.effect not in names | self.excused]
        return {
            "added": [(course.of_added(k), s.effect in self.there) for k, s in enumerate(course.added)],
            "class": [(course.of_added(k), self._in_class(s)) for k, s in enumerate(course.added)],
            "not added": [
                (course.of_other(s, KIN[s.effect]), s.effect in self.hidden) for s in others
            ],
            "other": [(course.common, self.outside)],
            "none": [(course.common, not self.hidden and not self.outside)],
        }  # fmt: skip

    def _in_class(self, sign: probability.Sign) -> bool:
        names = {sign.effect, *sign.indistinguishable}
        return bool(names & self.there) or sign.effect in self.alike


KIN: Mapping[str, Collection[str]] = kin_of(CATALOGUE)


def _candidate(candidate: Mapping[str, Any]) -> Candidate:
    share = candidate["share"]
    return Candidate(
        candidate["effect"], -math.inf if share is None else share, candidate["confidence"],
        tuple(candidate["indistinguishable"]),
    )  # fmt: skip


def fitted(known: Sequence[Known]) -> Calibration:
    """Fit the probabilities to searches whose truth is known."""
    samples: dict[str, list[tuple[dict[str, float], bool]]] = {name: [] for name in KINDS}
    for one in known:
        for name, own in one.samples().items():
            samples[name] += own
    open_ended = Calibration(
        named=_logistic(samples["added"], NAMED),
        in_class=_logistic(samples["class"], IN_CLASS),
        unnamed=_logistic(samples["not added"], UNNAMED),
        other=_logistic(samples["other"], ELSE),
        none=_logistic(samples["none"], NOTHING),
        least=0.0,
    )
    least = [_least_of_hidden(one, probabilities(one.course, KIN, open_ended)) for one in known]
    quantile = np.quantile([p for p in least if p is not None], 1.0 - COVERED)
    return replace(open_ended, least=round(float(quantile), 4))


def _least_of_hidden(one: Known, found: Probabilities) -> float | None:
    """Probability of the least probable effect of those that are hidden; None where none is."""
    return min((found.effects.get(name, 0.0) for name in one.hidden), default=None)


def _logistic(
    samples: Sequence[tuple[Mapping[str, float], bool]], features: Sequence[str]
) -> dict[str, float]:
    from scipy.optimize import minimize

    x = np.array([[f[name] for name in features] for f, _ in samples])
    signs = np.array([1.0 if true else -1.0 for _, true in samples])
    mean, spread = x.mean(axis=0), x.std(axis=0)
    spread = np.where(spread > _STILL, spread, np.inf)
    z = np.column_stack([np.ones(len(x)), (x - mean) / spread])

    def cost(w: Array) -> float:
        return float(np.logaddexp(0.0, -signs * (z @ w)).sum() + 0.5 * _RIDGE * (w[1:] @ w[1:]))

    best = minimize(cost, np.zeros(z.shape[1])).x
    slopes = best[1:] / spread
    weights = dict(zip(features, slopes, strict=True))
    found = {"constant": best[0] - slopes @ mean} | weights
    return {name: round(float(value), 4) for name, value in found.items()}


def calibration_error(chances: Array, true: Array) -> float:
    """Return the mean distance of probability and frequency, over ten bins of equal counts."""
    order = np.argsort(chances, kind="stable")
    parts = np.array_split(order, min(_BINS, len(order)))
    gaps = [abs(float(np.mean(chances[k]) - np.mean(true[k]))) * len(k) for k in parts]
    return round(sum(gaps) / len(order), 12)


def _study(asked: Namespace) -> Files:
    foreign, hidden = _rows(asked.foreign), _rows(asked.hidden)
    even = [Known.of(row) for row in foreign if row["number"] % 2 == 0]
    found = fitted(even)
    checked = {
        "second study, odd numbers": [Known.of(r) for r in foreign if r["number"] % 2 == 1],
        "first study": [Known.of(row) for row in hidden],
    }
    text, judged = report(found, len(even), checked)
    write_json(_PACKAGE, found.to_dict())
    return {"calibration.md": text, "reliability.png": small_png(picture(judged))}


def _rows(folder: Path) -> list[Row]:
    """Read the searches of a study that came to an end."""
    stored = named_rows(folder / ROWS_FILE).rows
    if not stored:
        raise InputError(f"{folder / ROWS_FILE} has no rows; run the study first")
    return [row for row in stored.values() if row["status"] == "done"]


Judged = Mapping[str, Mapping[str, tuple[Array, Array]]]


def report(
    found: Calibration, count: int, checked: Mapping[str, Sequence[Known]]
) -> tuple[str, Judged]:
    """Return the tables as Markdown, and the probabilities with what is true, by study and question."""
    errors, sets, judged = [], [], {}
    weights = {
        "added": found.named, "class": found.in_class, "not added": found.unnamed,
        "other": found.other, "none": found.none,
    }  # fmt: skip
    for study, known in checked.items():
        results = [probabilities(one.course, KIN, found) for one in known]
        pairs: dict[str, list[tuple[float, bool]]] = {name: [] for name in KINDS}
        for one in known:
            for name, own in one.samples().items():
                pairs[name] += [(chance(weights[name], f), true) for f, true in own]
        judged[study] = {
            name: (np.array([p for p, _ in own]), np.array([t for _, t in own], dtype=np.float64))
            for name, own in pairs.items()
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
            (one.hidden <= set(result.probable), len(result.probable))
            for one, result in zip(known, results, strict=True)
            if one.hidden
        ]
        sets.append(
            {
                "study": study, "plants": len(told),
                "sets that hold all that is hidden (%)": round(100.0 * float(np.mean([a for a, _ in told])), 1),
                "effects in a set": round(float(np.mean([n for _, n in told])), 1),
            }
        )  # fmt: skip
    worst = float(pd.DataFrame(errors)["calibration error (%)"].max())
    text = (
        "# Are the probabilities true?\n\n"
        f"Fitted to {count} searches of the second study; the largest calibration error on others is "
        f"{worst} % (asked: at most 5).\n\n{frame_table(pd.DataFrame(errors))}\n\n"
        f"Sets made to hold all that is hidden in {100.0 * COVERED:.0f} % of the plants (asked: 88 to 92):\n\n"
        f"{frame_table(pd.DataFrame(sets))}\n\nMade by `python -m studies.calibration`.\n"
    )
    return text, judged


def picture(judged: Judged) -> bytes:
    """Draw observed frequency over probability, one panel a study."""
    panels = []
    for study, results in judged.items():
        marks = [Series([0.0, 100.0], [0.0, 100.0], colour=MUTED, width=1.0)]
        for name, colour in zip(("added", "class", "not added"), PALETTE, strict=False):
            chances, true = results[name]
            parts = np.array_split(np.argsort(chances, kind="stable"), _BINS)
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
    for source, option, which in (
        (FOREIGN, "--foreign", "second"),
        (INDEPENDENT, "--hidden", "first"),
    ):
        meaning = f"rows of the {which} study"
        options.add_argument(option, type=Path, default=source.out, metavar="DIR", help=meaning)


main = Study("calibration", __doc__, _study, RESULTS, more=_more)

if __name__ == "__main__":
    sys.exit(main())
