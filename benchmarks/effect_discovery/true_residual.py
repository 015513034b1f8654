"""Residual of a final model against the displacement that no sensor has read."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from benchmarks.effect_discovery.degradations import Sampled
from benchmarks.effect_discovery.forms import TIMED
from rdpi_gym.diagnosis.results import SearchResult, View
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.measurement.record import BoolArray
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array

_GAIN = "gain_drift"
_MOST_MOVED = 4  # samples


def true_residual(
    discovery: SearchResult, records: Sequence[Sampled], hidden: Collection[str] = ()
) -> dict[str, float | None]:
    """Compare a final model with the displacement that no sensor has read, on validation records."""
    plant, by_name = discovery.plant, {s.record.name: s for s in records}
    timed = any(e.name in TIMED for e in plant.effects)
    clean, by_input, count = 0.0, 0.0, 0
    for view in discovery.views:
        if view.role != "validation" or view.name not in by_name:
            continue
        s = by_name[view.name]
        clock = _clock(view, s)
        t = clock - s.record.ts_s * _moved_samples(view, s, clock)
        sound = np.interp(view.t_s, t, s.is_sound.astype(np.float64)) > 0.99
        known = (view.t_s > t[0] - 0.1 * s.record.ts_s) & (view.t_s < t[-1] + 0.1 * s.record.ts_s)
        counted = (view.counted > 0.5) & sound & known
        if not counted.any():
            continue
        model = view.models_um[list(view.models_um)[-1]]
        truth, part = (np.interp(view.t_s, t, y) for y in (s.clean_um, s.by_input_um))
        clean += _square(truth - model, counted)
        if _GAIN in hidden:
            part = _at_mean_gain(truth, part, counted)
        by_clock = _by_clock(plant, view, s.record.ts_s, counted) if timed else np.zeros_like(model)
        by_input += _square(part - (model - by_clock), counted)
        count += int(counted.sum())
    if not count:
        return {"clean_um": None, "by_input_um": None}
    return {"clean_um": math.sqrt(clean / count), "by_input_um": math.sqrt(by_input / count)}


def _clock(view: View, s: Sampled) -> Array:
    """Times of the samples as the result counts them (s): stamps that were rounded run otherwise."""
    return view.t_s if view.t_s.size == s.record.t_s.size else s.record.t_s


def _moved_samples(view: View, s: Sampled, clock: Array) -> float:
    """Return by how many samples preprocessing moved y ahead, u left alone."""
    counted = view.counted > 0.5
    given = np.interp(view.t_s, clock, s.record.y_um)
    if not counted.any() or np.allclose(view.y_um[counted], given[counted]):
        return 0.0
    shifts = np.linspace(-_MOST_MOVED, _MOST_MOVED, 20 * _MOST_MOVED + 1)
    left = [
        _square(view.y_um - np.interp(view.t_s + d * s.record.ts_s, clock, s.clean_um), counted)
        for d in shifts
    ]
    return float(shifts[int(np.argmin(left))])


def _by_clock(plant: PlantModel, view: View, ts_s: float, counted: BoolArray) -> Array:
    """Contribution of a model's time-driven effects to its displacement (µm)."""
    record = Record(view.name, view.t_s, view.u_V, view.y_um, ts_s=ts_s)

    def simulated(left_out: Sequence[str]) -> Array:
        effects = tuple(e for e in plant.effects if e.name not in left_out)
        return np.asarray(simulate_effects([Variant(plant.hysteresis, effects)], record)[:, 0])

    still = simulated(TIMED)
    if any(e.name == _GAIN for e in plant.effects):
        still = _at_mean_gain(simulated([name for name in TIMED if name != _GAIN]), still, counted)
    return np.asarray(simulated(()) - still)


def _at_mean_gain(whole: Array, still: Array, counted: BoolArray) -> Array:
    """Displacement without a drift of the gain, at the gain that it has in the middle of a record.

    Without it, a gain that has drifted before the record would count as a function of the clock.
    """
    x, y = still[counted] - still[counted].mean(), whole[counted] - whole[counted].mean()
    return np.asarray(still * float(x @ y) / max(float(x @ x), 1e-300))


def _square(error: Array, counted: BoolArray) -> float:
    """Sum of squares about the mean, over the samples that count."""
    e = error[counted]
    return float(np.sum((e - e.mean()) ** 2))
