"""Is the advised experiment worth making? `python -m studies.advised_experiment`.

Plants of the first study with one hidden effect go through two records of the standard protocol alone. A
discovery names what is probable and one experiment; that experiment is made on the same plant, its
records join the others, and the discovery is made again. The ambiguous set is that of the probable
effects, which holds what is hidden in nine of ten searches. An interrupted run continues.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from benchmarks.effect_discovery import cases as study
from benchmarks.effect_discovery.independent import PLAIN, prepare
from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.measurement import Dataset
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.store import Row
from rdpi_gym.virtual_lab.draws import HIDEABLE, MaskedError
from studies.runner import Files, Study, study_rows

RESULTS = Path(__file__).parent / "results" / "advised_experiment"
GIVEN = (
    ("triangle-slow", "validation-decaying-sine"), ("sine-10hz", "validation-loops"),
    ("multisine", "validation-chirp"), ("minor-loops", "validation-loops"),
)  # fmt: skip
"""Two records that a user might have, to fit and to validate on."""
_ROOMS = ("plant", "signals", "measurement", "identification", "virtual_lab", "diagnosis")


@dataclass(frozen=True)
class Case:
    """One plant of the first study, and the records that are there to begin with."""

    plant: study.Case
    given: tuple[str, str]

    @property
    def key(self) -> str:
        """Name of the case in the store."""
        return f"{self.plant.key}/{'+'.join(self.given)}"


def make(plants: int, seed: int) -> list[Case]:
    """Return the cases: effects and records in turn."""
    names = sorted(HIDEABLE)
    return [
        Case(
            study.Case("single", (names[k % len(names)],), 1000 + k, seed, PLAIN),
            GIVEN[k % len(GIVEN)],
        )
        for k in range(plants)
    ]


def run_case(case: Case, code: str) -> Row:
    """Search, make the experiment that is advised, search again; return the row."""
    row: Row = {"key": case.key, "code": code, "hidden": case.plant.subject[0]}
    try:
        whole = prepare(case.plant).dataset
    except MaskedError as error:
        return row | {"status": "masked", "error": str(error)}
    began = time.process_time()
    before = discover(_part(whole, case.given), seed=case.plant.seed)
    asked = () if before.advice is None else before.advice.records
    more = tuple(name for name in asked if name not in case.given)
    row |= {"status": "done", "advice": before.next_experiment, "made": list(more)}
    row |= {"before": _effects_of(before), "after": None}
    if more:
        after = discover(_part(whole, (*case.given, *more)), seed=case.plant.seed)
        row["after"] = _effects_of(after)
    return row | {"seconds": time.process_time() - began}


def _part(whole: Dataset, names: Sequence[str]) -> Dataset:
    return replace(whole, records=tuple(r for r in whole.records if r.name in names))


def _effects_of(found: SearchResult) -> dict[str, list[str]]:
    assert found.probabilities is not None
    return {
        "probable": list(found.probabilities.probable), "added": [c.effect for c in found.named],
    }  # fmt: skip


def _files(asked: Namespace) -> Files:
    rows = study_rows(make(asked.plants, asked.seed), run_case, asked, _ROOMS, [Path(__file__)])
    return {"advised_experiment.md": report(rows, asked.plants, asked.seed)}


def report(rows: Sequence[Row], plants: int, seed: int) -> str:
    """Return the table as Markdown."""
    done = [row for row in rows if row["status"] == "done"]
    open_ = [row for row in done if len(row["before"]["probable"]) > 1]
    made = [row for row in open_ if row["after"] is not None]
    halved = [
        row for row in made if 2 * len(row["after"]["probable"]) <= len(row["before"]["probable"])
    ]
    lines = [
        {
            "of": name, "plants": len(part),
            "size of the set, before": _mean(part, "before"), "after": _mean(part, "after"),
            "holds what is hidden, before": _holds(part, "before"), "after ": _holds(part, "after"),
            "named alone, before": _alone(part, "before"), "after  ": _alone(part, "after"),
        }
        for name, part in (("all", made), ("halved", halved))
    ]  # fmt: skip
    return (
        "# Is the advised experiment worth making?\n\n"
        f"Of {len(done)} plants with two records each, {len(open_)} leave more than one effect "
        f"probable; for {len(made)} of them an experiment of the protocol is advised. With it the set "
        f"shrinks by half or more in {len(halved)} of {len(made)} (asked: 80 %).\n\n"
        f"{frame_table(pd.DataFrame(lines))}\n\n"
        f"Made by `python -m studies.advised_experiment --plants {plants} --seed {seed}`.\n"
    )


def _mean(rows: Sequence[Row], when: str) -> float:
    sizes = [len(row[when]["probable"]) for row in rows]
    return round(sum(sizes) / max(len(sizes), 1), 1)


def _holds(rows: Sequence[Row], when: str) -> int:
    return sum(row["hidden"] in row[when]["probable"] for row in rows)


def _alone(rows: Sequence[Row], when: str) -> int:
    return sum(row[when]["added"] == [row["hidden"]] for row in rows)


main = Study(
    "advised_experiment", __doc__, _files, RESULTS, 3, 2, numbers=(("--plants", 60, "plants"),)
)

if __name__ == "__main__":
    sys.exit(main())
