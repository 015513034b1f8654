"""Findings of the laboratory on measured records: `python -m studies.measured_effects`.

The PICMA stack (one frequency, validation with other amplitudes), as published and split in three
other ways, and one axis of the CubeSpec fine steering mirror, whose two other inputs are recorded
beside the one that the model has.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.measurement import DATA_HINT, Dataset, Record, load, measured_data
from rdpi_gym.plant.cores.play import play_columns
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.markdown import frame_table
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results" / "measured_effects"
FSM_RATE_HZ = 6400.0
# Realisations of the mirror's multisine that are used: to fit, to validate.
FSM_TRAIN, FSM_VALIDATION = 3, 2


def mirror_axis(folder: Path) -> Dataset:
    """One input and one displacement of the mirror, at 100 and 300 mV rms."""
    records = []
    clock = 0.0
    with np.load(folder / "fsm_float32.npz", allow_pickle=False) as arrays:
        for level in ("100mV", "300mV"):
            for part, count in (("train", FSM_TRAIN), ("test", FSM_VALIDATION)):
                u, y = arrays[f"u_{level}_{part}"], arrays[f"y_{level}_{part}"]
                for realisation in range(count):
                    volts = np.concatenate([u[:, 0, realisation, p] for p in (0, 1)])
                    metres = np.concatenate([y[:, 0, realisation, p] for p in (0, 1)])
                    others = {
                        f"u{k + 1}": np.concatenate(
                            [u[:, k, realisation, p] for p in (0, 1)]
                        ).astype(np.float64)
                        for k in (1, 2)
                    }
                    t = clock + np.arange(len(volts)) / FSM_RATE_HZ
                    clock = float(t[-1]) + 1.0
                    name = f"{'validation-' if part == 'test' else ''}{level}-{realisation}"
                    second = np.arange(len(volts)) >= len(volts) // 2
                    records.append(
                        Record(
                            name,
                            t,
                            volts.astype(np.float64),
                            1e6 * metres.astype(np.float64),
                            ts_s=1 / FSM_RATE_HZ,
                            role="validation" if part == "test" else "train",
                            error_mask=second,  # the first period settles
                            others=others,
                        )
                    )
    return Dataset("one axis of a fine steering mirror", tuple(records))


WAYS = (
    "as published",
    "a second more left out",
    "roles exchanged",
    "half of the validation records to fit",
)
"""Ways to split a data set."""


def splits(dataset: Dataset) -> dict[str, Dataset]:
    """Return a data set split in four ways: as it is, with an opening left out, exchanged, and halved."""
    train, validation = dataset.train, dataset.validation
    names = {r.name for r in train}
    held = tuple(
        replace(r, name=f"{r.name}-held" if r.name in names else r.name, role="validation")
        for r in validation
    )
    halves = []
    for record in held:
        counted = np.flatnonzero(record.error_mask)
        first = np.arange(record.t_s.size) < counted[counted.size // 2]
        name = f"{record.name}-first"
        halves += [
            replace(record, name=name, role="train", error_mask=record.error_mask & first),
            replace(record, error_mask=record.error_mask & ~first),
        ]
    parts: tuple[tuple[Record, ...], ...] = (
        (*train, *held),
        (*map(_later, train), *held),
        (
            *(replace(record, role="validation") for record in train),
            *(replace(record, role="train") for record in held),
        ),
        (*train, *halves),
    )
    rest = dataset.test
    return {
        name: replace(dataset, records=(*records, *dataset.quiet, *rest))
        for name, records in zip(WAYS, parts, strict=True)
    }


def _later(record: Record) -> Record:
    """Leave out a second more of a record, or a tenth of it where it is short."""
    counted = np.flatnonzero(record.error_mask)
    more = min(round(1.0 / record.ts_s), counted.size // 10)
    later = np.arange(record.t_s.size) >= counted[0] + more
    return replace(record, error_mask=record.error_mask & later)


@dataclass(frozen=True)
class Measured:
    """A set of measured records, and what else is known to fit it."""

    name: str
    published: str  # Error of others, and whose
    branches: Literal["play", "stop"] = "play"  # Operators of the model that is fitted by hand

    @cached_property
    def dataset(self) -> Dataset | None:
        """The records; None where they are absent."""
        folder = measured_data(self.name)
        if folder is None:
            return None
        return mirror_axis(folder) if self.name == "fsm" else load(folder)


SETS = (
    Measured("picma", "0.145 µm: plays, cubic, relaxations, velocity, delay"),
    Measured("friction_damper", "5.6 to 6.1 %: 40 stops and a slope", "stop"),
    Measured("fsm", "linear with 28 states and three inputs: 0.25 to 0.66 µm"),
    Measured("mr_damper", "", "stop"),
    Measured("pneumatic_friction", "", "stop"),
    Measured("ferroelectric_forc", ""),
)
"""All of them; of those without a published error the model fitted by hand is the measure."""
_OPERATORS = 30


def fit_by_hand(train: Sequence[Record], validation: Sequence[Record], branches: str) -> float:
    """Error (rms, offset free) of a cubic curve, 30 plays or stops and a rate by linear least squares.

    The weights of the operators are not negative; the sign of the whole is that of the records.
    """
    from scipy.optimize import lsq_linear

    span = max(float(np.ptp(r.u_V)) for r in train)
    fastest = max(float(np.max(np.abs(np.gradient(r.u_V, r.ts_s)))) for r in train)
    thresholds = 0.5 * span * np.arange(1, _OPERATORS + 1) / (_OPERATORS + 1)

    def rows(record: Record) -> tuple[Array, Array]:
        u = np.ascontiguousarray(record.u_V)
        plays = np.empty((_OPERATORS, u.size))
        memory = np.full(_OPERATORS, float(u[0]))
        play_columns(u, np.zeros_like(u), thresholds, 0.0, memory, plays)
        operators = plays if branches == "play" else u - plays
        rate = np.gradient(u, record.ts_s) / fastest * span
        columns = np.vstack([operators, u, u**2 / span, u**3 / span**2, rate]).T
        kept = record.error_mask
        found, y = columns[kept], record.y_um[kept]
        return found - found.mean(axis=0), y - y.mean()

    x, y = (np.concatenate(each) for each in zip(*map(rows, train), strict=True))
    sign = 1.0 if x[:, _OPERATORS] @ y >= 0.0 else -1.0
    low = np.append(np.zeros(_OPERATORS), np.full(4, -np.inf))
    weights = lsq_linear(x, sign * y, (low, np.full(low.size, np.inf))).x
    left = np.concatenate([sign * y - x @ weights for x, y in map(rows, validation)])
    return float(np.sqrt(np.mean(left**2)))


def peak_to_peak(records: Sequence[Record]) -> float:
    """Largest motion of any record (µm)."""
    return max(float(np.ptp(record.y_um[record.error_mask])) for record in records)


def summary(name: str, found: SearchResult) -> tuple[pd.DataFrame, str]:
    """Return the staircase of the errors, and what was said, as Markdown."""
    stairs = [("base model", found.base)]
    stairs += [(f"+ {' + '.join(step.effects)}", step.errors) for step in found.steps]
    table = pd.DataFrame(
        {
            "data": name,
            "model": [label for label, _ in stairs],
            "train_rmse_um": [errors.train_rmse_um for _, errors in stairs],
            "validation_rmse_um": [errors.validation_rmse_um for _, errors in stairs],
        }
    )
    words = [
        f"## {name}",
        f"Verdict: **{found.verdict}**; {found.noise_origin}; left over the noise "
        f"{found.unexplained_rmse_um:.3g} µm. {found.remainder}",
        frame_table(table.drop(columns="data")),
        *[
            f"- {c.effect}{', ' if c.form else ''}{c.form}: confidence {100 * c.confidence:.0f} %, "
            f"{', '.join(c.remarks) or 'no remark'}"
            for c in found.added
        ],
        *[f"- cannot be told apart: {', '.join(group)}" for group in found.indistinguishable],
        *[f"- {note}" for note in found.notes],
    ]
    if found.next_experiment:
        words.append(f"Next experiment: {found.next_experiment}")
    return table, "\n\n".join(words)


def _picma(folder: Path) -> dict[str, Dataset]:
    ways = splits(load(folder)).items()
    return {"picma" if k == 0 else f"picma, {name}": part for k, (name, part) in enumerate(ways)}


def _mirror(folder: Path) -> dict[str, Dataset]:
    return {"fsm": mirror_axis(folder)}


def _study(chosen: Namespace) -> Files:
    tables, texts = [], ["# The laboratory on measured records", __doc__.split("\n\n")[1].strip()]
    for name, read in (("picma", _picma), ("fsm", _mirror)):
        folder = measured_data(name)
        if folder is None:
            print(f"{name} is left out: {DATA_HINT}")
            continue
        for label, dataset in read(folder).items():
            table, text = summary(label, discover(dataset, jobs=chosen.jobs))
            tables.append(table)
            texts.append(text)
    if not tables:
        return {}
    return {
        "staircase.csv": pd.concat(tables),
        "measured_effects.md": "\n\n".join(texts) + "\n",
    }


main = Study("measured_effects", __doc__, _study, RESULTS, jobs=2)

if __name__ == "__main__":
    sys.exit(main())
