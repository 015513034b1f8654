"""Everything that the tables, the page and the picture of a run are made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from benchmarks.tracking.leaderboard import (
    CASE,
    by_case,
    by_sampling_time,
    ranking,
    score_table,
)
from benchmarks.tracking.learned import trained_at_s
from benchmarks.tracking.measured import MeasuredScores, no_scores, score_measured
from benchmarks.tracking.run import Outcome
from benchmarks.tracking.selection import Selection
from benchmarks.tracking.suite import FEWEST_SAMPLES, MOST_SAMPLES, cases
from rdpi_gym.support.store import Row

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
        a plant's identification, marked in its column ``extrapolated``. `where_trained` are rankings
        over the cases of one sampling time (s) each: those of learned controllers, which run at no
        other; empty where nothing else was scored.
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
        """Controllers, best first."""
        return [str(name) for name in self.ranking["controller"]]

    @property
    def first_seed(self) -> int:
        """The first seed that was asked for."""
        return self.selection.seeds[0]

    @property
    def shown_setting(self) -> tuple[str, float]:
        """First plant, and the sampling time (s) at which it is shown in detail."""
        stage = self.selection.stages[0]
        return stage.plant.name, stage.shown_ts_s


def evaluate(selection: Selection, outcome: Outcome) -> Evaluation:
    """Summarise the rows of a run, and score the feedforwards on measured records.

    The measured records belong to the plant ``picma`` and are scored together with it.
    """
    table = score_table(outcome.rows)
    table = table[table["controller"].isin(selection.controllers)].reset_index(drop=True)
    beyond = _beyond(selection)
    if all(key in beyond for key in table[CASE].itertuples(index=False, name=None)):
        beyond = []  # then there is nothing else to rank
    counted = table[~_marks(table, beyond)]
    summary = by_case(table)
    summary["extrapolated"] = _marks(summary, beyond)
    plants = {stage.plant.name: stage.plant for stage in selection.stages}
    if MEASURED_PLANT in plants:
        measured = score_measured(selection.controllers, plants[MEASURED_PLANT])
    else:
        measured = no_scores(
            f"No scores on measured records: the plant {MEASURED_PLANT} is not among those scored."
        )
    return Evaluation(
        selection,
        tuple(row for row in outcome.rows if row["controller"] in selection.controllers),
        table,
        ranking(counted),
        summary,
        by_sampling_time(counted),
        _where_trained(selection, counted),
        measured,
        (*selection.notes, *left_out(selection), *_unranked(beyond)),
    )


def left_out(selection: Selection) -> tuple[str, ...]:
    """Name the cases that do not suit a sampling time, one sentence for each Ts."""
    plants: dict[tuple[float, str], list[str]] = {}
    for stage in selection.stages:
        for ts in stage.ts_s:
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
        for ts in stage.ts_s
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


def _where_trained(selection: Selection, counted: pd.DataFrame) -> dict[float, pd.DataFrame]:
    found = {}
    for ts in trained_at_s(selection.controllers):
        part = counted[np.isclose(counted["ts_s"], ts)]
        if 0 < len(part) < len(counted):
            found[ts] = ranking(part)
    return found
