"""Comparison of compensators: tracking errors with the base model and with the present one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.tracking.episode import DIVERGED, UNSTABLE, WARNED, Caution
from rdpi_gym import face
from rdpi_gym.laboratory.views import number, numbers
from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.report.traces import thin_index
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.words import quoted

COMPENSATORS: Mapping[str, str] = {
    "none": "no compensation",
    "inversion-free-reference-rate": "inversion-free",
    "classical-reference-rate": "classical inverse",
    "core-inverse": "inverse of the hysteresis",
    "extended-inverse": "inverse with effects",
    "pi": "PI",
    "pi-extended-inverse": "PI and inverse with effects",
}
"""Compensators that are asked, and what the page calls them."""
KINDS = ("sine", "triangle", "stairs", "drawn")
NOTE = "The plant is the present model: this is its own answer, not a measurement."
_MOST, _DRAWN = 5000, 800  # samples of a run, and of what is drawn of it
_PERIODS = 3
_PER_PERIOD = 20.0  # samples, at least
_LEAD = 0.15  # of a run: the way from rest to where a reference begins
_LEVELS = (0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5)
_LOST = (UNSTABLE, DIVERGED)
_LONGEST_S, _MOST_POINTS = 3600.0, 2000


@dataclass(frozen=True)
class Course:
    """A reference as it is run, from rest on."""

    reference_um: Array  # (K,)
    ts_s: float
    first: int  # first sample that counts
    said: Mapping[str, Any]  # the request, with defaults filled in


def course(reference: Mapping[str, Any], plant: PlantModel, ts_s: float) -> Course:
    """Return the reference that a user asks for."""
    kind = reference.get("kind")
    if kind not in KINDS:
        raise InputError(f"reference: kind {quoted(kind)} is unknown; give {', '.join(KINDS)}")
    centre, usual = plant.reference_um
    if kind == "drawn":
        times, levels = _points(reference.get("points"))
        seconds, settled, slowest_s = times[-1], 0.0, math.inf
        said: dict[str, Any] = {"kind": kind, "points": reference["points"], "seconds": seconds}
    else:
        amplitude = _number(reference, "amplitude_um", usual, 1e-9, 1e6)
        frequency = _number(reference, "frequency_hz", 1.0, 1e-3, 1e5)
        seconds = _number(reference, "seconds", _PERIODS / frequency, 1e-3, _LONGEST_S)
        settled = min(1.0 / frequency, seconds / _PERIODS)  # what begins is not what goes on
        slowest_s = 1.0 / (_PER_PERIOD * frequency)
        times, levels = _shape(kind, amplitude, frequency, centre)
        said = {
            "kind": kind, "amplitude_um": amplitude, "frequency_hz": frequency, "seconds": seconds,
        }  # fmt: skip
    lead_s = _LEAD * seconds
    step = max(ts_s, (seconds + lead_s) / _MOST)
    if step > slowest_s:
        raise InputError(
            f"reference: {said['frequency_hz']:g} Hz has fewer than {_PER_PERIOD:g} samples a period "
            f"at {step:.3g} s; give {1.0 / (_PER_PERIOD * step):.3g} Hz at most, or fewer seconds"
        )
    t_s = np.arange(max(round(seconds / step), 2)) * step
    if kind == "drawn":
        wanted = np.interp(t_s, times, levels)
    elif kind == "sine":
        wanted = centre + amplitude * np.sin(2.0 * np.pi * frequency * t_s)
    else:
        within = np.mod(t_s * frequency, 1.0)
        at = np.searchsorted(times, within, side="right") - 1
        wanted = levels[at] if kind == "stairs" else np.interp(within, times, levels)
    low, high = plant.command_range_V
    rest = float(Plant(plant, step).simulate(np.full(2, min(max(0.0, low), high)))[0])
    lead = max(round(lead_s / step), 2)
    way = rest + (wanted[0] - rest) * 0.5 * (1.0 - np.cos(np.pi * np.arange(lead) / lead))
    first = lead + round(settled / step)
    return Course(np.concatenate([way, wanted]), step, first, said)


def _shape(kind: str, amplitude: float, frequency: float, centre: float) -> tuple[Array, Array]:
    """Return one period: parts of it, and displacements (µm) there."""
    if kind == "stairs":
        levels = np.array(_LEVELS)
        return np.arange(levels.size) / levels.size, centre + amplitude * levels
    corners = np.array([0.0, 0.25, 0.75, 1.0])
    return corners, centre + amplitude * np.array([0.0, 1.0, -1.0, 0.0])


def _number(reference: Mapping[str, Any], key: str, usual: float, low: float, high: float) -> float:
    value = reference.get(key)
    if value is None:
        return usual
    if not is_finite(value) or not low <= value <= high:
        raise InputError(
            f"reference: {key} = {quoted(value)}; give a number from {low:g} to {high:g}"
        )
    return float(value)


def _points(points: Any) -> tuple[Array, Array]:
    good = isinstance(points, list) and all(
        isinstance(p, list) and len(p) == 2 and all(map(is_finite, p)) for p in points
    )
    if not good or not 2 <= len(points) <= _MOST_POINTS:
        raise InputError(
            f"reference: points are pairs [t_s, y_um]; give 2 to {_MOST_POINTS} of them, as in [[0, 0], [1, 5]]"
        )
    found = np.array(points, dtype=np.float64)
    times, levels = found[:, 0] - found[0, 0], found[:, 1]
    if (np.diff(times) <= 0).any() or times[-1] > _LONGEST_S or np.ptp(levels) == 0:
        raise InputError(
            f"reference: points go forward in time, {_LONGEST_S:g} s at most, and move; draw again"
        )
    return times, levels


def payoff(
    before: PlantModel,
    after: PlantModel,
    reference: Mapping[str, Any],
    ts_s: float,
    step: str,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Track a reference with every compensator, with the belief before and with the one after.

    The present model is the plant that they drive, so this is its own answer.
    """
    asked = course(reference, after, ts_s)
    told = replace(before, command_range_V=after.command_range_V, reference_um=after.reference_um)
    names = [name for name in COMPENSATORS if _suits(name, after) and _suits(name, told)]
    rows, best, traces = [], math.inf, dict[str, Any]()
    for done, name in enumerate(names):
        if progress is not None:
            progress("compensators", done, len(names))
        blind, knowing = (
            face.track(
                name, after, asked.reference_um, asked.ts_s, belief=belief, first=asked.first
            )
            for belief in (told, after)
        )
        rows.append(
            {
                "controller": COMPENSATORS[name],
                "name": name,
                "before_um": number(blind.rmse_um),
                "after_um": number(knowing.rmse_um),
                "before_percent": number(blind.rmse_percent),
                "after_percent": number(knowing.rmse_percent),
                "warning": "; ".join(_warnings(blind.cautions, knowing.cautions)) or None,
            }
        )
        if knowing.rmse_um < best:
            best, traces = knowing.rmse_um, _trace(COMPENSATORS[name], blind, knowing, asked.first)
    return {
        "step": step, "reference": dict(asked.said), "ts_s": asked.ts_s, "note": NOTE, "rows": rows,
        "trace": traces,
    }  # fmt: skip


def _suits(name: str, belief: PlantModel) -> bool:
    try:
        face.make_controller(name, belief)
    except InputError:
        return False
    return True


def _warnings(blind: Sequence[Caution], knowing: Sequence[Caution]) -> Iterator[str]:
    """Yield what to beware of with the present belief, and where the one before loses the plant."""
    for caution in knowing:
        yield caution.text if caution.word == WARNED else str(caution)
    worst = [caution for caution in blind if caution.word in _LOST]
    if worst and not (knowing and knowing[0].word in _LOST):
        yield f"before: {worst[0]}"


def _trace(title: str, blind: face.Tracking, knowing: face.Tracking, first: int) -> dict[str, Any]:
    errors = (tracking.displacement_um - knowing.reference_um for tracking in (blind, knowing))
    at = thin_index(knowing.reference_um, *errors, samples=_DRAWN)

    return {
        "controller": title,
        "t_s": numbers(knowing.t_s[at]),
        "reference_um": numbers(knowing.reference_um[at]),
        "before_um": numbers(blind.displacement_um[at]),
        "after_um": numbers(knowing.displacement_um[at]),
        "counts_from_s": float(knowing.t_s[first]),
    }
