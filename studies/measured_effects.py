"""What the laboratory finds on measured records: `python -m studies.measured_effects`.

The PICMA stack (one frequency, validation with other amplitudes) and one axis of the CubeSpec fine
steering mirror, whose two other inputs are left out on purpose: most of that motion is a
disturbance that nobody recorded.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.measurement import DATA_HINT, Dataset, Record, load, measured_data
from rdpi_gym.support.command_line import Options
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.markdown import frame_table

RESULTS = Path(__file__).parent / "results" / "measured_effects"
FSM_RATE_HZ = 6400.0
# Realisations of the mirror's multisine that are used: to fit, to validate.
FSM_TRAIN, FSM_VALIDATION = 3, 2


def mirror_axis(folder: Path) -> Dataset:
    """One input and one displacement of the mirror, at 100 and 300 mV rms.

    Parameters
    ----------
    folder
        The folder that holds ``fsm_float32.npz``.
    """
    records = []
    clock = 0.0
    with np.load(folder / "fsm_float32.npz", allow_pickle=False) as arrays:
        for level in ("100mV", "300mV"):
            for part, count in (("train", FSM_TRAIN), ("test", FSM_VALIDATION)):
                u, y = arrays[f"u_{level}_{part}"], arrays[f"y_{level}_{part}"]
                for realisation in range(count):
                    volts = np.concatenate([u[:, 0, realisation, p] for p in (0, 1)])
                    metres = np.concatenate([y[:, 0, realisation, p] for p in (0, 1)])
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
                        )
                    )
    return Dataset("one axis of a fine steering mirror", tuple(records))


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
        *[f"- {c.effect}: {', '.join(c.remarks) or 'no remark'}" for c in found.added],
        *[f"- cannot be told apart: {', '.join(group)}" for group in found.indistinguishable],
        *[f"- {note}" for note in found.notes],
    ]
    if found.next_experiment:
        words.append(f"Next experiment: {found.next_experiment}")
    return table, "\n\n".join(words)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run both studies where their data are, print and write the tables."""
    return Options("measured_effects", __doc__, out=RESULTS, jobs=2).run(arguments, _study)


def _study(chosen: Namespace) -> None:
    tables, texts = [], ["# The laboratory on measured records", __doc__.split("\n\n")[1].strip()]
    for name, read in (("picma", load), ("fsm", mirror_axis)):
        folder = measured_data(name)
        if folder is None:
            print(f"{name} is left out: {DATA_HINT}")
            continue
        table, text = summary(name, discover(read(folder), jobs=chosen.jobs))
        print(text)
        tables.append(table)
        texts.append(text)
    if tables:
        write_atomic(chosen.out / "staircase.csv", pd.concat(tables).to_csv(index=False))
        write_atomic(chosen.out / "measured_effects.md", "\n\n".join(texts) + "\n")


if __name__ == "__main__":
    sys.exit(main())
