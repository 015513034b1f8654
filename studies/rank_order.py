"""Agreement of the ranking of controllers between sets of plants: `python -m studies.rank_order`.

All controllers of `rdpi bench --full` on the public test draws of a task and on as many of another
seed: two disjoint sets of plants. The tables of the tasks give the same for the halves of one set. An
interrupted run continues.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from baselines import HORIZON_BOUND
from benchmarks.stages.ranking import agreement, rank_correlation, ranking, rivals_of
from benchmarks.stages.run import TestSeed, field, run_tasks
from benchmarks.tracking.controllers import shipped_policies
from rdpi_gym.envs.tasks import TASKS
from rdpi_gym.support.command import Options
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.store import Row
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results" / "rank_order"


def _study(chosen: Namespace) -> Files:
    names = [*field(), *shipped_policies()[0]]
    sets = (TestSeed(), TestSeed(chosen.seed, is_public=False))
    lines = []
    for task in chosen.tasks.split(","):
        first, second = (
            run_tasks(
                names, [task], chosen.draws, chosen.out, seed=each, jobs=chosen.jobs, bound=False
            ).rows
            for each in sets
        )
        lines.append(line(task, first, second))
    return {"rank_order.md": report(lines, chosen.draws, chosen.seed)}


def line(task: str, first: Sequence[Row], second: Sequence[Row]) -> dict[str, object]:
    """Return what the table says of a task."""
    leaders = [rivals_of(ranking(rows))["controller"].iloc[0] for rows in (first, second)]
    rare = sorted({row["plant"] for row in first if row["failure"]})
    return {
        "task": task,
        "two sets": agreement(first, second),
        "halves of the first": rank_correlation(first),
        "first on each": leaders[0] if leaders[0] == leaders[1] else " and ".join(leaders),
        "plants of the first on which one failed": len(rare),
    }


def report(lines: Sequence[dict[str, object]], draws: int, seed: int) -> str:
    """Return the table as Markdown."""
    table = pd.DataFrame(lines)
    low = float(table["two sets"].min())
    return (
        "\n\n".join(
            [
                "# Is the order of controllers that of other plants, too?",
                f"Written by `python -m studies.rank_order --tasks {','.join(table['task'])} --draws {draws} --seed {seed}`: "
                f"Spearman's correlation of the ranks of all rivals on {draws} public test draws and on {draws} of seed {seed}, "
                f"at least {low:.3g}, and on the halves of the first set. `{HORIZON_BOUND}` does not count. Failures decide first, "
                "where they differ for sure: a few plants in a hundred that make some loops diverge do not.",
                frame_table(table),
            ]
        )
        + "\n"
    )


def _more(options: Options) -> None:
    options.add_argument("--tasks", default=",".join(TASKS), help="short names of tasks")


_MEANING = "plants of each task in each set"
main = Study(
    "rank_order", __doc__, _study, RESULTS, 1, 2, (("--draws", 100, _MEANING),), more=_more
)

if __name__ == "__main__":
    sys.exit(main())
