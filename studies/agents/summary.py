"""Interquartile means over trainings and plants, with bootstrap intervals, and ratios to the best.

The interquartile mean is that of rliable (Agarwal et al., 2021): the mean of the middle half of all
scores of a contestant, each of one training on one plant; where a quarter of them is no whole number,
the scores at its ends count in part, so that compensators, which are scored once a plant, and agents,
scored once a training and plant, are cut alike. For an interval, trainings and plants are
drawn again with replacement, the plants within their group; all contestants get the same plants, so
that a ratio compares like with like.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from rdpi_gym.support.arrays import Array
from studies.agents.worlds import LITERAL

ALL_GROUPS = "all groups"
CONFIDENCE = 0.95
_CUT = 0.25
_ERROR, _VARIATION = "rmse_percent", "command_variation_V_s"
_RIVALS = ("feedforward", "feedback")  # what is causal and was not trained


@dataclass(frozen=True)
class Estimate:
    """An interquartile mean and the same of every resample.

    Parameters
    ----------
    value
        Of the scores.
    draws
        Of the resamples, ``(R,)``.
    """

    value: float
    draws: Array

    def over(self, other: Estimate) -> Estimate:
        """Return the ratio to another one, resample by resample."""
        with np.errstate(invalid="ignore"):
            return Estimate(float(self.value / other.value), self.draws / other.draws)

    def row(self, name: str) -> dict[str, float]:
        """Return value and interval as columns."""
        tail = 50.0 * (1.0 - CONFIDENCE)
        # an order statistic: between two infinities there is nothing to interpolate
        low, high = np.percentile(self.draws, [tail, 100.0 - tail], method="nearest")
        return {name: self.value, f"{name}_low": float(low), f"{name}_high": float(high)}


def interquartile_mean(scores: Array) -> Array:
    """Return the mean of the middle half along the last axis: exactly a quarter is cut at each end."""
    edges = np.linspace(0.0, 1.0, scores.shape[-1] + 1)
    shares = np.diff(np.clip(edges, _CUT, 1.0 - _CUT)) / (1.0 - 2.0 * _CUT)
    counted = shares > 0.0  # an infinite score that is cut must not make the mean NaN
    return np.asarray(np.sort(scores, axis=-1)[..., counted] @ shares[counted], dtype=np.float64)


def estimate(matrices: Sequence[Array], resamples: int, seed: int = 0) -> Estimate:
    """Return the interquartile mean of scores and of their resamples."""
    plants_rng, trainings_rng = np.random.default_rng([seed, 0]), np.random.default_rng([seed, 1])
    trainings = len(matrices[0])
    again = trainings_rng.integers(trainings, size=(resamples, trainings, 1))
    drawn = []
    for matrix in matrices:
        plants = plants_rng.integers(matrix.shape[1], size=(resamples, 1, matrix.shape[1]))
        drawn.append(matrix[again, plants].reshape(resamples, -1))
    value = interquartile_mean(np.concatenate([matrix.ravel() for matrix in matrices]))
    return Estimate(float(value), interquartile_mean(np.concatenate(drawn, axis=1)))


def summarise(table: pd.DataFrame, resamples: int) -> pd.DataFrame:
    """Summarise a table of scores, world by world and all together."""
    worlds = list(table["world"].unique())
    parts = [(ALL_GROUPS, worlds)] if len(worlds) > 1 else []
    parts += [(world, [world]) for world in worlds]
    lines: list[dict[str, object]] = []
    for name, chosen in parts:
        lines += _summary(name, table[table["world"].isin(chosen)], chosen, resamples)
    return pd.DataFrame(lines)


def gap_summary(table: pd.DataFrame, resamples: int) -> pd.DataFrame:
    """Put each domain beside its twin with a literal rate."""
    lines: list[dict[str, object]] = []
    for domain in [name for name in table["world"].unique() if not name.endswith(LITERAL)]:
        limited = _estimates(table, [domain], resamples)
        literal = _estimates(table, [domain + LITERAL], resamples)
        best = limited[_best(limited)][_VARIATION]
        for (name, kind), own in limited.items():
            other = literal[name, kind]
            lines.append(
                {
                    "domain": domain, "contestant": name, "kind": kind,
                    **own[_ERROR].row(_ERROR),
                    **other[_ERROR].row(f"literal_{_ERROR}"),
                    **other[_ERROR].over(own[_ERROR]).row("literal_ratio"),
                    **own[_VARIATION].over(best).row("variation_ratio"),
                    **other[_VARIATION].over(best).row("literal_variation_ratio"),
                }
            )  # fmt: skip
    order = pd.DataFrame(lines)
    place = order["domain"].map({name: i for i, name in enumerate(order["domain"].unique())})
    ranked = order.assign(place=place).sort_values(["place", _ERROR], ignore_index=True)
    return ranked.drop(columns="place")


_Estimates = Mapping[tuple[str, str], Mapping[str, Estimate]]


def _summary(
    name: str, table: pd.DataFrame, worlds: Sequence[str], resamples: int
) -> list[dict[str, object]]:
    found = _estimates(table, worlds, resamples)
    leader = _best(found)
    best = found[leader]
    leading_feedforward = _best(found, ("feedforward",))
    feedforward = found[leading_feedforward]
    lines: list[dict[str, object]] = []
    for (contestant, kind), own in found.items():
        rows = table[table["contestant"] == contestant]
        lines.append(
            {
                "world": name, "contestant": contestant, "kind": kind,
                "trainings": rows["training_seed"].nunique(),
                "plants": len(rows[["world", "plant_seed"]].drop_duplicates()),
                **own[_ERROR].row(_ERROR),
                **own[_VARIATION].row(_VARIATION),
                "best": leader[0],
                **own[_ERROR].over(best[_ERROR]).row("rmse_ratio"),
                **own[_VARIATION].over(best[_VARIATION]).row("variation_ratio"),
                "best_feedforward": leading_feedforward[0],
                **own[_ERROR].over(feedforward[_ERROR]).row("rmse_over_feedforward"),
                **own[_VARIATION].over(feedforward[_VARIATION]).row("variation_over_feedforward"),
                "failed": int(rows[_ERROR].isna().sum()),
            }
        )  # fmt: skip
    return sorted(lines, key=lambda line: float(str(line[_ERROR])))


def _best(found: _Estimates, kinds: Sequence[str] = _RIVALS) -> tuple[str, str]:
    return min((one for one in found if one[1] in kinds), key=lambda one: found[one][_ERROR].value)


def _estimates(table: pd.DataFrame, worlds: Sequence[str], resamples: int) -> _Estimates:
    table = table[table["world"].isin(worlds)]
    return {
        (str(name), str(kind)): {
            column: estimate([_matrix(rows, world, column) for world in worlds], resamples)
            for column in (_ERROR, _VARIATION)
        }
        for (name, kind), rows in table.groupby(["contestant", "kind"], sort=False)
    }


def _matrix(rows: pd.DataFrame, world: str, column: str) -> Array:
    part = rows[rows["world"] == world].assign(training=rows["training_seed"].fillna(-1))
    wide = part.pivot(index="training", columns="plant_seed", values=column)
    return np.asarray(wide.astype(float).fillna(np.inf).to_numpy(), dtype=np.float64)
