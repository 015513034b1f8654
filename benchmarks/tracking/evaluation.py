"""Everything that the tables, the page and the picture of a run are made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from benchmarks.tracking.case import FEWEST_SAMPLES, MOST_SAMPLES
from benchmarks.tracking.leaderboard import (
    CASE,
    CONFIDENCE,
    by_case,
    by_sampling_time,
    ranking,
    score_table,
)
from benchmarks.tracking.measured import MeasuredScores, no_scores, score_measured
from benchmarks.tracking.run import Outcome
from benchmarks.tracking.selection import Selection
from benchmarks.tracking.stages import cases
from rdpi_gym.support.store import Row
from rdpi_gym.support.words import number

MEASURED_PLANT = "picma"


@dataclass(frozen=True)
class Evaluation:
    """Results of a run, from single scores to the ranking.

    Parameters
    ----------
    selection
        What was asked for.
    rows
        Rows of the controllers that were asked for, some with a ``trace``.
    table
        Their scores, as ``leaderboard.csv`` holds them.
    ranking, by_case, by_sampling_time, where_trained
        Summaries, see :mod:`benchmarks.tracking.leaderboard`. Only `by_case` holds the cases beyond
        a plant's identification, marked in its column ``extrapolated``. The ranking is over the same
        cases whatever policies there are. `where_trained` are rankings of all controllers over the
        cases of one sampling time (s) each: those of trained policies, which run at no other.
    measured
        Scores on measured records.
    notes
        What was left out, one sentence each.
    """

    selection: Selection
    rows: tuple[Row, ...]
    table: pd.DataFrame
    ranking: pd.DataFrame
    by_case: pd.DataFrame
    by_sampling_time: pd.DataFrame
    where_trained: Mapping[float, pd.DataFrame]
    measured: MeasuredScores
    notes: tuple[str, ...]

    @property
    def order(self) -> list[str]:
        """Controllers, best first; those that are only ranked where they were trained at the end."""
        ranked = [self.ranking, *self.where_trained.values()]
        return list(dict.fromkeys(str(name) for part in ranked for name in part["controller"]))

    @property
    def first_seed(self) -> int:
        """The first seed that was asked for."""
        return self.selection.seeds[0]

    @property
    def shown_setting(self) -> tuple[str, float]:
        """First plant, and the sampling time (s) at which it is shown in detail."""
        stage = self.selection.stages[0]
        return stage.plant.name, stage.shown_ts_s

    @property
    def answer(self) -> str:
        """Which controller is first, by how much, and what is tied with it.

        Of the ranking, or where only trained policies were scored of theirs.
        """
        finished = [
            part[part["rmse_percent"].notna()]
            for part in (self.ranking, *self.where_trained.values())
        ]
        rivals = next(
            (p[p["rank"] != "bound"] for p in finished if (p["rank"] != "bound").any()), None
        )
        if rivals is None:
            return "No controller finished every case, so none is ranked."
        best = rivals.iloc[0]
        said = (
            f"Smallest error: {best['controller']}, RMSE {number(best['rmse_percent'])} % of peak to peak "
            f"({number(best['rmse_um'])} µm)"
        )
        if np.isfinite(best["rmse_percent_low"]):
            said += (
                f", {100 * CONFIDENCE:g} % interval {number(best['rmse_percent_low'])} to "
                f"{number(best['rmse_percent_high'])} %"
            )
        tied = [str(n) for n in rivals.loc[rivals["rank"] == best["rank"], "controller"].iloc[1:]]
        said += f"; status {best['status']}."
        return said + (f" Tied with it: {', '.join(tied)}." if tied else "")


def evaluate(selection: Selection, outcome: Outcome) -> Evaluation:
    """Summarise the rows of a run, and score the feedforwards on measured records.

    The measured records belong to the plant ``picma`` and are scored together with it, where
    controllers are told that plant itself.
    """
    table = score_table(outcome.rows)
    table = table[table["controller"].isin(selection.controllers)].reset_index(drop=True)
    beyond = _beyond(selection)
    if all(key in beyond for key in table[CASE].itertuples(index=False, name=None)):
        beyond = []  # then there is nothing else to rank
    counted = table[~_marks(table, beyond)]
    summary = by_case(table)
    summary["extrapolated"] = _marks(summary, beyond)
    plants = {stage.plant.name: stage.plant for stage in selection.stages if not stage.believed}
    if MEASURED_PLANT in plants:
        measured = score_measured(
            selection.controllers, plants[MEASURED_PLANT], selection.factories
        )
    else:
        measured = no_scores(
            f"No scores on measured records: the plant {MEASURED_PLANT} is not among those scored."
        )
    return Evaluation(
        selection,
        tuple(row for row in outcome.rows if row["controller"] in selection.controllers),
        table,
        ranking(_in_ranking(selection, counted)),
        summary,
        by_sampling_time(counted),
        _where_trained(selection, counted),
        measured,
        (
            *selection.notes,
            *_where_they_run(selection),
            *_where_they_suit(selection),
            *left_out(selection),
            *_unranked(beyond),
        ),
    )


def left_out(selection: Selection) -> tuple[str, ...]:
    """Name the cases that do not suit a sampling time, one sentence for each Ts."""
    plants: dict[tuple[float, str], list[str]] = {}
    for stage in selection.stages:
        for ts in stage.every_ts_s:
            every = cases(selection.references, 1.0, stage.base_hz)
            names = ", ".join(case.name for case in every if not case.fits(ts))
            if names:
                plants.setdefault((ts, names), []).append(stage.plant.name)
    return tuple(
        f"Not run at Ts = {ts:g} s on {', '.join(on)}, where a period has fewer than "
        f"{FEWEST_SAMPLES} or more than {MOST_SAMPLES} samples: {names}."
        for (ts, names), on in plants.items()
    )


def _beyond(selection: Selection) -> list[tuple[str, str, float, float]]:
    return [
        (stage.plant.name, case.reference, case.frequency_hz, ts)
        for stage in selection.stages
        for ts in stage.every_ts_s
        for case in stage.cases(selection.references, ts)
        if not stage.covers(case, ts)
    ]


def _marks(rows: pd.DataFrame, beyond: list[tuple[str, str, float, float]]) -> pd.Series:
    listed = set(beyond)
    marks = [case in listed for case in rows[CASE].itertuples(index=False, name=None)]
    return pd.Series(marks, index=rows.index, dtype=bool)


def _unranked(beyond: list[tuple[str, str, float, float]]) -> list[str]:
    names: dict[str, list[str]] = {}
    for plant, reference, hz, _ in beyond:
        names.setdefault(plant, []).append(f"{reference} {hz:g} Hz")
    return [
        f"Not in the ranking, since the reference is faster than {plant} was identified with: "
        f"{', '.join(dict.fromkeys(listed))}."
        for plant, listed in names.items()
    ]


def _in_ranking(selection: Selection, counted: pd.DataFrame) -> pd.DataFrame:
    """Return the rows that the ranking is over: no policy that ran in a part of the cases only."""
    times = {stage.plant.name: stage.ts_s for stage in selection.stages}
    ranked = [name for name in selection.controllers if selection.is_ranked(name)]
    kept = [
        name in ranked and ts in times[plant]
        for name, plant, ts in counted[["controller", "plant", "ts_s"]].itertuples(index=False)
    ]
    return counted.loc[kept]


def _where_trained(selection: Selection, counted: pd.DataFrame) -> dict[float, pd.DataFrame]:
    own_s = {
        ts: [name for name, own in selection.trained_s.items() if own == ts]
        for ts in sorted(set(selection.trained_s.values()))
    }
    return {
        ts: ranking(counted[np.isclose(counted["ts_s"], ts)])
        for ts, names in own_s.items()
        if not all(selection.is_ranked(name) for name in names)
    }


def _where_they_run(selection: Selection) -> tuple[str, ...]:
    """Say of the policies that are not in the ranking where they are ranked."""
    apart = {n: ts for n, ts in selection.trained_s.items() if not selection.is_ranked(n)}
    return tuple(
        f"Ranked at Ts = {ts:g} s only, where they were trained and can run: "
        f"{', '.join(name for name, own in apart.items() if own == ts)}; on "
        f"{', '.join(stage.plant.name for stage in selection.stages if ts in stage.every_ts_s)}."
        for ts in sorted(set(apart.values()))
    )


def _where_they_suit(selection: Selection) -> tuple[str, ...]:
    """Say which controllers are not in the ranking since some plants have another core than theirs."""
    apart: dict[tuple[str, ...], list[str]] = {}
    for name in selection.controllers:
        on = tuple(s.plant.name for s in selection.stages if selection.suits(name, s))
        if len(on) < len(selection.stages):
            apart.setdefault(on, []).append(name)
    return tuple(
        f"Not in the ranking, since they invert another core than some of the plants have, and run on "
        f"{', '.join(on)} only: {', '.join(names)}."
        for on, names in apart.items()
    )
