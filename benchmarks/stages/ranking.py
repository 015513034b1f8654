"""Ranking on tasks: failures first, then the worst tenth, then the middle half of the plants; its tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from baselines import HORIZON_BOUND
from benchmarks.rows import paragraphs, write_csv
from benchmarks.stages.entries import BESIDE, INFORMATION, RIGHT_KIND
from benchmarks.stages.row_table import write_rows
from benchmarks.stages.run import (
    PASSES,
    PREVIEW,
    SATURATED_PERCENT,
    SLOWEST_US,
    SUITE_VERSION,
    WORST_PERCENT,
)
from benchmarks.tracking.controllers import own_of
from benchmarks.tracking.episode import BLOCK, WARM_SAMPLES
from benchmarks.tracking.evaluation import CONFIDENCE, ranged
from rdpi_gym.envs.tasks import TASKS
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.markdown import LEADING_ROWS, frame_table, leading_rows
from rdpi_gym.support.store import Row
from rdpi_gym.support.words import number

COLUMNS = (
    "rank", "controller", "failed", "p90_percent", "p90_low", "p90_high", "iqm_percent", "iqm_low",
    "iqm_high", "iqm_noise", "command_variation_V_s", "microseconds_per_sample", "tuning_samples",
    "iqm_information", "near_bound", "sees", "certificate", "places", "failure",
)  # fmt: skip
"""Of a ranking. ``failed``: share of the plants; ``iqm_noise``: in units of the sensor's noise;
``iqm_information``: over that of the information bound; ``near_bound``: whether it is suspiciously close
to a bound that knows the plant; ``failure``: the first reason."""
RESAMPLES = 2000
NEAR_BOUND = 1.05
"""IQM over that of the bound up to which a score is marked: no one who does not know the plant is expected there."""
MARK = " †"


def interquartile_mean(values: Array) -> Array:
    """Mean of the middle half along the last axis, plants at its edges in part."""
    ordered = np.sort(values, axis=-1)
    n = ordered.shape[-1]
    edges = np.arange(n + 1)
    inside = np.clip(np.minimum(edges[1:], 0.75 * n) - np.maximum(edges[:-1], 0.25 * n), 0.0, None)
    return np.asarray(ordered @ inside / inside.sum())


def ninetieth(values: Array) -> Array:
    """90th percentile along the last axis, linear between plants."""
    return np.asarray(np.percentile(values, 90.0, axis=-1))


def ranking(rows: Sequence[Row]) -> pd.DataFrame:
    """Rank the controllers on one task.

    A plant on which a controller failed counts with its RMSE or :data:`~benchmarks.stages.run.WORST_PERCENT`,
    whichever is more. Of two controllers the one that failed on a smaller share of the plants is ahead,
    where the paired bootstrap of the difference over the plants excludes zero; then that with the
    smaller 90th percentile, where it does; then that with the smaller interquartile mean, likewise;
    else they tie. The rank is one more than the number of those that are ahead. Controllers that are
    given the whole reference, and the bound, have no rank.
    """
    table = pd.DataFrame(list(rows))
    numbers = sorted(table["plant"].unique())
    names = list(dict.fromkeys(table["controller"]))
    errors, fails = np.swapaxes([_errors_and_fails(table, name, numbers) for name in names], 0, 1)
    rng = np.random.default_rng(0)
    picked = rng.integers(len(numbers), size=(RESAMPLES, len(numbers)))
    drawn = {
        "failed": fails[:, picked].mean(axis=-1),
        "p90": ninetieth(errors[:, picked]),
        "iqm": interquartile_mean(errors[:, picked]),
    }
    ends = {name: _ends(each) for name, each in drawn.items()}
    ranked = pd.DataFrame(
        [
            _rest(table[table["controller"] == name], each)
            for name, each in zip(names, errors, strict=True)
        ]
    ).assign(
        controller=names,
        failed=fails.mean(axis=1),
        p90_percent=ninetieth(errors),
        p90_low=ends["p90"][0],
        p90_high=ends["p90"][1],
        iqm_percent=[float(interquartile_mean(each)) for each in errors],
        iqm_low=ends["iqm"][0],
        iqm_high=ends["iqm"][1],
    )
    beside = ranked["controller"].isin(list(BESIDE))
    is_rival = ~beside & (ranked["sees"] == PREVIEW)
    rivals: list[int] = np.flatnonzero(is_rival).tolist()
    behind = np.array(
        [[_is_behind(drawn, a, b) for b in rivals] for a in range(len(names))], dtype=np.bool_
    ).reshape(len(names), len(rivals))
    ranked["order"] = behind.sum(axis=1)
    ahead = ranked["order"].to_numpy()[rivals]
    last = len(rivals) - behind[rivals].sum(axis=0)
    labels = {name: entry.label for name, entry in BESIDE.items()}
    ranked["rank"] = ranked["controller"].map(labels).fillna(ranked["sees"])
    ranked["iqm_information"] = ranked["iqm_percent"] / _iqm_of(ranked, INFORMATION)
    near = ranked["iqm_percent"] <= NEAR_BOUND * _iqm_of(ranked, HORIZON_BOUND)
    ranked["near_bound"] = near & ~beside
    ranked["places"] = "–"
    for i, best, worst in zip(rivals, (ahead + 1).tolist(), last.tolist(), strict=True):
        ranked.loc[i, "rank"] = f"{best}{'=' if best < worst else ''}"
        ranked.loc[i, "places"] = f"{best} to {worst}" if best < worst else f"{best}"
    figures = ["failed", "p90_percent", "iqm_percent"]
    ranked = ranked.sort_values(["order", *figures], kind="stable", ignore_index=True)
    return ranked[list(COLUMNS)]


def _iqm_of(ranked: pd.DataFrame, name: str) -> float:
    """Return the IQM (%) of one entry, NaN where it was not scored."""
    return float(ranked.loc[ranked["controller"] == name, "iqm_percent"].sum(min_count=1))


def _errors_and_fails(
    table: pd.DataFrame, name: str, numbers: Sequence[int]
) -> tuple[Array, Array]:
    """Return the score of each plant (%), and 1 where the controller failed on it."""
    own = table[table["controller"] == name].set_index("plant").loc[list(numbers)]
    rmse = own["rmse_percent"] if "rmse_percent" in own else pd.Series(np.nan, index=own.index)
    failed = own["failure"].to_numpy() != ""
    values = rmse.fillna(WORST_PERCENT).to_numpy(dtype=np.float64)
    counted = np.where(failed, np.maximum(values, WORST_PERCENT), values)
    return counted, np.asarray(failed, dtype=np.float64)


def _ends(drawn: Array) -> Array:
    """Ends of the confidence interval along the last axis, low and high."""
    return np.quantile(drawn, [0.5 * (1.0 - CONFIDENCE), 0.5 * (1.0 + CONFIDENCE)], axis=-1)


def _is_behind(drawn: dict[str, Array], a: int, b: int) -> bool:
    """Whether one controller is behind another by the first figure that tells them apart."""
    for each in drawn.values():
        low, high = _ends(each[a] - each[b])
        if low > 0.0 or high < 0.0:
            return bool(low > 0.0)
    return False


def _rest(own: pd.DataFrame, errors: Array) -> dict[str, object]:
    def median(column: str) -> float:
        return float(own[column].median()) if column in own else float("nan")

    def first(column: str) -> object:
        known = own[column].dropna().tolist() if column in own else []
        return known[0] if known else None

    reasons = own.loc[own["failure"] != "", "failure"]
    per_percent = median("rmse_noise") / (median("rmse_percent") or math.nan)
    return {
        "iqm_noise": float(interquartile_mean(errors)) * per_percent,
        "command_variation_V_s": median("command_variation_V_s"),
        "microseconds_per_sample": median("microseconds_per_sample"),
        "tuning_samples": first("tuning_samples"),
        "sees": first("sees") or PREVIEW,
        "certificate": first("certificate"),
        "failure": reasons.iloc[0] if len(reasons) else "",
    }


def rivals_of(ranked: pd.DataFrame) -> pd.DataFrame:
    """Return the controllers of a ranking that have a rank: those that see a preview and no more."""
    return ranked[ranked["rank"].str.rstrip("=").str.isdigit()]


def rank_correlation(rows: Sequence[Row]) -> float:
    """Return :func:`agreement` of the even and of the odd plants of one task, two disjoint draws."""
    even, odd = ([row for row in rows if row["plant"] % 2 == parity] for parity in (0, 1))
    return agreement(even, odd)


def agreement(first: Sequence[Row], second: Sequence[Row]) -> float:
    """Return Spearman's correlation of the ranks on two sets of plants of one task.

    The bound, and what sees more than the preview, do not count; NaN below three controllers.
    """
    from scipy.stats import spearmanr

    one, other = (
        rivals_of(ranking(rows)).set_index("controller")["rank"].str.rstrip("=").astype(int)
        for rows in (first, second)
    )
    if len(one) < 3:
        return float("nan")
    return float(spearmanr(one, other.loc[one.index]).statistic)


METHOD = f"""\
- **Plants.** Each is drawn about the nominal plant of its task; all controllers meet the same, with the same references and the same noise, and hold the nominal plant with its nominal effects. The first line says from which seed they were drawn.
- **Score of a plant.** Mean over its references of the RMSE in percent of the reference's peak to peak, of the displacement without the sensor's noise, over the samples that the task scores.
- **Failed.** Share of the plants on which, with any reference, the error was larger than that of standing still or above {WORST_PERCENT:g} %, more than {SATURATED_PERCENT:g} % of the actions lay at the end of the command's range, the controller raised an error or answered with NaN, or one decision took more than {SLOWEST_US:g} µs of processor time. Such a plant counts with {WORST_PERCENT:g} % at least.
- **p90, IQM.** 90th percentile over the plants, and mean of their middle half; in brackets the {100 * CONFIDENCE:g} % interval of a bootstrap over the plants.
- **Rank.** One more than the number of controllers that are ahead for sure: those that failed on fewer plants, where the paired bootstrap of the difference excludes zero; of equals there, those with a smaller p90, likewise; of equals there, those with a smaller IQM, likewise. `=` marks a rank that is tied with another controller's.
- **Over noise, over information.** IQM in units of the sensor's noise (rms), and over that of `{INFORMATION}`.
- **Beside the ranking.** `{HORIZON_BOUND}` inverts the true plant, with all that it remembers, over the same preview as everybody's: what not knowing the plant costs is the distance to it. It is no proof of a smallest error. `{RIGHT_KIND}` is `adaptive-dual-loop` told the nominal plant of the right kind, on tasks where others believe another kind. `{INFORMATION}` is the information bound: it is told of which distribution the plant was drawn, estimates it from the readings of the episode alone, and inverts the estimate like the first.
- **†.** IQM within {100 * (NEAR_BOUND - 1):.0f} % of `{HORIZON_BOUND}`: closer than a controller that does not know the plant is expected to come.
- **Whole reference, {PASSES} passes.** Controllers that are given the whole reference before the episode, and those that learn from pass to pass over the same one, are not ranked; of the latter the last pass is scored.
- **Time.** Processor time of one decision for one plant, the least mean of {BLOCK} after the first {WARM_SAMPLES}, on the machine of the run.
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

    Notes
    -----
    ``task-rows.csv.gz``, which :meth:`write` leaves beside the tables, is what ``against`` of
    :func:`rdpi_gym.score_tasks` takes.
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
        return leaders(self.ranking(task), [*own, *self.own]).drop(columns="certificate")

    @property
    def own(self) -> list[str]:
        """A user's own controllers, whose rows are shown wherever they stand."""
        names = {str(row["controller"]): None for row in self.rows}
        return own_of(name for name in names if name not in BESIDE)

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
        """Number of plants, and their seed."""
        return f"{self.plants} plants a task, {self.draws}, task suite {SUITE_VERSION}."

    def write(self, folder: Path) -> Path:
        """Write ``tasks.csv``, the rows of every plant and ``tasks.md``, and return the latter."""
        table = pd.concat(
            [part.assign(task=task, draws=self.draws) for task, part in self.rankings.items()],
            ignore_index=True,
        )
        columns = ["task", *(name for name in table.columns if name != "task")]
        write_csv(folder / "tasks.csv", table[columns])
        write_rows(folder, self.rows)
        return write_atomic(folder / "tasks.md", self._text())

    def _text(self) -> str:
        overview = pd.DataFrame(
            [_line(task, part, self.correlation(task)) for task, part in self.rankings.items()]
        ).dropna(axis="columns", how="all")
        parts = [
            "# Controllers on the registered tasks",
            f"{self.seen} `tasks.csv` holds every controller, with command variation, tuning, certificate and the "
            f"first reason of failure; below stand the first {LEADING_ROWS} of each task.",
            *self.notes,
            frame_table(overview),
            "## What the figures mean",
            METHOD,
        ]
        for task, part in self.rankings.items():
            title = TASKS[task].title if task in TASKS else ""
            ranked = part[
                part.index.isin(rivals_of(part).index) | part["controller"].isin(self.own)
            ]
            shown = view(ranked).drop(columns=["command (V/s)", "tuned on", "certificate"])
            own = [name + mark for name in self.own for mark in ("", MARK)]
            parts += [f"## {task}", f"{title}.", leading_rows(shown, "tasks.csv", own=own)]
        return paragraphs(parts)


