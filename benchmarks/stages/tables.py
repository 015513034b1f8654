"""The ranking of every task in words: tables, what the figures mean, files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from baselines import HORIZON_BOUND
from benchmarks.stages.ranking import BOUND, rank_correlation, ranking, rivals_of
from benchmarks.stages.unit import (
    PASSES,
    SATURATED_PERCENT,
    SLOWEST_US,
    SUITE_VERSION,
    WORST_PERCENT,
)
from benchmarks.tracking.leaderboard import CONFIDENCE, ranged
from rdpi_gym.envs.tasks import TASKS
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.store import Row
from rdpi_gym.support.words import number

METHOD = f"""\
- **Plants.** Each is drawn about the nominal plant of its task; all controllers meet the same, with the same references and the same noise, and hold the nominal plant with its nominal effects. Which seed they were drawn from stands above every table.
- **Score of a plant.** Mean over its references of the RMSE in percent of the reference's peak to peak, of the displacement without the sensor's noise, over the samples that the task scores.
- **Failed.** Share of the plants on which, with any reference, the error was larger than that of standing still or above {WORST_PERCENT:g} %, more than {SATURATED_PERCENT:g} % of the actions lay at the end of the command's range, the controller raised an error or answered with NaN, or one decision took more than {SLOWEST_US:g} µs. Such a plant counts with {WORST_PERCENT:g} % at least.
- **p90, IQM.** 90th percentile over the plants, and mean of their middle half; in brackets the {100 * CONFIDENCE:g} % interval of a bootstrap over the plants.
- **Rank.** One more than the number of controllers that are ahead for sure: those that failed on fewer plants; of equals there, those with a smaller p90, where the paired bootstrap of the difference excludes zero; of equals there, those with a smaller IQM, likewise. `=` marks a rank that is tied with another controller's.
- **Over noise.** IQM in units of the sensor's noise (rms).
- **Bound.** `{HORIZON_BOUND}` inverts the true plant, with all that it remembers, over the same preview as everybody's: what not knowing the plant costs is the distance to it. It is no proof of a smallest error.
- **Whole reference, {PASSES} passes.** Controllers that are given the whole reference before the episode, and those that learn from pass to pass over the same one, are listed and not ranked; of the latter the last pass is scored.
- **Time.** Median time of one decision for one plant, on the machine and under the load of the run.
- **Tuned on.** Plant samples of training draws that its committed settings took; 0: nothing was tuned.
- **Certificate.** What a controller says of its stability on its belief before it drives anything.
- **Order kept.** Spearman's correlation of the ranks of all rivals on the plants of even and of odd numbers, two disjoint draws.
"""


@dataclass(frozen=True, repr=False)
class TaskScores:
    """Scores of controllers on tasks.

    Parameters
    ----------
    rows
        One for each controller, task and plant.
    draws
        Which seed the plants were drawn from.
    computed
        Rows that were computed now; the others were found in the run's folder.
    notes
        What a reader should know, one sentence each.
    """

    rows: tuple[Row, ...]
    draws: str
    computed: int = 0
    notes: tuple[str, ...] = ()

    @property
    def tasks(self) -> list[str]:
        """Short names of the tasks, in the order of the rows."""
        return list(dict.fromkeys(str(row["task"]) for row in self.rows))

    @property
    def plants(self) -> int:
        """Number of plants of each task."""
        return len({row["plant"] for row in self.rows})

    def rows_of(self, task: str) -> list[Row]:
        """Return the rows of one task."""
        return [row for row in self.rows if row["task"] == task]

    @cached_property
    def rankings(self) -> Mapping[str, pd.DataFrame]:
        """The ranking of each task, best first."""
        return {task: ranking(self.rows_of(task)) for task in self.tasks}

    def ranking(self, task: str) -> pd.DataFrame:
        """Return the ranking of one task, best first."""
        return self.rankings[task]

    def leaders(self, task: str, own: Sequence[str] = ()) -> pd.DataFrame:
        """Return the first of one task's ranking as a reader sees it, and a user's own."""
        return leaders(self.ranking(task), own).drop(columns="certificate")

    def correlation(self, task: str) -> float:
        """Return the correlation of the ranks on the plants of even and of odd numbers; NaN where there are too few."""
        return rank_correlation(self.rows_of(task)) if self.plants > 1 else float("nan")

    @property
    def answer(self) -> str:
        """Who is first on each task, by how much, one line a task."""
        return "\n".join(_first(task, self.ranking(task)) for task in self.tasks)

    def __repr__(self) -> str:
        parts = [self.answer, self.seen]
        parts += [
            f"{task}\n{view(self.ranking(task)).to_string(index=False)}" for task in self.tasks
        ]
        return "\n".join([*parts, *self.notes])

    @property
    def seen(self) -> str:
        """How many plants, and from which seed."""
        return f"{self.plants} plants a task, {self.draws}, task suite {SUITE_VERSION}."

    def write(self, folder: Path) -> Path:
        """Write ``tasks.csv`` and ``tasks.md``, and return the latter."""
        table = pd.concat(
            [part.assign(task=task, draws=self.draws) for task, part in self.rankings.items()],
            ignore_index=True,
        )
        columns = ["task", *(name for name in table.columns if name != "task")]
        csv = table[columns].to_csv(index=False, float_format="%.6g", lineterminator="\n")
        write_atomic(folder / "tasks.csv", csv)
        return write_atomic(folder / "tasks.md", self._text())

    def _text(self) -> str:
        overview = pd.DataFrame(
            [_line(task, part, self.correlation(task)) for task, part in self.rankings.items()]
        )
        parts = [
            "# Controllers on the registered tasks",
            self.seen + " Every ranking is in `tasks.csv`.",
            *self.notes,
            frame_table(overview),
            "## What the figures mean",
            METHOD,
        ]
        for task, part in self.rankings.items():
            title = TASKS[task].title if task in TASKS else ""
            parts += [f"## {task}", f"{title}. {self.seen}", frame_table(view(part))]
            failed = part[part["failure"] != ""]
            if not failed.empty:
                said = "; ".join(
                    f"`{name}`: {reason}"
                    for name, reason in zip(
                        failed["controller"], failed["failure"].map(_short), strict=True
                    )
                )
                parts.append(f"First reason of each that failed anywhere: {said}.")
        return "\n\n".join(part.strip() for part in parts) + "\n"


def view(ranked: pd.DataFrame) -> pd.DataFrame:
    """Return a ranking with the columns and headings that a reader sees."""
    return pd.DataFrame(
        {
            "rank": ranked["rank"],
            "controller": ranked["controller"],
            "failed (%)": 100.0 * ranked["failed"],
            "p90 (%)": ranged(ranked, "p90_percent", "p90_low", "p90_high"),
            "IQM (%)": ranged(ranked, "iqm_percent", "iqm_low", "iqm_high"),
            "over noise": ranked["iqm_noise"],
            "command (V/s)": ranked["command_variation_V_s"],
            "µs": ranked["microseconds_per_sample"],
            "tuned on": ranked["tuning_samples"].fillna(0).astype(np.int64).astype(str),
            "certificate": ranked["certificate"].fillna("–").map(_short),
        }
    )


def _short(text: object, most: int = 70) -> str:
    said = str(text).split("; ")[0]
    return said if len(said) <= most else f"{said[: most - 1]}…"


def _first(task: str, ranked: pd.DataFrame) -> str:
    rivals = rivals_of(ranked)
    best = rivals.iloc[0]
    tied = rivals.loc[rivals["rank"] == best["rank"], "controller"].tolist()[1:]
    said = (
        f"{task}: {best['controller']} first, IQM {number(best['iqm_percent'])} %, 90th percentile "
        f"{number(best['p90_percent'])} %, failed on {number(100.0 * best['failed'])} % of the plants"
    )
    return said + (f"; tied with it: {', '.join(tied)}." if tied else ".")


def _line(task: str, ranked: pd.DataFrame, correlation: float) -> dict[str, object]:
    best, bound = rivals_of(ranked).iloc[0], ranked[ranked["rank"] == BOUND]
    return {
        "task": task,
        "first": best["controller"],
        "failed (%)": 100.0 * best["failed"],
        "p90 (%)": best["p90_percent"],
        "IQM (%)": best["iqm_percent"],
        "over noise": best["iqm_noise"],
        "bound, IQM (%)": float(bound["iqm_percent"].iloc[0]) if len(bound) else float("nan"),
        "rivals without a failure": f"{int((rivals_of(ranked)['failed'] == 0.0).sum())} of {len(rivals_of(ranked))}",
        "order kept": correlation,
    }


def leaders(ranked: pd.DataFrame, own: Sequence[str] = (), most: int = 10) -> pd.DataFrame:
    """Return the first of a ranking as a reader sees it, with what has no rank and a user's own."""
    beside = ~ranked["controller"].isin(rivals_of(ranked)["controller"])
    shown = ranked["controller"].isin([*rivals_of(ranked)["controller"][:most], *own])
    return view(ranked[shown | beside])
