"""How the opening of a loop grows with the rate: linearly, where thresholds are δ1 i + δ2 |v|."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, cannot_tell, zone_of
from rdpi_gym.diagnosis.features.half_cycles import HalfCycles
from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.words import digits, pm

NAME = "rate law"
THRESHOLD = 0.15
"""Distance of the exponent from 1."""
_WIDE = 0.9  # of the widest swing: loops that are compared
_APART = 3.0  # times: two rates differ
_GROWTH = 0.02  # of the opening at rest: a rate dependence worth an exponent
_SYSTEMATIC = 1e-4  # of the stroke: creep opens loops by as much more at one rate than at another
_EXPONENTS = np.linspace(0.1, 4.0, 391)
_EXPERIMENT = "Take sines of the full amplitude at four frequencies over a decade or more, and a slow triangle."


@dataclass(frozen=True)
class Opening:
    """Half of a loop's opening at its middle (µm), with its error, and the rate there (V/s)."""

    rate_V_s: float
    half_um: float
    error_um: float
    record: str


def rate_law(records: Sequence[tuple[Record, HalfCycles]], span_V: float) -> Check:
    """Exponent with which the opening of the widest loops grows with the rate.

    Where every play slides, the displacement at a loop's middle is short of the static one by the
    sum of a_i r_i: Eq. 8 makes it linear in |v|, and so do a delay and a lag.
    """
    openings = [o for r, c in records for o in _openings(r, c, _WIDE * span_V)]
    levels = _levels(openings)
    if len(levels) < 3:
        return cannot_tell(
            NAME,
            "Loops over the full range are there at fewer than three rates, so it cannot be seen "
            "how thresholds grow with the rate.",
            _EXPERIMENT,
        )
    rate = np.array([level.rate_V_s for level in levels])
    half = np.array([level.half_um for level in levels])
    stroke_um = max(float(np.ptp(r.y_um)) for r, _ in records)
    error = np.array([np.hypot(level.error_um, _SYSTEMATIC * stroke_um) for level in levels])
    growth = abs(half[-1] - half[0])
    if growth < max(_GROWTH * abs(half[0]), 10.0 * float(np.hypot(error[0], error[-1]))):
        text = f"Loops open as far at {digits(rate[-1])} {{input_unit}}/s as at {digits(rate[0])} {{input_unit}}/s: nothing depends on the rate."
        return Check(NAME, None, THRESHOLD, "", "no", text)
    value, uncertain = _exponent(rate, half, error)
    zone = zone_of(value - 1.0, uncertain, THRESHOLD)
    facts = f"From {digits(rate[0])} to {digits(rate[-1])} {{input_unit}}/s the loops' opening grows with the power {pm(value, uncertain)} of the rate"
    if zone == "yes":
        text = f"{facts}; δ2 |v|, a delay or a lag would give 1."
    elif zone == "no":
        text = f"{facts}, as δ2 |v|, a delay or a lag has it."
    else:
        text = f"{facts}: too uncertain."
    effects = ("slew_limit", "rate_law") if value > 1.0 else ("rate_law",)
    step = _EXPERIMENT if zone == "cannot tell" else ""
    return Check(NAME, value, THRESHOLD, "", zone, text, step, effects)


def _exponent(rate: Array, half: Array, error: Array) -> tuple[float, float]:
    """Exponent p of w_0 + c v^p by a scan, and its error."""
    weight = 1.0 / error
    costs = []
    for p in _EXPONENTS:
        rows = np.column_stack([np.ones_like(rate), (rate / rate[-1]) ** p]) * weight[:, None]
        left = half * weight - rows @ np.linalg.lstsq(rows, half * weight, rcond=None)[0]
        costs.append(float(left @ left))
    at = int(np.argmin(costs))
    inside = min(max(at, 1), len(costs) - 2)
    bend = costs[inside - 1] - 2.0 * costs[inside] + costs[inside + 1]
    step = float(_EXPONENTS[1] - _EXPONENTS[0])
    freedom = max(len(rate) - 3, 1)
    excess = max(1.0, costs[at] / freedom)
    spread = step * float(np.sqrt(2.0 * excess / bend)) if bend > 0.0 else np.inf
    return float(_EXPONENTS[at]), spread


def _levels(openings: Sequence[Opening]) -> list[Opening]:
    """Mean opening at each rate that is well apart from the others, the slowest first."""
    groups: list[list[Opening]] = []
    for opening in sorted(openings, key=lambda o: o.rate_V_s):
        if groups and opening.rate_V_s < _APART * groups[-1][0].rate_V_s:
            groups[-1].append(opening)
        else:
            groups.append([opening])
    levels = []
    for group in groups:
        # of a group that spreads over rates, the loops that are as fast as its slowest
        alike = [o for o in group if o.rate_V_s < 1.05 * group[0].rate_V_s]
        half = np.array([o.half_um for o in alike])
        noise = group[0].error_um / np.sqrt(len(alike))
        spread = float(half.std() / np.sqrt(len(alike)))
        levels.append(
            Opening(
                float(np.mean([o.rate_V_s for o in alike])), float(half.mean()),
                float(np.hypot(noise, spread)), group[0].record,
            )
        )  # fmt: skip
    return levels


def _openings(record: Record, cycles: HalfCycles, width_V: float) -> list[Opening]:
    edges, u, y = cycles.edges, record.u_V, record.y_um
    noise = rough_part(y)
    found = []
    span = np.abs(np.diff(u[np.maximum(edges - 1, 0)]))
    wide = cycles.whole & (span >= width_V)
    for h in np.flatnonzero(wide[:-1] & wide[1:]):
        turns = u[edges[h : h + 3] - 1]
        middle = 0.25 * turns[0] + 0.5 * turns[1] + 0.25 * turns[2]
        one = _through(record, int(edges[h]) - 1, int(edges[h + 1]), middle)
        other = _through(record, int(edges[h + 1]) - 1, int(edges[h + 2]), middle)
        if one is not None and other is not None:
            half, rate = 0.5 * abs(one[0] - other[0]), 0.5 * (one[1] + other[1])
            found.append(Opening(rate, half, 0.71 * noise, record.name))
    return found


def _through(record: Record, first: int, last: int, level: float) -> tuple[float, float] | None:
    """Displacement (µm) and rate (V/s) where a stroke passes a command."""
    u = record.u_V[first:last]
    past = (u >= level) if u[-1] > u[0] else (u <= level)
    at = int(np.argmax(past))
    if at == 0 or u[at] == u[at - 1]:
        return None
    share = (level - u[at - 1]) / (u[at] - u[at - 1])
    y = record.y_um[first + at - 1 : first + at + 1]
    rate = abs(u[at] - u[at - 1]) / record.ts_s
    return float(y[0] + share * (y[1] - y[0])), float(rate)
