"""Plausibility of records of a piezo stage, as warnings with a probable cause.

A fit succeeds on anything that rises with the command. What is out of all proportion to known stages
is said, with the mistakes that are made most often: columns swapped, units taken for others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from rdpi_gym.identification.residuals import RecordResidual
from rdpi_gym.measurement import LARGEST, Quantities, Record, longest_counted
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import digits, micrometres

# Peak-to-peak motion of piezo stages (µm): from shear plates and small signals to amplified stages;
# the longest of a catalogue move 1800 µm (Physik Instrumente, PIHera P-629).
STROKES_UM = (0.1, 2000.0)
# Voltages of piezo actuators: 60 V benders to 1000 V stacks (PI Ceramic, electrical operation).
LARGEST_V = 1000.0
# Peak-to-peak commands below are lost in the noise of any amplifier.
SMALLEST_SWING_V = 1e-3
# Bare stacks have their first mode at hundreds of kHz at most (Fleming, studylib.net/doc/18813258):
# 10 µm there are 30 m/s.
FASTEST_M_S = 30.0
# Slower sampling than this throughout is met in logs of drift, not in records of hysteresis.
SLOWEST_SAMPLING_S = 0.1
# δ2 of known stages: 0.38 and 0.39 ms (the paper's two plants), 35 ms (a PICMA stack, slowly).
LARGEST_DELTA2_S = 0.2
# Of the variance of y, and of the swing, what is little more than a constant or than no loop.
LITTLE, _OPENING = 0.1, 0.005
# Share that the fit has to explain before the sense of loops says anything.
_WELL = 0.5
# Least cycles, least relative loop area and its least number of standard errors for a sense of rotation.
_CYCLES, _LEAST_AREA, _AREA_ERRORS = 2, 0.02, 4.0
# Pieces of a record whose spectra are averaged.
_SEGMENTS = 16
# Standard deviations that a loop has to be wide to turn anywhere.
_CERTAIN = 5.0
_TYPICAL_STROKE_UM = 30.0
# Motion below is none: its squares over those of the largest command lose their digits.
_LEAST_MOTION_UM = 1.0 / LARGEST
# Factor beyond the known strokes from which on nothing is searched.
_BEYOND = 1e3
_UNITS_UM = {"m": 1e6, "mm": 1e3, "nm": 1e-3}


def check_motion(records: Sequence[Record]) -> None:
    """Refuse records in which the displacement never changes, and none at all."""
    if not records:
        raise InputError("no record to fit; give at least one training record whose voltage moves")
    for record in records:
        y = record.y_um[record.error_mask]
        if y.size and np.ptp(y) > max(1e-12 * np.max(np.abs(y)), _LEAST_MOTION_UM):
            return
    first = next((r for r in records if r.error_mask.any()), None)
    if first is not None:
        value = micrometres(float(first.y_um[first.error_mask][0]))
        raise InputError(
            f"the displacement never changes: it is {value} in {first.name}",
            "check the sensor, and the column of y with --columns y=NAME",
        )


def check_scale(records: Sequence[Record], quantities: Quantities | None = None) -> None:
    """Refuse strokes so far from any stage that searches over several effects lose their digits."""
    low, high = STROKES_UM
    said = _stroke(records, (low / _BEYOND, high * _BEYOND))
    if said is None:
        return
    if quantities is not None and not quantities.are_piezo:
        unit = quantities.output.unit
        raise InputError(
            f"a {quantities.output.name} in {unit} of this size loses its digits; "
            f"give it in a unit in which it spans {low:g} to {high:g}"
        )
    raise InputError(*said)


def plausibility_warnings(
    left: Sequence[RecordResidual],
    delta2_s: float | None = None,
    quantities: Quantities | None = None,
    clockwise: bool | None = False,
) -> list[str]:
    """Say where records or the fit to them are out of all proportion to known stages."""
    records = [each.record for each in left]
    explained = _explained(left)
    is_piezo = quantities is None or quantities.are_piezo
    found = [_little(left, explained)]
    if is_piezo or clockwise is False:
        found.append(_turning(left, explained, is_piezo))
    if is_piezo:
        stroke = _stroke(records)
        found += [stroke and "; ".join(stroke), *_command(records), _pace(records, delta2_s)]
    return [sentence for sentence in found if sentence is not None]


def _little(left: Sequence[RecordResidual], explained: float) -> str | None:
    if explained >= LITTLE:
        return None
    said = (
        f"the fit explains {max(100.0 * explained, 0.0):.1f} % of the motion, hardly more than a "
        "constant would"
    )
    linear = linear_share([each.record for each in left])
    if linear >= LITTLE:
        return (
            f"{said}; a linear filter of u would explain {100.0 * linear:.0f} %, so fast dynamics "
            "are missing: rdpi diagnose ranks them"
        )
    return (
        f"{said}: does y follow u at all? Check the columns, the sensor, and whether both were "
        "recorded at the same time"
    )


def _explained(left: Sequence[RecordResidual]) -> float:
    motion = sum(float(np.sum((y - y.mean()) ** 2)) for y in map(_counted, left))
    rest = sum(each.rmse_um**2 * each.counted for each in left)
    return 1.0 - rest / motion if motion > 0.0 else 1.0


def _counted(each: RecordResidual) -> Array:
    return each.record.y_um[each.record.error_mask]


def linear_share(records: Sequence[Record]) -> float:
    """Return the share of the power of y that is coherent with u, less what chance gives."""
    from scipy.signal import csd, welch

    coherent = power = 0.0
    for record in records:
        window = min(max(record.u_V.size // _SEGMENTS, 16), record.u_V.size)
        chance = 1.0 / max(2 * record.u_V.size // window - 1, 1)
        _, uu = welch(record.u_V, nperseg=window)
        _, yy = welch(record.y_um, nperseg=window)
        _, uy = csd(record.u_V, record.y_um, nperseg=window)
        coherence = np.abs(uy) ** 2 / np.maximum(uu * yy, 1e-300) - chance
        coherent += record.u_V.size * float(coherence[1:] @ yy[1:])
        power += record.u_V.size * float(np.sum(yy[1:]))
    return coherent / power if power > 0.0 else 0.0


def orientation(records: Sequence[Record]) -> bool | None:
    """Return whether loops turn clockwise in the plane of command and displacement.

    None where the area that they enclose does not stand out from its scatter over the cycles. A lag
    of more than half a cycle turns loops round: what is clockwise has to be so in the slowest cycle.
    """
    areas, slowest = [], (0.0, 0.0)
    for record in records:
        u, y = record.u_V - record.u_V.mean(), record.y_um - record.y_um[record.error_mask].mean()
        size = float(np.std(u) * np.std(y))
        crossings = np.flatnonzero((u[:-1] < 0.0) & (u[1:] >= 0.0))
        for start, end in pairwise(crossings.tolist()):
            part = slice(start, end + 1)
            if size > 0.0 and record.error_mask[part].all():
                # closed by a straight line: what is proportional to the command encloses nothing
                closing = 0.5 * (y[start] + y[end]) * (u[start] - u[end])
                areas.append(float(np.trapezoid(y[part], u[part]) + closing) / size)
                slowest = max(slowest, ((end - start) * record.ts_s, areas[-1]))
    if len(areas) < _CYCLES:
        return None
    middle = float(np.median(areas))
    spread = float(np.median(np.abs(np.array(areas) - middle)))
    if abs(middle) < max(_LEAST_AREA, _AREA_ERRORS * 1.4826 * spread / math.sqrt(len(areas))):
        return None
    return middle > 0.0 and slowest[1] > -_LEAST_AREA


def _turning(left: Sequence[RecordResidual], explained: float, is_piezo: bool) -> str | None:
    """Judge the sense of the loops by their area: the integral of u dy, positive where y lags."""
    if explained < _WELL:  # what is not hysteresis turns as it likes
        return None
    area, size, variance = 0.0, 0.0, 0.0
    for each in left:
        record = each.record
        u, y = record.u_V - record.u_V.mean(), record.y_um - record.y_um.mean()
        both = (record.error_mask[1:] & record.error_mask[:-1]).astype(float)
        du = np.diff(u) * both
        area += float(both @ (u[:-1] * y[1:] - u[1:] * y[:-1]))
        size += float(np.sum(np.abs(du))) * float(np.ptp(y[record.error_mask]))
        variance += (2.0 * each.rmse_um) ** 2 * float(du @ du)
    if size == 0.0 or area > -_OPENING * size or area > -_CERTAIN * math.sqrt(variance):
        return None
    who = "a piezo's" if is_piezo else "that of play operators"
    return (
        "the loops turn the wrong way: the displacement leads the voltage, where "
        f"{who} lags. "
        "u and y swapped? Check --columns; or one of them was recorded late"
    )


def _stroke(
    records: Sequence[Record], accepted: tuple[float, float] = STROKES_UM
) -> tuple[str, str] | None:
    """Judge the stroke: what is wrong with it, and what to give."""
    stroke = max(float(np.ptp(r.y_um[r.error_mask])) for r in records if r.error_mask.any())
    if accepted[0] <= stroke <= accepted[1]:
        return None
    low, high = STROKES_UM
    fitting = {u: f * stroke for u, f in _UNITS_UM.items() if low <= f * stroke <= high}
    hint = "check the column of y and its unit"
    if fitting:
        unit = min(fitting, key=lambda u: abs(math.log(fitting[u] / _TYPICAL_STROKE_UM)))
        hint = f"y in {unit}? Then give --units y={unit}"
    return (
        f"a stroke of {stroke:.3g} µm is out of proportion: piezo stages move {low:g} to {high:g} µm",
        hint,
    )


def _command(records: Sequence[Record]) -> list[str]:
    largest = max(float(np.max(np.abs(r.u_V))) for r in records)
    swing = max(float(np.ptp(r.u_V)) for r in records)
    if largest > LARGEST_V:
        hint = "u in mV? Then give --units u=mV" if largest <= 1e3 * LARGEST_V else ""
        said = f"a voltage of {largest:.3g} V is out of proportion: piezos take {LARGEST_V:g} V at most"
        return [f"{said}; {hint or 'check the column of u'}"]
    if swing < SMALLEST_SWING_V:
        return [
            f"a swing of {swing:.3g} V is out of proportion: no piezo moves visibly; u in kV? Then "
            "give --units u=kV"
        ]
    return []


def _pace(records: Sequence[Record], delta2_s: float | None) -> str | None:
    if all(record.ts_s > SLOWEST_SAMPLING_S for record in records):
        ts = min(record.ts_s for record in records)
        return (
            f"every record has {digits(ts, 3)} s or more from sample to sample, slow for a piezo "
            "stage; time in ms? Then give --units t=ms"
        )
    if delta2_s is not None and delta2_s > LARGEST_DELTA2_S:
        return (
            f"δ2 is {digits(delta2_s, 3)} s, out of proportion: thresholds grow by δ2 times the rate, "
            "and known stages have 0.4 to 35 ms; time in ms? Then give --units t=ms"
        )
    for record in filter(None, map(longest_counted, records)):
        speeds = np.abs(np.diff(record.y_um)) / record.ts_s
        if 1e-6 * float(speeds.max()) <= FASTEST_M_S:
            continue
        speed = float(np.quantile(speeds, 0.99))  # jumps left out
        if 1e-6 * speed <= FASTEST_M_S:
            continue
        return (
            f"the displacement moves at {1e-6 * speed:.3g} m/s, faster than any piezo "
            f"({FASTEST_M_S:g} m/s); check the units of t and y"
        )
    return None
