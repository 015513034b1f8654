"""Foreign records with their truth: degradations by instruments and files, and the residual of a model."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.effect_discovery.cases import Sampled
from benchmarks.effect_discovery.forms import TIMED
from rdpi_gym.diagnosis.results import SearchResult, View
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.measurement import Dataset, Record, load
from rdpi_gym.measurement.record import BoolArray
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.files import write_atomic

Degrade = Callable[[Sampled, np.random.Generator], Sampled]


def _changed(s: Sampled, y: Array, bad: BoolArray) -> Sampled:
    return replace(s, record=replace(s.record, y_um=y), is_sound=s.is_sound & ~bad)


def _spikes(s: Sampled, rng: np.random.Generator) -> Sampled:
    """Let one sample in a hundred be far off, by up to half of the stroke."""
    y = s.record.y_um.copy()
    bad = rng.random(y.size) < 0.01
    far = np.ptp(y) * np.exp(rng.uniform(np.log(0.01), np.log(0.5), y.size))
    y[bad] += (far * rng.choice([-1.0, 1.0], y.size))[bad]
    return _changed(s, y, bad)


def _dropouts(s: Sampled, rng: np.random.Generator) -> Sampled:
    """Let the sensor hold its value, or show zero, one to three times for 5 to 50 ms."""
    y, bad = s.record.y_um.copy(), np.zeros(s.record.y_um.size, dtype=np.bool_)
    is_zero = bool(rng.random() < 0.5)
    for _ in range(int(rng.integers(1, 4))):
        length = max(3, round(rng.uniform(0.005, 0.05) / s.record.ts_s))
        length = min(length, y.size // 20)
        start = int(rng.integers(y.size // 10, y.size - length))
        y[start : start + length] = 0.0 if is_zero else y[start]
        bad[start : start + length] = True
    return _changed(s, y, bad)


def _clipped_output(s: Sampled, rng: np.random.Generator) -> Sampled:
    """Let the sensor's converter end within the stroke, on one side or both."""
    y = s.record.y_um
    low, high = np.quantile(y, [rng.uniform(0.0, 0.06), 1.0 - rng.uniform(0.01, 0.08)])
    clipped = np.clip(y, low, high)
    return _changed(s, clipped, clipped != y)


def _clipped_input(s: Sampled, rng: np.random.Generator) -> Sampled:
    """Let the converter that records the command end within its range; the plant saw the whole."""
    u = s.record.u_V
    high = float(np.quantile(u, 1.0 - rng.uniform(0.01, 0.06)))
    clipped = np.minimum(u, high)
    sound = s.is_sound & (clipped == u)
    return replace(s, record=replace(s.record, u_V=clipped), is_sound=sound)


def _apart(s: Sampled, rng: np.random.Generator) -> Sampled:
    """Let u and y be one sample apart, either way round."""
    return _shifted(s, 1.0 if rng.random() < 0.5 else -1.0, 0.0)


def _skew(s: Sampled, rng: np.random.Generator) -> Sampled:
    """Let the clock of y run fast or slow by 5 to 50 ppm, in steps of whole samples."""
    return _shifted(s, 0.0, rng.uniform(5e-6, 5e-5) * (1.0 if rng.random() < 0.5 else -1.0))


def _shifted(s: Sampled, samples: float, skew: float) -> Sampled:
    k = np.arange(s.record.y_um.size)
    at = np.clip(np.round(k - samples - skew * k), 0, k[-1]).astype(np.int64)
    return replace(
        s, record=replace(s.record, y_um=s.record.y_um[at]), clean_um=s.clean_um[at],
        by_input_um=s.by_input_um[at],
    )  # fmt: skip


DEGRADATIONS: Mapping[str, Degrade] = {
    "spikes": _spikes,
    "dropouts": _dropouts,
    "clipped output": _clipped_output,
    "clipped input": _clipped_input,
    "one sample apart": _apart,
    "clock skew": _skew,
}
"""Degradations of a record's samples, by name."""

CLOCKS: tuple[str, ...] = ("rounded stamps", "jittered stamps", "missing rows")
"""Degradations on the way through a file."""

KINDS: tuple[str, ...] = (*DEGRADATIONS, *CLOCKS)
"""All degradations."""

# What may be named without being wrong, as it describes what was done.
EXCUSED: Mapping[str, tuple[str, ...]] = {"one sample apart": ("delay",)}


def degrade(kind: str, records: list[Sampled], rng: np.random.Generator) -> list[Sampled]:
    """Do one of :data:`DEGRADATIONS` to every record; of a clock shift, the same to all."""
    if kind not in DEGRADATIONS:
        return records
    seed = int(rng.integers(2**31))
    is_clock = kind in ("one sample apart", "clock skew")
    return [
        DEGRADATIONS[kind](s, np.random.default_rng(seed if is_clock else [seed, k]))
        for k, s in enumerate(records)
    ]


def through_files(kind: str, dataset: Dataset, rng: np.random.Generator) -> Dataset:
    """Write records to files whose stamps or rows are not sound, and read them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        roles = "".join(f'[records."{r.name}"]\nrole = "{r.role}"\n' for r in dataset.records)
        write_atomic(folder / "dataset.toml", roles)
        for r in dataset.records:
            t, y, kept = r.t_s.copy(), r.y_um.copy(), np.ones(r.t_s.size, dtype=np.bool_)
            if kind == "jittered stamps":
                t[1:-1] += rng.uniform(-0.1, 0.1, t.size - 2) * r.ts_s
            if kind == "missing rows":
                bad = rng.integers(10, t.size - 10, max(4, t.size // 400))
                kept[bad[::2]] = False
                y[bad[1::2]] = np.nan
            # rounded stamps have the fewest digits of which no two are the same
            digits = int(np.ceil(-np.log10(r.ts_s) - 1e-9)) if kind == "rounded stamps" else 9
            columns = zip(t[kept], r.u_V[kept], y[kept], strict=True)
            rows = [f"{a:.{digits}f},{b:.9g},{c:.9g}" for a, b, c in columns]
            write_atomic(folder / f"{r.name}.csv", "\n".join(["t,u,y", *rows, ""]))
        return replace(load(folder), title=dataset.title)


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