def view(ranked: pd.DataFrame) -> pd.DataFrame:
    """Return a ranking with the columns and headings that a reader sees."""
    return pd.DataFrame(
        {
            "rank": ranked["rank"],
            "controller": ranked["controller"] + ranked["near_bound"].map({True: MARK, False: ""}),
            **_over_information(ranked),
            "failed (%)": 100.0 * ranked["failed"],
            "p90 (%)": ranged(ranked, "p90_percent", stem="p90"),
            "IQM (%)": ranged(ranked, "iqm_percent", stem="iqm"),
            "over noise": ranked["iqm_noise"],
            "command (V/s)": ranked["command_variation_V_s"],
            "µs": ranked["microseconds_per_sample"],
            "tuned on": ranked["tuning_samples"].fillna(0).astype(np.int64).astype(str),
            "certificate": ranked["certificate"].fillna("–").map(_short),
        }
    )


def _over_information(ranked: pd.DataFrame) -> dict[str, pd.Series[float]]:
    """Return the column of ratios to the information bound, where it was scored."""
    ratio = ranked["iqm_information"]
    return {} if ratio.isna().all() else {"over information": ratio}


def _short(text: object, most: int = 70) -> str:
    first = str(text).split("; ")[0]
    return first if len(first) <= most else f"{first[: most - 1]}…"


