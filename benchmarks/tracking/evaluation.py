"""Evaluation of a run: table of scores, rankings with confidence intervals over seeds, notes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from baselines import FULL_PREVIEW
from benchmarks.rows import TRACKING, Outcome
from benchmarks.tracking.case import FEWEST_SAMPLES, MOST_SAMPLES
from benchmarks.tracking.controllers import own_of
from benchmarks.tracking.episode import tally
from benchmarks.tracking.measured import MeasuredScores, score_measured
from benchmarks.tracking.selection import Selection
from benchmarks.tracking.stages import cases
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.store import Row
from rdpi_gym.support.words import number

COLUMNS = (
    "controller", "plant", "belief", "reference", "frequency_hz", "ts_s", "seed",
    "rmse_um", "rmse_percent", "max_um", "max_percent",
    "command_total_variation", "max_command_step_V", "saturated_percent",
    "optimality_gap", "microseconds_per_sample", "status",
)  # fmt: skip
RANKING = (
    "rank", "controller", "rmse_percent", "rmse_percent_low", "rmse_percent_high", "rmse_um",
    "status", "optimality_gap", "optimality_gap_low", "optimality_gap_high",
    "seed_0_rmse_percent", "mean_rank", "mean_rank_half_width", "places",
    "command_total_variation", "microseconds_per_sample", "rows", "errors",
)  # fmt: skip
"""Columns of a ranking as ``ranking.csv`` has them; ``cautions`` beside them is the status of a bound too."""
CASE = ["plant", "reference", "frequency_hz", "ts_s"]
CONFIDENCE = 0.95
_EFFORT = "command_total_variation"


def score_table(rows: Sequence[Row]) -> pd.DataFrame:
    """Relate every row to the bound's on the same truth."""
    bound = {TRACKING.key(row)[1:]: row for row in rows if row["controller"] == FULL_PREVIEW}
    table = []
    for row in rows:
        best = bound.get(TRACKING.key(row)[1:], {})
        table.append(
            row
            | {
                "command_total_variation": _ratio(row, best, "command_variation_V_s"),
                "optimality_gap": _ratio(row, best, "rmse_um"),
            }
        )
    return pd.DataFrame(table, columns=list(COLUMNS))


def _ratio(row: Row, best: Row, name: str) -> float:
    value, least = row.get(name), best.get(name)
    return float(value / least) if value is not None and least else float("nan")


def interval(draws: Array) -> tuple[float, float]:
    """Mean and half-width of its confidence interval by Student's t, NaN below two draws."""
    n = len(draws)
    if n < 2:
        return float(np.mean(draws)), float("nan")
    t = stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE)
    return float(np.mean(draws)), float(t * np.std(draws, ddof=1) / np.sqrt(n))


def ranged(frame: pd.DataFrame, column: str, digits: int = 3, stem: str = "") -> list[str]:
    """Write a column of means, each with its interval in brackets where it has one.

    The ends of the interval are the columns `stem`, by default `column`, with ``_low`` and ``_high``.
    """
    ends = (frame[f"{stem or column}{end}"] for end in ("_low", "_high"))
    return [
        f"{number(mean)} ({number(low, digits)} to {number(high, digits)})"
        if np.isfinite(low)
        else number(mean)
        for mean, low, high in zip(frame[column], *ends, strict=True)
    ]


def ranking_view(ranked: pd.DataFrame) -> pd.DataFrame:
    """Return the ranking with the columns and headings that a reader sees."""
    return pd.DataFrame(
        {
            "rank": ranked["rank"],
            "controller": ranked["controller"],
            "RMSE (%)": ranged(ranked, "rmse_percent"),
            "RMSE (µm)": ranked["rmse_um"],
            "status": ranked["status"],
            "RMSE, seed 0 (%)": ranked["seed_0_rmse_percent"],
            "optimality gap": ranged(ranked, "optimality_gap"),
            "mean rank": ranked["mean_rank"],
            "places": ranked["places"],
            "command variation": ranked["command_total_variation"],
            "µs per sample": ranked["microseconds_per_sample"],
            "rows": ranked["rows"],
        }
    )


