"""Sensitivity of the search to its constants: `python -m studies.search_constants --plants 20 --seed 41`.

Each number of the search's table is halved and doubled, alone, on the same drawn plants; probabilities
by their odds. What changes neither names nor time is not a constant.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import pandas as pd

from rdpi_gym.diagnosis.beam.constants import TABLE, Constant
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.store import Row
from studies import one_law
from studies.runner import Files, Study, study_rows

RESULTS = Path(__file__).parent / "results" / "constants"
FACTORS = (0.5, 2.0)
AS_IT_IS = "as it is"
_ODDS = ("FOUND", "LIKELY")


def scaled(constant: Constant, factor: float) -> float:
    """Return a constant times a factor: whole where it is a count, by its odds where it is a probability."""
    if constant.name in _ODDS:
        odds = factor * constant.value / (1.0 - constant.value)
        return odds / (1.0 + odds)
    value = factor * constant.value
    return max(round(value), 1) if isinstance(constant.value, int) else value


@contextmanager
def changed(name: str, value: float) -> Iterator[None]:
    """Give a constant another value in each module that reads it."""
    with ExitStack() as stack:
        for module in [m for n, m in sys.modules.items() if n.startswith("rdpi_gym.diagnosis")]:
            if name in vars(module):
                stack.enter_context(patch.object(module, name, value))
        yield


@dataclass(frozen=True)
class Trial:
    """One plant with one constant changed, or with none."""

    unit: one_law.Unit
    name: str = AS_IT_IS
    factor: float = 1.0

    @property
    def key(self) -> str:
        """Name of its row."""
        return f"{self.name} x {self.factor:g}/{self.unit.key}"


def trials(plants: int, seed: int) -> list[Trial]:
    """List the trials: all plants as the search is, then with each constant changed."""
    units = one_law.units(plants, seed)
    others = [(c.name, factor) for c in TABLE for factor in FACTORS]
    return [Trial(unit, *each) for each in [(AS_IT_IS, 1.0), *others] for unit in units]


def run_trial(case: Trial, code: str) -> Row:
    """Search the records of one plant; no constant has the name of the search as it is."""
    values = {c.name: scaled(c, case.factor) for c in TABLE}
    with changed(case.name, values.get(case.name, case.factor)):
        row = one_law.run_unit(case.unit, code)
    return row | {"key": case.key, "constant": case.name, "factor": case.factor}


def table(rows: Sequence[Row]) -> pd.DataFrame:
    """Summarise each constant: names that change (% of the plants), shares (%), time over that as it is."""
    done = [row for row in rows if row["status"] == "done"]
    frame = pd.DataFrame([
        one_law.judged(row)
        | {"constant": row["constant"], "factor": row["factor"]}
        | {"names": " ".join(sorted(step["effect"] for step in row["steps"]))}
        for row in done
    ])  # fmt: skip
    usual = frame[frame["constant"] == AS_IT_IS].set_index("plant")
    lines = []
    for (name, factor), part in frame.groupby(["constant", "factor"], sort=False):
        own = part.set_index("plant")
        both = own.join(usual[["names", "seconds"]].add_suffix("_usual"), how="inner")
        lines.append({
            "constant": name, "times": factor, "plants": len(both),
            "other names": round(100.0 * float((both["names"] != both["names_usual"]).mean()), 1),
            "exact": round(100.0 * float(both["exact"].mean()), 1),
            "wrong": round(100.0 * float(both["wrong"].mean()), 1),
            "wrong found": round(100.0 * float(both["wrong_found"].mean()), 1),
            "time": round(float(both["seconds"].sum() / both["seconds_usual"].sum()), 2),
        })  # fmt: skip
    return pd.DataFrame(lines)


def _files(chosen: Namespace) -> Files:
    asked = trials(chosen.plants, chosen.seed)
    rows = study_rows(asked, run_trial, chosen, one_law.ROOMS, [Path(__file__)])
    frame = table(rows)
    text = (
        "# Constants of the search, halved and doubled\n\n"
        f"Made by `python -m studies.search_constants --plants {chosen.plants} --seed {chosen.seed}`. Plants "
        "over the strata of both studies; shares in per cent of the plants; *time* is processor time over "
        "that of the search as it is.\n\n"
        f"{frame_table(frame, digits=None, rule='plain')}\n"
    )
    return {f"{main.name}.csv": frame, f"{main.name}.md": text}


main = Study(
    "search_constants", __doc__, _files, RESULTS, seed=41, jobs=1, csv="%.6g",
    numbers=(("--plants", 20, "drawn over the strata"),),
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