def _first(task: str, ranked: pd.DataFrame) -> str:
    rivals = rivals_of(ranked)
    if rivals.empty or (rivals["failed"] == 1.0).all():
        return f"{task}: no controller among {len(rivals)} follows any plant{_reason(rivals)}"
    best = rivals.iloc[0]
    tied = rivals.loc[rivals["rank"] == best["rank"], "controller"].tolist()[1:]
    ratio = float(best["iqm_information"])
    over = "" if math.isnan(ratio) else f"{number(ratio)} times the information bound, "
    sentence = (
        f"{task}: {best['controller']} first, {over}IQM {number(best['iqm_percent'])} %, 90th percentile "
        f"{number(best['p90_percent'])} %, failed on {number(100.0 * best['failed'])} % of the plants"
    )
    marked = rivals.loc[rivals["near_bound"], "controller"].tolist()
    near = f" Within {100 * (NEAR_BOUND - 1):.0f} % of the bound: {', '.join(marked)}."
    return sentence + (f"; tied with it: {', '.join(tied)}." if tied else ".") + near * bool(marked)


def _reason(rivals: pd.DataFrame) -> str:
    said = [text for text in rivals["failure"].tolist() if text]
    return f"; the first reason: {said[0]}" if said else ""


def _line(task: str, ranked: pd.DataFrame, correlation: float) -> dict[str, object]:
    rivals = rivals_of(ranked)
    alive = rivals[rivals["failed"] < 1.0]
    best = next(part for part in (alive, rivals, ranked) if len(part)).iloc[0]
    return {
        "task": task,
        "first": best["controller"] if len(alive) else "–",
        "over information": best["iqm_information"],
        "failed (%)": 100.0 * best["failed"],
        "p90 (%)": best["p90_percent"],
        "IQM (%)": best["iqm_percent"],
        "over noise": best["iqm_noise"],
        **{f"{entry.label}, IQM (%)": _iqm_of(ranked, name) for name, entry in BESIDE.items()},
        "rivals without a failure": f"{int((rivals['failed'] == 0.0).sum())} of {len(rivals)}",
        "order kept": correlation,
    }


def leaders(ranked: pd.DataFrame, own: Sequence[str] = (), most: int = 10) -> pd.DataFrame:
    """Return the first of a ranking as a reader sees it, with what has no rank and a user's own."""
    beside = ~ranked["controller"].isin(rivals_of(ranked)["controller"])
    shown = ranked["controller"].isin([*rivals_of(ranked)["controller"][:most], *own])
    return view(ranked[shown | beside])
