"""What a model leaves of a record, seen from several sides; a stretch brushed in one is found in all."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.laboratory.views import numbers, spans_s
from rdpi_gym.measurement import Record
from rdpi_gym.report.thin import thin_index
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

Mask = NDArray[np.bool_]
_LOOP, _STRETCH = 1500, 1000
_BINS, _FEWEST = 30, 8
_SEGMENT = 4096
_AT_REST = 1e-6  # of the widest swing, from sample to sample
_SHORTEST_REST = 10  # samples
_MOST_SPANS = 400  # more are no stretches that an eye tells apart


def residual_views(record: Record, model_um: Array, noise_um: float | None) -> dict[str, Any]:
    """Return what a model leaves of a record over time, command, rate, frequency, time at rest."""
    counted = record.error_mask
    residual = record.y_um - model_um
    at = thin_index(record.y_um, model_um, samples=_LOOP)
    whole = thin_index(residual, samples=_LOOP)
    return {
        "record": record.name,
        "time": {"t_s": numbers(record.t_s[whole]), "residual_um": numbers(residual[whole])},
        "command": _profile("u", record.u_V[counted], residual[counted]),
        "rate": _profile("rate", _rate_V_s(record)[counted], residual[counted]),
        "frequency": _spectrum(record, residual, counted),
        "rest": _at_rest(record, residual, counted),
        "loop": {
            "u": numbers(record.u_V[at]),
            "y_um": numbers(record.y_um[at]),
            "model_um": numbers(model_um[at]),
        },
        "noise_um": noise_um,
    }


def brushed(
    record: Record, model_um: Array, by: str, low: float | None, high: float | None
) -> dict[str, Any]:
    """Return the samples of a stretch in every view, so that it is seen in all."""
    if by not in _OVER:
        raise InputError(f"by is {quoted(by)}; give one of {', '.join(_OVER)}")
    over = _OVER[by](record)
    above = -math.inf if low is None else low
    chosen = (over >= above) & (over <= (math.inf if high is None else high))
    residual, rate = record.y_um - model_um, _rate_V_s(record)
    at = np.flatnonzero(chosen)
    if at.size:
        at = at[thin_index(record.y_um[at], residual[at], samples=_STRETCH)]
    left = numbers(residual[at])
    counted = chosen & record.error_mask
    spans = spans_s(record, chosen)
    whole = (
        counted if len(spans) == 1 else np.zeros_like(counted)
    )  # cuts have a spectrum of their own
    return {
        "record": record.name,
        "spans_s": spans[:_MOST_SPANS],
        "rms_um": float(np.sqrt(np.mean(residual[counted] ** 2))) if counted.any() else None,
        "time": {"t_s": numbers(record.t_s[at]), "residual_um": left},
        "command": {"u": numbers(record.u_V[at]), "residual_um": left},
        "rate": {"rate": numbers(rate[at]), "residual_um": left},
        "frequency": _spectrum(record, residual, whole),
        "rest": _at_rest(record, residual, counted),
        "loop": _pieces(record, at, chosen),
    }


def _pieces(record: Record, at: NDArray[np.intp], chosen: Mask) -> dict[str, Any]:
    """Return samples of the loop; None lifts the pen where one stretch ends."""
    piece = np.cumsum(np.diff(chosen.astype(np.int8), prepend=0) > 0)[at]
    gaps = np.flatnonzero(np.diff(piece)) + 1
    lifted = np.insert(np.stack([record.u_V[at], record.y_um[at]]), gaps, np.nan, axis=1)
    return {"u": numbers(lifted[0]), "y_um": numbers(lifted[1])}


def _rate_V_s(record: Record) -> Array:
    return np.gradient(record.u_V, record.ts_s)


def _rests(record: Record) -> Iterator[tuple[int, int, float]]:
    """Yield first and last sample of each rest of the command, and the sign of the move before it."""
    step = np.abs(np.diff(record.u_V, prepend=record.u_V[0]))
    still = step <= _AT_REST * max(float(np.ptp(record.u_V)), 1e-300)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    for first, last in edges.reshape(-1, 2).tolist():
        if first > 0 and last - first >= _SHORTEST_REST:
            yield first, last, float(np.sign(record.u_V[first] - record.u_V[max(first - 5, 0)]))


def _rested_s(record: Record) -> Array:
    """Return for every sample since when the command rests (s); NaN where it does not."""
    rested = np.full(record.t_s.size, np.nan)
    for first, last, _ in _rests(record):
        rested[first:last] = (np.arange(last - first) + 1) * record.ts_s
    return rested


_OVER: dict[str, Callable[[Record], Array]] = {
    "time": lambda record: record.t_s,
    "command": lambda record: record.u_V,
    "rate": _rate_V_s,
    "rest": _rested_s,
}


def _profile(name: str, x: Array, residual: Array) -> dict[str, Any]:
    """Return mean, rms and the middle nine tenths of a residual along a quantity."""
    if not x.size:
        return {key: [] for key in (name, "rms_um", "mean_um", "low_um", "high_um")}
    low, high = np.percentile(x, [0.25, 99.75])
    edges = np.linspace(low, high if high > low else low + 1.0, _BINS + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _BINS - 1)
    order = np.argsort(place, kind="stable")
    parts = np.split(residual[order], np.searchsorted(place[order], np.arange(1, _BINS)))
    known = [k for k, part in enumerate(parts) if part.size >= _FEWEST]
    some = [parts[k] for k in known]
    middle = 0.5 * (edges[1:] + edges[:-1])
    return {
        name: numbers(middle[known]),
        "rms_um": [float(np.sqrt(np.mean(p**2))) for p in some],
        "mean_um": [float(np.mean(p)) for p in some],
        "low_um": [float(np.percentile(p, 5)) for p in some],
        "high_um": [float(np.percentile(p, 95)) for p in some],
    }


def _spectrum(record: Record, residual: Array, counted: Mask) -> dict[str, Any]:
    """Return the rms of a residual in tenths of a decade of frequency, by Welch's method."""
    from scipy.signal import welch

    at = np.flatnonzero(counted)
    if at.size < 2 * _SHORTEST_REST:
        return {"hz": [], "um": []}
    within = slice(at[0], at[-1] + 1)
    left = np.where(counted, residual, 0.0)[within]
    share = at.size / left.size
    hz, power = welch(left, 1.0 / record.ts_s, nperseg=min(_SEGMENT, left.size), detrend="constant")
    hz, power = hz[1:], power[1:] / share
    band = np.round(10.0 * np.log10(hz)).astype(int)
    bands = np.unique(band)
    rms = np.array([math.sqrt(power[band == b].sum() * hz[0]) for b in bands])
    return {"hz": numbers(10.0 ** (bands / 10.0)), "um": numbers(rms)}


def _at_rest(record: Record, residual: Array, counted: Mask) -> dict[str, Any]:
    """Return how a residual goes on while the command rests, in the direction of the last move."""
    times: list[Array] = []
    gone: list[Array] = []
    for first, last, move in _rests(record):
        inside = np.arange(first, last)[counted[first:last]]
        if move and inside.size:
            start_um = float(residual[first : first + 4].mean())
            times.append(record.ts_s * (inside.astype(np.float64) - (first - 1)))
            gone.append(move * (residual[inside] - start_um))
    if not times:
        return {"s": [], "um": []}
    t_s, um = np.concatenate(times), np.concatenate(gone)
    bins = np.geomspace(record.ts_s, t_s.max() * 1.001, 25)
    place = np.clip(np.searchsorted(bins, t_s, side="right") - 1, 0, 23)
    count = np.bincount(place, minlength=24)
    known = count >= _FEWEST
    mean = np.bincount(place, weights=um, minlength=24)[known] / count[known]
    return {"s": numbers(np.sqrt(bins[1:] * bins[:-1])[known]), "um": numbers(mean)}