def drawn(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of drawn truths: seed 0, the nominal plant, only where it is alone."""
    rows = table[table["seed"] != 0]
    return table if rows.empty else rows


def ranking(table: pd.DataFrame) -> pd.DataFrame:
    """Rank the controllers by paired comparisons of their RMSE (%) over all cases.

    The geometric mean is taken for each seed, as are those of the RMSE (µm) and of the optimality gaps, and
    the mean rank (by RMSE within each case, the bound aside; a row with an error is last). Each is
    given as the mean over the drawn seeds, with its confidence interval.

    A controller is better than another where the confidence interval of their paired difference is
    below zero: that of the mean, over the drawn seeds, of the difference of the logarithms of their
    geometric means, by Student's t. Its rank is one more than the number of better ones; controllers
    of one rank are in the order of their means. The bound has no rank.
    """
    rivals = table[table["controller"] != FULL_PREVIEW]
    errors = rivals["rmse_um"].fillna(np.inf)
    ranks = errors.groupby([rivals[name] for name in [*CASE, "seed"]]).rank(method="average")
    table = table.assign(case_rank=ranks)
    lines = [_line(str(name), rows) for name, rows in table.groupby("controller", sort=False)]
    ranked = pd.DataFrame(lines, columns=[*RANKING, "cautions"])
    labels = _labels(rivals, [str(name) for name in ranked["controller"]])
    for column in ("rank", "places"):
        ranked[column] = [labels[name][column] for name in ranked["controller"]]
    ends = {"bound": 0.0, "–": np.inf}
    place = [ends[r] if r in ends else float(r.rstrip("=")) for r in ranked["rank"]]
    return (
        ranked.assign(place=place)
        .sort_values(["place", "rmse_percent", "mean_rank"], na_position="last", ignore_index=True)
        .drop(columns="place")
    )


def _line(controller: str, rows: pd.DataFrame) -> dict[str, object]:
    draws, nominal = drawn(rows), rows[rows["seed"] == 0]
    rank, rank_half = interval(draws.groupby("seed")["case_rank"].mean().to_numpy())
    status = cautions = tally(rows["status"].tolist())
    if controller == FULL_PREVIEW:
        status = "bound" if cautions == "ok" else f"bound, {cautions}"
    return _means(draws, "rmse_percent", "rmse_um", "optimality_gap", _EFFORT) | {
        "controller": controller,
        "status": status,
        "cautions": cautions,
        "seed_0_rmse_percent": _means(nominal, "rmse_percent")["rmse_percent"],
        "mean_rank": rank,
        "mean_rank_half_width": rank_half,
        "microseconds_per_sample": float(rows["microseconds_per_sample"].median()),
        "rows": len(rows),
        "errors": int(rows["rmse_um"].isna().sum()),
    }


def _labels(rivals: pd.DataFrame, order: Sequence[str]) -> dict[str, dict[str, str]]:
    """Rank and places of every controller, from paired differences over the drawn seeds."""
    logs = _log_means(drawn(rivals), "rmse_percent", ["seed", "controller"]).unstack()
    names = [name for name in order if name in logs.columns and logs[name].notna().all()]
    n = len(names)
    worse = np.array([[exceeds(logs[a] - logs[b]) for b in names] for a in names])
    labels = {name: {"rank": "–", "places": "–"} for name in order}
    labels[FULL_PREVIEW] = {"rank": "bound", "places": "–"}
    ranks = (1 + worse.sum(axis=1)).tolist() if n else []
    for i, name in enumerate(names):
        best, last = ranks[i], n - int(worse[:, i].sum())
        labels[name] = {
            "rank": f"{best}{'=' if ranks.count(best) > 1 else ''}",
            "places": f"{best} to {last}" if best < last else f"{best}",
        }
    return labels


def exceeds(differences: ArrayLike) -> bool:
    """Whether paired differences, one a seed, are above zero with all of their confidence interval.

    One seed tells nothing of chance: there the difference itself counts.
    """
    mean, half = interval(np.asarray(differences, dtype=np.float64))
    return mean > (half if np.isfinite(half) else 0.0)


def _log_means(rows: pd.DataFrame, column: str, by: Sequence[str]) -> pd.Series[float]:
    """Mean logarithm over the cases; a row without numbers must not make it better: it is missing."""
    with np.errstate(divide="ignore"):
        logs = np.log(rows[column])
    groups = logs.groupby([rows[name] for name in by])
    means: pd.Series[float] = groups.agg(lambda values: values.mean(skipna=False))
    return means


def _means(rows: pd.DataFrame, *columns: str) -> dict[str, float]:
    """Geometric means of columns over the cases and seeds, each with its confidence interval."""
    found = {}
    seeds = rows["seed"].to_numpy()
    # arrays: pandas takes seconds for thousands of groups of a few rows
    of_seed = [seeds == seed for seed in np.unique(seeds)]
    for column in columns:
        with np.errstate(divide="ignore", invalid="ignore"):
            logs = np.log(rows[column].to_numpy(dtype=np.float64))
            by_seed = np.array([np.mean(logs[part]) for part in of_seed])
        mean, half = interval(by_seed) if len(by_seed) else (np.nan, np.nan)
        for name, log in (("", mean), ("_low", mean - half), ("_high", mean + half)):
            found[f"{column}{name}"] = float(np.exp(log))
    return found


def by_case(table: pd.DataFrame) -> pd.DataFrame:
    """Summarise every controller and case: geometric means over the drawn seeds."""
    names = ["controller", *CASE]
    columns = ["rmse_percent", "rmse_percent_low", "rmse_percent_high", _EFFORT, "rmse_um"]
    status = table.groupby(names, sort=False)["status"].agg(lambda rows: tally(rows.tolist()))
    return _summary(table, names, columns).merge(status.reset_index(), on=names)


def by_sampling_time(table: pd.DataFrame) -> pd.DataFrame:
    """Summarise every controller, plant and sampling time: geometric means over the drawn seeds."""
    return _summary(table, ["controller", "plant", "ts_s"], ["rmse_percent", _EFFORT])


def _summary(table: pd.DataFrame, names: list[str], columns: list[str]) -> pd.DataFrame:
    lines = [
        dict(zip(names, values, strict=True)) | _means(rows, "rmse_percent", "rmse_um", _EFFORT)
        for values, rows in drawn(table).groupby(names, sort=False)
    ]
    return pd.DataFrame(lines, columns=[*names, *columns])


def by_plant(selection: Selection, rows: Sequence[Row]) -> dict[str, float]:
    """Summarise rows of one controller as the ranking does: RMSE (%) on each plant, NaN after an error."""
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    kept = drawn(table[~_marks(table, _beyond(selection))])
    return {
        str(plant): float(np.exp(np.log(errors).mean(skipna=False)))
        for plant, errors in kept.groupby("plant", sort=False)["rmse_percent"]
    }


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
        Summaries, see :mod:`benchmarks.tracking.evaluation`. Only `by_case` holds the cases beyond
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
    def own(self) -> list[str]:
        """A user's own controllers, whose rows are shown wherever they stand."""
        return own_of(self.selection.controllers)

    @property
    def first_seed(self) -> int:
        """The first seed that was asked for."""
        return self.selection.seeds[0]

    @property
    def noise_um(self) -> Mapping[str, float]:
        """Sensor noise (µm rms) of each plant."""
        return {stage.plant.name: stage.plant.sensor.noise_um for stage in self.selection.stages}

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
        sentence = (
            f"Smallest error: {best['controller']}, RMSE {number(best['rmse_percent'])} % of peak to peak "
            f"({number(best['rmse_um'])} µm)"
        )
        if np.isfinite(best["rmse_percent_low"]):
            sentence += (
                f", {100 * CONFIDENCE:g} % interval {number(best['rmse_percent_low'])} to "
                f"{number(best['rmse_percent_high'])} %"
            )
        tied = [str(n) for n in rivals.loc[rivals["rank"] == best["rank"], "controller"].iloc[1:]]
        sentence += f"; status {best['status']}."
        return sentence + (f" Tied with it: {', '.join(tied)}." if tied else "")


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
        measured = MeasuredScores(
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
    ranked = {name for name in selection.controllers if selection.is_ranked(name)}
    times = {stage.plant.name: stage.ts_s for stage in selection.stages}
    rows = counted[["controller", "plant", "ts_s"]].itertuples(index=False)
    return counted.loc[[name in ranked and ts in times[plant] for name, plant, ts in rows]]


def _where_trained(selection: Selection, counted: pd.DataFrame) -> dict[float, pd.DataFrame]:
    """Return the rankings at the sampling times (s) of policies that are not in the main one."""
    apart = {ts for name, ts in selection.trained_s.items() if not selection.is_ranked(name)}
    return {ts: ranking(counted[np.isclose(counted["ts_s"], ts)]) for ts in sorted(apart)}


def _where_they_run(selection: Selection) -> Iterator[str]:
    """State of what is not in the ranking where it runs: policies, and controllers of another core."""
    apart = {n: ts for n, ts in selection.trained_s.items() if not selection.is_ranked(n)}
    for ts in sorted(set(apart.values())):
        yield (
            f"Ranked at Ts = {ts:g} s only, where they were trained and can run: "
            f"{', '.join(name for name, own in apart.items() if own == ts)}; on "
            f"{', '.join(s.plant.name for s in selection.stages if ts in s.every_ts_s)}."
        )
    unsuited: dict[tuple[str, ...], list[str]] = {}
    for name in selection.controllers:
        on = tuple(s.plant.name for s in selection.stages if selection.suits(name, s))
        if len(on) < len(selection.stages):
            unsuited.setdefault(on, []).append(name)
    for on, names in unsuited.items():
        yield (
            "Not in the ranking, since they invert another core than some of the plants have, and "
            f"run on {', '.join(on)} only: {', '.join(names)}."
        )
