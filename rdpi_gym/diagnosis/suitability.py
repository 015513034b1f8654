"""Limits of records in principle, and the thinning of long ones before a search."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.diagnosis.features.cycles import BoolArray, half_cycles, vary
from rdpi_gym.diagnosis.features.noise import repeat_noise
from rdpi_gym.diagnosis.features.recurrence import find_rests
from rdpi_gym.diagnosis.notices import Code, Notice
from rdpi_gym.diagnosis.preprocessing import joined_records
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import MOST_SAMPLES, fit_joint, kept_samples
from rdpi_gym.identification.plausibility import LITTLE, linear_share
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array

FEW_SAMPLES = 500
"""Fewer samples to fit than this, and small effects are lost in the freedom of the fit."""
_FEWEST_OTHERS = 3  # fewer are how a record begins and ends
_SMALL = 0.1  # of the widest swing
_LONG_S, _LONG = 0.05, 20.0  # a rest: seconds, or moves of a record


def limits(dataset: Dataset) -> tuple[Notice, ...]:
    """Return what these records cannot tell; nothing where they can tell everything."""
    records = [r for r in dataset.records if not r.is_quiet and r.role != "test"]
    if not records:
        return (Notice(Code.STILL),)
    found = []
    train = dataset.train
    samples = sum(int(r.error_mask.sum()) for r in train)
    if samples < FEW_SAMPLES:
        found.append(Notice(Code.FEW_SAMPLES, numbers=(samples, FEW_SAMPLES)))
    if train and (follows := linear_share(train)) < LITTLE:
        found.append(Notice(Code.UNRELATED, numbers=(max(follows, 0.0),)))
    if len(records) == 1:
        found.append(Notice(Code.ONE_RECORD))
    return (*found, *_of_commands(records))


def _of_commands(records: list[Record]) -> list[Notice]:
    cycles = [half_cycles(r.u_V, r.ts_s) for r in records]
    swings = np.concatenate([c.amplitude_V[c.whole] for c in cycles])
    paces = np.concatenate([c.frequency_hz[c.whole] for c in cycles])
    span_V = max(float(np.ptp(r.u_V)) for r in records)
    rests = any(
        rest.move_V and rest.duration_s > max(_LONG_S, _LONG * rest.record.ts_s)
        for r in records
        for rest in find_rests(r, span_V)
    )
    found = []
    if swings.size < _FEWEST_OTHERS and not rests:
        found.append(Notice(Code.FEW_HALF_CYCLES, numbers=(swings.size,)))
    elif swings.size:
        if not vary(paces):
            found.append(Notice(Code.ONE_FREQUENCY, numbers=(float(np.median(paces)),)))
        if not vary(swings):
            found.append(Notice(Code.ONE_AMPLITUDE))
    if not rests:
        found.append(Notice(Code.NO_REST))
    if min(float(np.ptp(r.u_V)) for r in records) > _SMALL * span_V:
        found.append(Notice(Code.NO_SMALL_SIGNALS))
    if all(repeat_noise(r) is None for r in records):
        found.append(Notice(Code.NO_REPETITION))
    return found


def falls(records: Sequence[Record]) -> bool:
    """Whether the displacement falls where the voltage rises."""
    moments = [
        np.mean((r.u_V - r.u_V.mean()) * (r.y_um - np.median(r.y_um)) * r.error_mask)
        for r in records
    ]
    return bool(np.sum(moments) < 0)


def turned(dataset: Dataset) -> Dataset:
    """Return the data set with the sign of every displacement turned."""
    records = tuple(replace(r, y_um=-r.y_um) for r in dataset.records)
    return replace(dataset, records=records)


def unrelated(train: Sequence[Record]) -> str | None:
    """Say that the displacement hardly follows the voltage, or None."""
    follows = linear_share(train)
    if follows >= LITTLE:
        return None
    return template("unrelated", percent=100 * max(follows, 0.0))


def comb(records: Sequence[Record]) -> RDPI:
    """Return the RDPI model on the fine fixed comb of a search, to be fitted: convex in its weights."""
    return RDPI.comb(data_scale(records))


SEARCH_MOST = MOST_SAMPLES
"""Samples of all records together that a search reads where there are twice as many or more."""
_FEWEST = 4000  # samples that are read of a record at least
_PER_PERIOD = 10.0  # samples in the shortest period of the displacement
# Of the noise, or of the displacement's rms where there is less noise: motion that may be faster.
_FASTER_NOISE, _FASTER = 0.3, 2e-5
# What a spectrum stands above its floor by where there is more than noise; samples in a segment.
_ABOVE, _SEGMENT = 4.0, 2**15
# What the lines between samples may miss of the command, in the displacement: rms, of the noise or
# of the displacement's rms; and at most anywhere, of the command's swing.
_BETWEEN_NOISE, _BETWEEN, _ANYWHERE = 0.3, 5e-5, 2e-3
# Passes and samples of the fit whose plays and rate are simulated on the samples that are kept.
_PASSES, _FITTED = 8, 12_000
# Bins of command and speed that tell a stretch's variety, by how much another has to be richer, and
# the share of the swing that its history has to hold for its memory to be known.
_BINS, _RICHER, _HISTORY = 16, 1.2, 0.95


@dataclass(frozen=True, eq=False)
class Thinned:
    """Part of a data set that a search reads."""

    # The same records with fewer samples; quiet records and those for tests as they are
    dataset: Dataset
    # The samples at the beginning of records (``bool[N]``) that were given, of those that are read
    openings: Mapping[str, BoolArray]
    sentence: str  # what is read, and what is of all samples


def thinned(
    dataset: Dataset, openings: Mapping[str, BoolArray], most: int | None = None
) -> Thinned | None:
    """Return the `most` samples that a search reads of a data set; None where it reads all."""
    most = SEARCH_MOST if most is None else most
    moving = [r for r in dataset.records if r.role != "test" and not r.is_quiet]
    total = sum(int(r.error_mask.sum()) for r in moving)
    if total < 2 * most:
        return None
    room = _room([r.t_s.size for r in moving], most)
    train = close_up([r for r in moving if r.role == "train" and r.error_mask.any()])
    model = fit_joint(train, comb(train), passes=_PASSES, samples=_FITTED).variant
    records, few = {}, dict(openings)
    ways: dict[tuple[int, int], list[str]] = {}
    for record in moving:
        if record.t_s.size <= room:
            continue
        step = _largest_step(record, -(-record.t_s.size // room), model)
        part, opened = _every(record, step), openings.get(record.name)
        cut = _stretch(part, room) if part.t_s.size > room else slice(0, part.t_s.size)
        records[record.name] = _with_history(part, cut, room // 2)
        if opened is not None:
            few[record.name] = opened[::step][cut]
        size = cut.stop - cut.start if part.t_s.size > room else 0
        ways.setdefault((step, size), []).append(record.name)
    found = replace(dataset, records=tuple(records.get(r.name, r) for r in dataset.records))
    return Thinned(found, few, _sentence(ways, dataset, total))


def close_up(records: Sequence[Record]) -> tuple[Record, ...]:
    """Return records as they were sampled, each no longer than what a search reads of it."""
    room = _room([r.t_s.size for r in records])
    found = []
    for record in records:
        start = max(0, int(np.argmax(record.error_mask)) - room // 4)
        whole = record.t_s.size <= room
        cut = slice(start, min(start + room, record.t_s.size))
        found.append(record if whole else _with_history(record, cut, room // 4))
    return tuple(found)


def _room(sizes: Sequence[int], most: int | None = None) -> int:
    """Samples that each record may keep: those that have fewer leave theirs to the others."""
    left, many = SEARCH_MOST if most is None else most, len(sizes)
    for size in sorted(sizes):
        if size * many > left:
            break
        left, many = left - size, many - 1
    return max(left // max(many, 1), _FEWEST)


def _every(record: Record, step: int) -> Record:
    """Return one sample in so many, the first one among them."""
    before_V = record.before_V[::-1][step - 1 :: step][::-1]
    few = record.cut(slice(None, None, step))
    return replace(few, ts_s=step * record.ts_s, before_V=before_V)


def _with_history(record: Record, cut: slice, most: int) -> Record:
    """Return a stretch; one within the record with at most so many samples of what came before."""
    part = record.cut(cut)
    return part if cut.start == 0 else replace(part, before_V=part.before_V[-most:])


def _largest_step(record: Record, most: int, model: Variant[Core]) -> int:
    """Return the largest step, up to `most`, at which what a model follows is still there."""
    noise_um, fastest_hz = _noise_and_fastest(record)
    most = min(most, max(1, int(1.0 / (record.ts_s * _PER_PERIOD * fastest_hz))))
    low, high = 1, most + 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _keeps(record, middle, noise_um, model) else (low, middle)
    return low


def _noise_and_fastest(record: Record) -> tuple[float, float]:
    """White noise (µm rms) and the highest frequency (Hz) of what moves beyond it."""
    from scipy.signal import welch

    y = record.y_um
    segment = max(min(y.size // 8, _SEGMENT), 16)
    frequency_hz, power = welch(y, 1.0 / record.ts_s, nperseg=segment)
    floor = float(np.median(power[power.size // 2 :]))
    noise_um = math.sqrt(floor * frequency_hz[-1])
    beyond = np.where(power > _ABOVE * floor, power - floor, 0.0) * frequency_hz[1]
    faster = np.cumsum(beyond[::-1])[::-1]
    least_um = max(_FASTER_NOISE * noise_um, _FASTER * float(np.std(y)))
    moves = np.flatnonzero(faster >= least_um**2)
    return noise_um, float(frequency_hz[max(int(moves[-1]) if moves.size else 0, 1)])


def _keeps(record: Record, step: int, noise_um: float, model: Variant[Core]) -> bool:
    """True if interpolating the kept samples changes the model output by less than the tolerance.

    The rate that widens thresholds is that over a sampling time: a longer one is another rate.
    """
    u = record.u_V
    at = np.arange(u.size)
    apart = u - np.interp(at, at[::step], u[::step])
    apart = apart[: at[::step][-1] + 1]
    if float(np.max(np.abs(apart))) > _ANYWHERE * float(np.ptp(u)):
        return False
    stroke_um = float(np.std(record.y_um))
    least_um = max(_BETWEEN_NOISE * noise_um, _BETWEEN * stroke_um)
    if _rms(apart) * stroke_um / float(np.std(u)) > least_um:
        return False
    part = close_up([record])[0]
    every = simulate_effects([model], part)[::step, 0]
    return float(np.std(simulate_effects([model], _every(part, step))[:, 0] - every)) <= least_um


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _stretch(record: Record, samples: int) -> slice:
    """Return the stretch in which command and speed vary most, of those whose memory is known."""
    u = record.u_V
    speed = np.gradient(u)
    fast = float(np.quantile(np.abs(speed), 0.99)) or float(np.max(np.abs(speed)))
    low, swing = float(u.min()), float(np.ptp(u))
    across = np.minimum((u - low) / swing * _BINS, _BINS - 1).astype(np.int64)
    up = np.clip((speed / fast + 1.0) * 0.5 * _BINS, 0, _BINS - 1).astype(np.int64)
    cells = across * _BINS + up

    def variety(start: int) -> int:
        return int(np.unique(cells[start : start + samples]).size)

    starts = [
        start
        for start in range(samples // 2, u.size - samples + 1, samples // 2)
        if _knows(u, start, samples)
    ]
    best = max(starts, key=variety, default=0)
    first = 0 if variety(best) <= _RICHER * variety(0) else best
    return slice(first, first + samples)


def _knows(u: Array, start: int, samples: int) -> bool:
    """Whether the history that a stretch is given holds nearly all that the command did before."""
    history = u[start - samples // 2 : start]
    return float(np.ptp(history)) >= _HISTORY * float(np.ptp(u[: start + samples]))


def _sentence(ways: Mapping[tuple[int, int], list[str]], dataset: Dataset, total: int) -> str:
    parts = []
    for (step, size), names in ways.items():
        if size:
            kind = f"read/stretch/{'each' if len(names) > 1 else 'one'}/{'fewer' if step > 1 else 'all'}"
        else:
            kind = "read/step"
        parts.append(template(kind, size=size, step=step, records=joined_records(names)))
    fitted = [r for r in dataset.train if r.error_mask.any()]
    kept = sum(map(len, kept_samples(fitted, None)))
    step = max(1, round(sum(int(r.error_mask.sum()) for r in fitted) / kept))
    read = " and ".join(parts)
    return template(
        "fewer" if step > 1 else "fewer, all squares", read=read, total=total, step=step
    )
