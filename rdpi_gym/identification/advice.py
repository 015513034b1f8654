"""What a fit cannot know from its data, in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from rdpi_gym.identification.bounds import Bounds
from rdpi_gym.identification.rates import RateSpread
from rdpi_gym.identification.refine import Point
from rdpi_gym.identification.uncertainty import Z95, Uncertainty

# Errors correlated over more samples than this are no noise.
_CORRELATED = 3.0


def delta2_warnings(
    point: Point, uncertainty: Uncertainty, spread: RateSpread, bounds: Bounds
) -> list[str]:
    """Say where the data do not determine δ2: rates alike, zero as likely, or a bound."""
    delta2, most = point.theta[1], bounds.delta2_s[1]
    found = []
    if spread.alike:
        same_rate = spread.rate_factor <= spread.pace_factor
        how = "the command keeps one" if same_rate else "every movement takes about the same time"
        found.append(
            f"δ2 is not determined by these data: all rates are alike, {how} (peak rates "
            f"{spread.slowest_V_s:.3g} to {spread.fastest_V_s:.3g} V/s), so a delay, a lag or other "
            "thresholds would explain them as well; record other frequencies before using the "
            "model there"
        )
    if delta2 <= 0.0:
        found.append("δ2 is at its bound 0: thresholds that grow with the rate do not help the fit")
    elif delta2 >= most:
        found.append(
            f"δ2 is at its bound {most:.3g} s, where no play moves even in the slowest record"
        )
    elif delta2 < Z95 * uncertainty.theta[1]:
        found.append(
            "the 95 % interval of δ2 reaches 0: its effect is lost in the error of the fit; "
            "record faster movements"
        )
    return found


def bound_warnings(
    point: Point, moving: Sequence[bool], names: Sequence[str], bounds: Bounds
) -> list[str]:
    """Name the parameters that the search left at a bound."""
    found = []
    delta1, (least, most) = point.theta[0], bounds.delta1_V
    if not least < delta1 < most:
        found.append(
            f"δ1 is at its bound {delta1:.3g} V; between {least:.3g} and {most:.3g} V thresholds "
            "show in these data"
        )
    if not point.passive[0]:
        found.append(
            "a_0 is at its bound: the displacement stands still after every turning point, as with "
            "backlash, and no compensator that divides by a_0 (Eq. 6) will work"
        )
    still = [i for i in range(1, len(moving)) if not moving[i]]
    if still:
        found.append(
            f"{_weights(still)} held at 0: the thresholds are so near to the largest excursion, or "
            "beyond it, that these plays hardly move; record larger amplitudes or take fewer plays"
        )
    zero = [i for i in range(1, len(moving)) if moving[i] and not point.passive[i]]
    if zero:
        found.append(f"{_weights(zero)} at the bound 0: these plays do not help the fit")
    for name, extremum in zip(names, point.theta[2:], strict=False):
        if abs(extremum) >= bounds.reach_V:
            found.append(f"the memory extremum of {name} is at its bound {extremum:.3g} V")
    return found


def correlation_warning(lengths: Iterable[float]) -> list[str]:
    """Say where the error of the fit is no noise: correlated from sample to sample."""
    longest = max(lengths)
    if longest < _CORRELATED:
        return []
    return [
        f"the error is no noise: it is correlated over about {longest:.0f} samples, so the model "
        "misses something; standard errors are widened for that, not for what is missing"
    ]


def _weights(indices: Sequence[int]) -> str:
    runs = np.split(np.array(indices), np.flatnonzero(np.diff(indices) > 1) + 1)
    parts = [
        f"a_{run[0]} ... a_{run[-1]}" if run.size > 2 else ", ".join(f"a_{i}" for i in run)
        for run in runs
    ]
    return f"{', '.join(parts)} {'is' if len(indices) == 1 else 'are'}"
