"""Degradations of records by instruments and files: outliers, dropouts, clipping, clocks, missing rows."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rdpi_gym.measurement import Dataset, Record, load
from rdpi_gym.measurement.record import BoolArray
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.files import write_atomic


@dataclass(frozen=True, eq=False)
class Sampled:
    """One record with what is true of it at its samples."""

    record: Record  # as it will be given away
    # displacement without noise, and the part of it that follows from the input, ``(T,)``
    clean_um: Array
    by_input_um: Array
    is_sound: BoolArray  # samples whose measurement is what the sensor would show, ``(T,)``


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
