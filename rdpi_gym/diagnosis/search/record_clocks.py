"""Beginnings and clocks of single records, by a model: records that mislead the others."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rdpi_gym.diagnosis.features.cycles import BoolArray
from rdpi_gym.diagnosis.notices import Code, Notice, statement
from rdpi_gym.diagnosis.preprocessing import Finding, joined_records
from rdpi_gym.diagnosis.search.candidates import Outcome, Setting, refit
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import NO_FIT, fit_joint
from rdpi_gym.measurement import MIN_SAMPLES, Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import forms_of
from rdpi_gym.support.arrays import Array

# Of a record's mean square over the floor, what its own clock has to take; and the floors from
# which on its error is looked at.
_TAKEN, _VISIBLE = 0.8, 1.5
# Others that know: of two records, each says that the other is off.
_FEWEST = 2
# Of the same, what makes it worth a refit without the record; how many are tried for each of those
# that may be named, with which samples and passes.
_WORTH, _MOST, _NAMED, _SAMPLES, _REFITS = 0.2, 3, 2, 8_000, 6
# Standard errors, or spreads of the others, that it has to be away from the others.
_SURE = 6.0
# Blocks of a record whose pulls give the standard error: what is left is no white noise.
_BLOCKS = 20
# Steps of a scale that stand for its derivative, and scales that are tried before.
_STEP, _SCALES = 0.01, np.geomspace(0.4, 2.5, 11)
_PASSES = 6
# Least shift (samples) and least scale that a recorder makes; of the record, the largest shift.
_LEAST_SHIFT, _LEAST_SCALE, _LONGEST = 0.05, 0.01, 0.05
# So close to twice or half of a time step, and as good but for this, it is no delay.
_OCTAVE, _AS_GOOD = 0.05, 0.05
# Logarithm of a factor from which on two digits of it are enough to show that it is not one.
_PLAIN = 0.1
# Of the displacement (rms), what a scale has to move to be known at all.
_MOVES = 1e-6

Kind = Literal["delay", "scale"]


@dataclass(frozen=True)
class Wish:
    """Clock error that fits a record best."""

    # Delay of the displacement (s), or logarithm of the factor to its time step (1), with its
    # standard error
    value: float
    error: float
    mean_square: float  # what is left with it (µm²)


def record_clocks(
    variant: Variant[Core],
    train: Sequence[Record],
    validation: Sequence[Record],
    floor_um: float,
    smoothness: float = 0.0,
) -> tuple[Finding, ...]:
    """Look for records that lag the others, or whose time step is another than is written.

    Notes
    -----
    A shift or a stretch of its time is what a recorder does to one record. An effect that the model
    lacks moves all records that show it, or leaves more than a shift takes. A record that was
    fitted has bent the model: it is asked again by one that is refitted to the others.
    """
    whole = {r.name: r for r in (*train, *validation)}
    for r in train:
        whole[r.name] = replace(r, error_mask=r.error_mask | whole[r.name].error_mask)
    clocked = {name: _Clocked(variant, r) for name, r in whole.items()}
    found: dict[str, Finding] = {}
    for _ in range(_NAMED):
        gains = {n: _gain(c, floor_um) for n, c in clocked.items() if n not in found}
        suspects = [n for n in sorted(gains, key=lambda n: -gains[n])[:_MOST] if gains[n] > 0.0]
        told = []
        for name in suspects:
            left = [r for r in train if r.name not in found and r.name != name]
            here = clocked
            if left and name in {r.name for r in train}:
                try:
                    fit = fit_joint(
                        left, variant.hysteresis, variant.effects, _REFITS,
                        samples=_SAMPLES, smoothness=smoothness,
                    )  # fmt: skip
                except NO_FIT:  # nobody is left to ask about this record
                    continue
                here = {n: _Clocked(fit.variant, r) for n, r in whole.items()}
            others = [c for n, c in here.items() if n != name and n not in found]
            wishes = {
                kind: wish
                for kind in _KINDS
                if (wish := _own(here[name], others, kind, floor_um)) is not None
            }
            if wishes:
                rest = sum(c.left(c.still) * c.still.size for c in others)
                told.append((rest, name, wishes, here))
        if not told:
            break
        # the one without which the others agree best with one model
        _, name, wishes, clocked = min(told, key=lambda each: each[0])
        found[name] = _said(whole[name], wishes)
    return tuple(found.values())


def _gain(clocked: _Clocked, floor_um: float) -> float:
    """Squares (µm²) that a clock of its own takes of a record, or 0 where they are few."""
    now = clocked.left(clocked.still)
    if now <= (_VISIBLE * floor_um) ** 2:
        return 0.0
    gain = now - min(ask(clocked, True).mean_square for ask in _KINDS.values())
    return gain * clocked.still.size if gain > _WORTH * (now - floor_um**2) else 0.0


class _Clocked:
    """A record, and what the model makes of it with another clock."""

    def __init__(self, variant: Variant[Core], record: Record) -> None:
        self.record = record
        self._variant = variant
        self.still = self.scaled(0.0)

    def scaled(self, log_scale: float) -> Array:
        """Simulate the record with another time step (µm)."""
        ts_s = self.record.ts_s * math.exp(log_scale)
        here = replace(self.record, ts_s=ts_s, t_s=self._times(ts_s))
        return simulate_effects([self._variant], here)[:, 0]

    def delayed(self, delay_s: float) -> Array:
        """Delay what is simulated (µm)."""
        k = np.arange(self.still.size)
        return np.asarray(np.interp(k - delay_s / self.record.ts_s, k, self.still))

    def left(self, y_um: Array) -> float:
        """Mean square of what is left (µm²), the offset free."""
        return float(np.var((self.record.y_um - y_um)[self.record.error_mask]))

    def _times(self, ts_s: float) -> Array:
        return np.asarray(self.record.t_s[0] + ts_s * np.arange(self.record.t_s.size))

    def pulled(self, y_um: Array, along: Array) -> tuple[float, float]:
        """Projection of the residual on a derivative, with its standard error."""
        mask = self.record.error_mask
        left, rows = (self.record.y_um - y_um)[mask], along[mask]
        left, rows = left - left.mean(), rows - rows.mean()
        squares = float(rows @ rows)
        if squares <= (_MOVES * float(np.std(self.record.y_um))) ** 2 * rows.size:
            return 0.0, math.inf
        step = float(rows @ left) / squares
        parts = np.array_split(rows * (left - step * rows), _BLOCKS)
        return step, math.sqrt(sum(float(part.sum()) ** 2 for part in parts)) / squares


def _delay(clocked: _Clocked, from_afar: bool) -> Wish:
    """Refit the delay of a record, from none."""
    ts_s = clocked.record.ts_s

    def along(value: float, y_um: Array) -> Array:
        return np.asarray(-np.gradient(y_um, ts_s))

    most = _LONGEST * clocked.record.t_s.size * ts_s
    return _refitted(clocked, clocked.delayed, along, 0.0, most)


def _scale(clocked: _Clocked, from_afar: bool) -> Wish:
    """Refit the time step of a record, from what is written or from the best of some."""

    def along(value: float, y_um: Array) -> Array:
        return (clocked.scaled(value + _STEP) - y_um) / _STEP

    tried = [math.log(scale) for scale in _SCALES] if from_afar else [0.0]
    start = min(tried, key=lambda each: clocked.left(clocked.scaled(each)))
    return _refitted(clocked, clocked.scaled, along, start, 1.2 * math.log(_SCALES[-1]))


_KINDS: dict[Kind, Callable[[_Clocked, bool], Wish]] = {"scale": _scale, "delay": _delay}


def _refitted(
    clocked: _Clocked,
    simulated: Callable[[float], Array],
    along: Callable[[float, Array], Array],
    start: float,
    most: float,
) -> Wish:
    value, error, y_um = start, math.inf, simulated(start)
    left = clocked.left(y_um)
    for _ in range(_PASSES):
        step, error = clocked.pulled(y_um, along(value, y_um))
        tried = min(max(value + step, -most), most)
        y_tried = simulated(tried)
        if math.isinf(error) or clocked.left(y_tried) >= left:
            break
        value, y_um, left = tried, y_tried, clocked.left(y_tried)
    return Wish(value, error, left)


def _own(clocked: _Clocked, others: Sequence[_Clocked], kind: Kind, floor_um: float) -> Wish | None:
    """Return what a record wants where it takes most of its error and the others do not want it."""
    own = _KINDS[kind](clocked, True)
    excess = clocked.left(clocked.still) - floor_um**2
    least = _LEAST_SCALE if kind == "scale" else _LEAST_SHIFT * clocked.record.ts_s
    if abs(own.value) < least or clocked.left(clocked.still) - own.mean_square < _TAKEN * excess:
        return None
    told = [wish for other in others if math.isfinite((wish := _KINDS[kind](other, False)).error)]
    # only those that know it as well as this one differs say that they do not want it
    told = [w for w in told if w.error * _SURE < abs(own.value)]
    if len(told) < _FEWEST:
        return None
    values = np.array([w.value for w in told])
    middle = float(np.median(values))
    spread = float(np.max(np.abs(values - middle)))
    reach = _SURE * math.hypot(own.error, float(np.median([w.error for w in told])))
    if abs(own.value - middle) <= max(reach, 2.0 * spread, 0.5 * abs(own.value)):
        return None
    return replace(own, value=own.value - middle)


def _said(record: Record, wishes: dict[Kind, Wish]) -> Finding:
    """Say the likelier of what a record wants."""
    kind = min(wishes, key=lambda each: wishes[each].mean_square)
    scale = wishes.get("scale")
    if scale is not None and kind == "delay":
        is_octave = abs(abs(scale.value) - math.log(2.0)) < _OCTAVE
        if is_octave and scale.mean_square < (1.0 + _AS_GOOD) * wishes[kind].mean_square:
            kind = "scale"
    value, ts_s = wishes[kind].value, record.ts_s
    if kind == "scale":
        factor = math.exp(-value)
        text = statement(
            "clock/scale" if abs(value) > _PLAIN else "clock/slight scale", record=record.name,
            factor=factor, right=ts_s * math.exp(value), written=ts_s,
        )  # fmt: skip
        step = Notice(Code.SAMPLING_TIME, (record.name,))
    else:
        way = "clock/record lags" if value > 0.0 else "clock/record leads"
        shift = abs(value)
        text = statement(way, record=record.name, shift_ms=1e3 * shift, samples=shift / ts_s)
        step = Notice(Code.TRIGGER, (record.name,))
    return Finding("clock", record.name, record.t_s.size, text, step)


# An opening misleads where a piece of it has this many times the mean square of the rest and of the
# noise, and more than any piece of the rest: a memory may spoil only a part of a long opening.
_WORSE, _NOISE, _STANDS_OUT = 3.0, 9.0, 1.5
_PIECES, _LEAST_PIECE = 8, 8
# Of the squares in the openings, what a memory that is right leaves at most.
_LEAST_REMEMBERED = 0.2


def misleading(
    setting: Setting, outcome: Outcome, openings: Mapping[str, BoolArray], noise_um: float
) -> dict[str, BoolArray]:
    """Return the openings that a fit is better spared."""
    bad = missed(setting, outcome, openings, noise_um)
    if not bad:
        return {}
    assert outcome.fit is not None
    start = outcome.fit.variant
    others = tuple(effect for effect in start.effects if effect.name != "initial_memory")
    here = {type(effect) for effect in start.effects}
    bare = outcome if others == start.effects else refit(setting, start.hysteresis, others, None)
    if bare.fit is None:
        return bad
    most = _LEAST_REMEMBERED * _opened(setting, bare, bad)
    if _opened(setting, outcome, bad) < most:
        return {}
    for kind in forms_of(CATALOGUE["initial_memory"]):
        if kind in here:  # it misses them as it is
            continue
        remembered = refit(setting, start.hysteresis, others, kind)
        if remembered.fit is None:
            continue
        if _opened(setting, remembered, bad) < most or not missed(
            setting, remembered, bad, noise_um
        ):
            return {}
    return bad


def leaving_out(setting: Setting, openings: Mapping[str, BoolArray]) -> Setting:
    """Return the data with some samples simulated and not scored."""
    return replace(
        setting,
        train=tuple(_spared(r, openings) for r in setting.train),
        validation=tuple(_spared(r, openings) for r in setting.validation),
    )


def unknown_past(openings: Mapping[str, BoolArray]) -> Finding:
    """Say which openings were left out, and why."""
    samples = sum(int(mask.sum()) for mask in openings.values())
    whole = sum(mask.size for mask in openings.values())
    names = list(openings)
    text = statement("unknown past", samples=samples, whole=whole, records=joined_records(names))
    name = names[0] if len(names) == 1 else ""
    return Finding("in motion", name, samples, text, Notice(Code.BEGIN_AFTER_CYCLE))


def outliers_left(name: str, mask: BoolArray) -> Finding:
    """Say how many samples of a record stand out from what a model leaves."""
    number = int(mask.sum())
    text = statement("more outliers", samples=number, record=name)
    return Finding("spikes", name, number, text, Notice(Code.CONTACTS))


def _spared(record: Record, openings: Mapping[str, BoolArray]) -> Record:
    if record.name not in openings:
        return record
    mask = record.error_mask & ~openings[record.name]
    return record if mask.sum() < MIN_SAMPLES else replace(record, error_mask=mask)


def missed(
    setting: Setting, outcome: Outcome, openings: Mapping[str, BoolArray], noise_um: float
) -> dict[str, BoolArray]:
    """Return the openings of which a model misses a piece by far more than the rest and the noise."""
    assert outcome.fit is not None
    found = {}
    for record in (*setting.train, *setting.validation):
        start = openings.get(record.name)
        if start is None or record.name in found:
            continue
        inside, rest = record.error_mask & start, record.error_mask & ~start
        if inside.sum() < 3 or rest.sum() < MIN_SAMPLES:
            continue
        error = record.y_um - simulate_effects([outcome.fit.variant], record)[:, 0]
        error -= error[rest].mean()
        opened, others = error[inside] ** 2, error[rest] ** 2
        size = max(_LEAST_PIECE, opened.size // _PIECES)
        usual = max(_WORSE * float(others.mean()), _STANDS_OUT * _worst(others, size))
        if _worst(opened, size) > max(usual, _NOISE * noise_um**2):
            found[record.name] = start
    return found


def _opened(setting: Setting, outcome: Outcome, openings: Mapping[str, BoolArray]) -> float:
    """Return the sum of a model's squares (µm²) in openings."""
    assert outcome.fit is not None
    total = 0.0
    for record in (*setting.train, *setting.validation):
        start = openings.get(record.name)
        if start is not None:
            error = record.y_um - simulate_effects([outcome.fit.variant], record)[:, 0]
            error -= error[record.error_mask & ~start].mean()
            total += float(np.sum(error[record.error_mask & start] ** 2))
    return total


def _worst(squares: Array, size: int) -> float:
    """Return the largest mean of pieces that have about `size` samples each."""
    pieces = np.array_split(squares, max(squares.size // size, 1))
    return max(float(piece.mean()) for piece in pieces)
