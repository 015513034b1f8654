"""What the plays remember from before a record: seen where a loop stands about its start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, cannot_tell, zone_of
from rdpi_gym.diagnosis.features.half_cycles import HalfCycles
from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.words import digits

NAME = "initial memory"
THRESHOLD_PERCENT = 5.0
"""Distance of a record's start from where it should be (% of half the loop's opening)."""
_ROUGH_PERCENT = 15.0  # the same, where the stage comes from 0 V, far from the loop's middle
_CENTRED = 0.03  # of the swing: the loop stands about the record's start
_REACH = 0.3  # of the swing: it goes at least so far to both sides
_AT_ZERO = 0.02  # of the swing: a start at 0 V
_FROM_AFAR = 0.45  # of the swing: so far from 0 V the stage comes along a whole branch
_SLOW = 0.1  # of the fastest rate: lags shift the start of faster records
_NOISE = 200.0  # per cent: of one sample and of the loop's middle, with some hum
_CLOSED = 1e-6  # of the displacement: a loop that does not open
_EXPERIMENT = "Begin each record with a decaying sine: it wipes out what came before."


def initial_memory(records: Sequence[tuple[Record, HalfCycles]]) -> Check:
    """Compare a record's first displacement with the loop that it goes through later.

    Without a past the plays begin in the middle: halfway between the falling and the rising branch
    of a loop that stands about the first command. Effects that are odd or small there (saturation,
    congruency, asymmetry) do not shift it, a remembered excursion does.
    """
    rates = [float(np.max(np.abs(np.diff(r.u_V)))) / r.ts_s for r, _ in records]
    limit = max(_SLOW * max(rates, default=0.0), min(rates, default=0.0))
    found = []
    for (record, cycles), rate in zip(records, rates, strict=True):
        place = _place(record, cycles) if rate <= limit else None
        if place is not None:
            found.append((*place, record.name))
    if not found:
        return cannot_tell(
            NAME,
            "No record begins in the middle of a loop that it goes through later, so what the "
            "plays remembered when it began cannot be seen.",
            _EXPERIMENT,
        )
    sure = [entry for entry in found if entry[1] < entry[2]]
    value, error, threshold, name = max(sure or found, key=lambda e: abs(e[0]) / e[2])
    zone = zone_of(value, error, threshold)
    facts = (
        f"{name} begins {digits(abs(value))} % of half its loop's opening away from where a stage "
        "that had rested at 0 {input_unit} would"
    )
    if zone == "yes":
        text = f"{facts}: the plays remember an excursion from before the record."
    elif zone == "no":
        text = f"{name} begins where a stage that had rested at 0 {{input_unit}} would: no memory from before."
    else:
        text = f"{facts}, not safely more than the noise."
    step = "" if zone == "no" else _EXPERIMENT
    return Check(NAME, value, threshold, "%", zone, text, step, ("initial_memory",))


def _place(record: Record, cycles: HalfCycles) -> tuple[float, float, float] | None:
    """Start above where it should be (% of half the loop's opening), its error and threshold."""
    u, edges = record.u_V, cycles.edges
    start, swing = float(u[0]), float(np.ptp(u))
    if abs(start) < _AT_ZERO * swing:
        expected, threshold = 0.0, THRESHOLD_PERCENT
    elif abs(start) > _FROM_AFAR * swing:
        expected, threshold = -100.0 * float(np.sign(start)), _ROUGH_PERCENT
    else:
        return None
    turns = u[np.maximum(edges - 1, 0)] - start
    size = np.abs(turns)
    so_far = np.maximum.accumulate(np.abs(u - start))[edges[2:] - 1]
    lesser = np.minimum(size[:-1], size[1:])
    about = (turns[:-1] * turns[1:] < 0) & (np.abs(np.diff(size)) < _CENTRED * swing)
    # before the loop has gone as far as anything did, it still holds the past
    widest = (lesser[:-1] > so_far - _CENTRED * swing) & (lesser[:-1] > _REACH * swing)
    moving = cycles.whole[:-1] & cycles.whole[1:]
    for h in np.flatnonzero(about[:-1] & widest & moving)[:1]:
        first, second = (slice(int(edges[i]) - 1, int(edges[i + 1])) for i in (h, h + 1))
        return _in_loop(record, first, second, bool(cycles.rising[h]), expected, threshold)
    return None


def _in_loop(
    record: Record,
    first: slice,
    second: slice,
    first_rises: bool,
    expected: float,
    threshold: float,
) -> tuple[float, float, float] | None:
    u, y, start = record.u_V, record.y_um, float(record.u_V[0])
    a, b = _crossing(u[first], y[first], start), _crossing(u[second], y[second], start)
    if a is None or b is None:
        return None
    falling, rising = (b, a) if first_rises else (a, b)
    half, noise = 0.5 * (falling - rising), rough_part(y)
    if abs(half) <= max(5.0 * noise, _CLOSED * float(np.ptp(y))):
        return None
    value = 100.0 * (float(y[0]) - 0.5 * (a + b)) / half - expected
    return value, _NOISE * noise / abs(half), threshold


def _crossing(u: Array, y: Array, level: float) -> float | None:
    """Displacement where a stroke passes a command (µm)."""
    rising = u[-1] > u[0]
    at = int(np.argmax(u >= level)) if rising else int(np.argmax(u <= level))
    if at == 0 or u[at] == u[at - 1]:
        return None
    share = (level - u[at - 1]) / (u[at] - u[at - 1])
    return float(y[at - 1] + share * (y[at] - y[at - 1]))
