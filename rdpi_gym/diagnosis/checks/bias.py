"""Loops of one span at several biases: to a play operator they are the same loop (congruency)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, cannot_tell, zone_of
from rdpi_gym.diagnosis.features.half_cycles import HalfCycles
from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.measurement import Record
from rdpi_gym.support.words import digits

NAME = "congruency"
THRESHOLD_PERCENT = 0.4
"""Change of a loop's height from the middle of the range to its sides (%)."""
_ALIKE = 0.03  # of the span: two commands are the same
_RATE_ALIKE = 0.1
_APART = 0.3  # of the span: two biases differ
_EXPERIMENT = "Take minor loops of one span at three biases, three times each, at one slow rate."


@dataclass(frozen=True)
class Loop:
    """A closed loop: middle and span (V), mean rate (V/s), gain and its error (µm/V).

    The gain is the height of the loop over its span.
    """

    bias_V: float
    span_V: float
    rate_V_s: float
    gain_um_V: float
    error_um_V: float
    record: str


def congruency(loops: Sequence[Loop]) -> Check:
    """Change of the height of same-span loops with their bias."""
    groups = _groups(loops)
    if not groups:
        return cannot_tell(
            NAME,
            "There are no closed loops of one span at three biases, so it cannot be seen whether "
            "the gain depends on where a loop stands.",
            _EXPERIMENT,
        )
    values = [_curvature(group) for group in groups]
    best = min(range(len(values)), key=lambda i: values[i][1])
    (value, error), group = values[best], groups[best]
    zone = zone_of(value, error, THRESHOLD_PERCENT)
    where = f"Loops of {digits(group[0].span_V, 3)} {{input_unit}} in {group[0].record}"
    facts = f"{where} are {digits(abs(value))} % {'higher' if value > 0 else 'lower'} at the sides of the range than in its middle"
    effects: tuple[str, ...] = ("congruency",)
    if zone == "yes" and value > 0:
        text = f"{facts}: to play operators they would be the same."
    elif zone == "yes":
        text = f"{facts}: to play operators they would be the same; a gain that falls outwards is saturation."
        effects = ("saturation", "congruency")
    elif zone == "no":
        text = (
            f"{where} have the same height in the middle of the range and at its sides: congruent."
        )
    else:
        text = f"{facts}, not safely more than the noise."
    step = _EXPERIMENT if zone == "cannot tell" else ""
    return Check(NAME, value, THRESHOLD_PERCENT, "%", zone, text, step, effects)


def closed_loops(record: Record, cycles: HalfCycles) -> list[Loop]:
    """Find pairs of strokes that return to where they began, the first visit of each left out."""
    edges, u, y = cycles.edges, record.u_V, record.y_um
    turns = np.maximum(edges - 1, 0)
    noise = rough_part(y)
    found = []
    at = u[turns]
    span = np.abs(np.diff(at))
    h = np.arange(2, max(edges.size - 2, 2))
    apart = np.maximum(np.abs(at[h + 2] - at[h]), np.abs(at[h - 1] - at[h + 1]))
    closed = (apart <= _ALIKE * span[h]) & cycles.whole[h] & cycles.whole[h + 1]
    for a, b, c in zip(*(turns[h[closed] + i].tolist() for i in range(3)), strict=True):
        # up and down together: a drift cancels
        wide = float(abs(u[b] - u[a]))
        ways = wide + float(abs(u[b] - u[c]))
        gain = float(abs(y[b] - y[a]) + abs(y[b] - y[c])) / ways
        rate = wide / ((b - a) * record.ts_s)
        middle = 0.5 * float(u[a] + u[b])
        found.append(Loop(middle, wide, rate, gain, 2.5 * noise / ways, record.name))
    return found


def _groups(loops: Sequence[Loop]) -> list[list[Loop]]:
    """Loops of one span and rate that stand at three biases or more."""
    groups: list[list[Loop]] = []
    for loop in loops:
        for group in groups:
            like = abs(loop.span_V - group[0].span_V) <= _ALIKE * loop.span_V
            if like and abs(loop.rate_V_s - group[0].rate_V_s) <= _RATE_ALIKE * loop.rate_V_s:
                group.append(loop)
                break
        else:
            groups.append([loop])
    return [group for group in groups if _biases(group) >= 3]


def _biases(group: Sequence[Loop]) -> int:
    places: list[float] = []
    for loop in sorted(group, key=lambda each: each.bias_V):
        if not places or loop.bias_V - places[-1] > _APART * loop.span_V:
            places.append(loop.bias_V)
    return len(places)


def _curvature(group: Sequence[Loop]) -> tuple[float, float]:
    """Part of the height that is even in the bias, at the outermost bias (%), and its error."""
    bias = np.array([loop.bias_V for loop in group])
    gain = np.array([loop.gain_um_V for loop in group])
    error = np.array([loop.error_um_V for loop in group])
    middle = 0.5 * (bias.min() + bias.max())
    x = (bias - middle) / (bias.max() - middle)
    rows = np.column_stack([np.ones_like(x), x, x * x])
    inverse = np.linalg.pinv(rows.T @ rows)
    solution = inverse @ (rows.T @ gain)
    misfit = gain - rows @ solution
    freedom = max(len(group) - 3, 1)
    spread = max(float(misfit @ misfit) / freedom, float(np.mean(error**2)))
    return (
        100.0 * float(solution[2] / solution[0]),
        100.0 * float(np.sqrt(inverse[2, 2] * spread) / abs(solution[0])),
    )
