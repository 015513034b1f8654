"""What a final model truly leaves, and whether what is said of it is true."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.foreign_effects.degradations import Sampled
from benchmarks.foreign_effects.forms import TIMED
from rdpi_gym.diagnosis.results import SearchResult, View
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.measurement.record import BoolArray
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array

MARGIN = 0.1
"""By which the true share may lie outside of the interval."""
EXPLAINED = 1.3
"""Noise floors of clean error that an explained record may have left."""
_NOTHING = 0.5  # noise floors: of less no share is asked
_SAMPLED = 0.5  # noise floors that lie between the samples: from here on sampling matters
_OF_TRUTH = 2.0  # largest ratio of a numerical floor that is believed
_FEW_SAMPLES = 4.0  # of the shortest time of what is hidden: with fewer, sampling matters
_GAIN = "gain_drift"
_MOST_MOVED = 4  # samples
_TIMES = ("time_constant_s", "delay_s")


def what_is_left(
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
    """By how many samples y was moved ahead where the records were looked through, u left alone."""
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
    """What the effects of a model that go by the clock add to its displacement (µm)."""
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


def judge_sentences(row: Mapping[str, Any]) -> dict[str, Any]:
    """Judge what a result says of what is left."""
    truth, true_left = row["truth"], row["true_left"]
    noise = truth["noise_um"]
    # what is stated counts as far as the truth itself moves with what lies between the samples
    floor = min(row.get("numerical_floor_um") or 0.0, _OF_TRUTH * truth["sampling_um"])
    clean = math.nan if true_left["clean_um"] is None else true_left["clean_um"]
    part = math.nan if true_left["by_input_um"] is None else true_left["by_input_um"]
    share = _share(clean, part, floor) if clean > math.hypot(_NOTHING * noise, floor) else None
    left = row.get("left") or {}
    share_true = hidden_true = explained_true = sampling_true = None
    if share is not None and left.get("low") is not None and left.get("high") is not None:
        share_true = bool(left["low"] - MARGIN <= share <= left["high"] + MARGIN)
    if share is not None and left.get("hidden_um") is not None:
        most = (1.0 + MARGIN) * math.hypot(left["hidden_um"], floor, _NOTHING * noise)
        hidden_true = bool(part <= most)
    if row["verdict"] in ("explained", "no missing effect") and not math.isnan(clean):
        explained_true = bool(clean <= EXPLAINED * math.hypot(noise, floor))
    if row.get("sampling"):
        sampling_true = sampling_matters(truth)
    said = [x for x in (share_true, hidden_true, explained_true, sampling_true) if x is not None]
    return {
        "clean_ratio": clean / noise,
        "true_share": share,
        "share_true": share_true,
        "hidden_true": hidden_true,
        "explained_true": explained_true,
        "sampling_true": sampling_true,
        "all_true": all(said),
    }


def _share(clean_um: float, by_input_um: float, floor_um: float) -> float:
    beyond = max(by_input_um**2 - floor_um**2, 0.0)
    return min(beyond / max(clean_um**2 - floor_um**2, 1e-300), 1.0)


def sampling_matters(truth: Mapping[str, Any]) -> bool:
    """Whether faster sampling would show more.

    Either the motion between the samples moves the displacement at them by half a noise floor, or
    something that is hidden has a time of fewer than four samples, or a mode above a fifteenth of
    the rate.
    """
    if truth["sampling_um"] > _SAMPLED * truth["noise_um"]:
        return True
    slowest = min(truth["rates_hz"])
    for effect in truth["hidden"]:
        times = [effect[key] for key in _TIMES if key in effect and effect["effect"] not in TIMED]
        if any(time * slowest < _FEW_SAMPLES for time in times):
            return True
        if effect.get("f0_hz", 0.0) > slowest / 15.0:
            return True
    return False
