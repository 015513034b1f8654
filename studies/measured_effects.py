"""Findings of the laboratory on measured records: `python -m studies.measured_effects`.

The PICMA stack (one frequency, validation with other amplitudes), as published and split in three
other ways, and one axis of the CubeSpec fine steering mirror, whose two other inputs are recorded
beside the one that the model has.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.measurement import DATA_HINT, Dataset, Record, load, measured_data
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


def splits(dataset: Dataset) -> dict[str, Dataset]:
    """Return a data set of one record to fit and one to validate on, split in four ways."""
    (first,), (second,) = dataset.train, dataset.validation
    counted = np.flatnonzero(first.error_mask)
    later = np.arange(first.t_s.size) >= counted[0] + round(1.0 / first.ts_s)
    half = np.arange(second.t_s.size) < second.t_s.size // 2
    ways = {
        "picma": (first, second),
        "picma, a second more left out": (
            replace(first, error_mask=first.error_mask & later),
            second,
        ),
        "picma, roles exchanged": (
            replace(first, role="validation"),
            replace(second, role="train"),
        ),
        "picma, half of the validation record to fit": (
            first,
            replace(second, name="first-half", role="train", error_mask=second.error_mask & half),
            replace(second, error_mask=second.error_mask & ~half),
        ),
    }
    return {name: replace(dataset, records=records) for name, records in ways.items()}


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
    return splits(load(folder))


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
