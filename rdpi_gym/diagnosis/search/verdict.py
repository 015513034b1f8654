"""The verdict on a model beside the noise and what a simulation of the records leaves open."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rdpi_gym.diagnosis.notices import Code, Notice
from rdpi_gym.diagnosis.results import Verdict
from rdpi_gym.diagnosis.search.setting import Setting
from rdpi_gym.identification.jacobian import Variant, simulate_between, simulate_effects
from rdpi_gym.identification.joint import NO_FIT, fit_joint
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array

# The error of a linear interpolation falls with the square of the step: half of it shows three
# quarters.
_WHOLE = 4.0 / 3.0
# Steps within a sample that show another command between the samples.
_PARTS_WITHIN = 4
# Steps in a sampling time by one of which stamps are off where another clock is tried, and the seed.
_SHAKEN, _SEED = 8, 0
# Of the noise, what the numerical floor has to fall to for it not to matter.
_NO_MATTER = 0.3
# Of another way to simulate, the part that the error has to show for all of it to be believed: an
# error that shows less is nearer to the model as it is, and a refit takes up some of what it shows.
_BORNE_OUT = 0.4
# Of the steps of a command from sample to sample (rms), what they change by from one to the next
# where it jumps: what it does between the samples is then unknown, whatever the error shows.
_JUMPS = 0.4


@dataclass(frozen=True)
class NumericalFloor:
    """Numerical floor: what the simulation of records leaves open."""

    step_um: float  # what half the step changes, carried on to a step of zero (µm rms)
    # What a command held about each sample, in place of one linear between them, changes (µm rms).
    # One that is held from a sample to the next is the same with half a sampling time of delay,
    # which a delay and the lags take up
    held_um: float
    fastest_hz: float  # sampling rate (Hz) of the record in which that is largest
    # What a command that turns between two samples, where the straight lines before and after them
    # meet, changes (µm rms): memory and gaps keep an extremum that no sample shows
    turned_um: float = 0.0
    # What samples taken at other times than those of an even clock change (µm rms), where the
    # stamps of a file are off one: what hangs on rates and times is then wrong, what only follows
    # the command is not
    jittered_um: float = 0.0
    # By how much the stamps are off, in the record in which that is largest (s rms)
    off_s: float = 0.0
    # Of step, held and turned together, what the error of the records bears out, and all of it in
    # records whose command jumps (µm rms)
    shown_um: float = 0.0

    @property
    def borne_um(self) -> float:
        """Part that the error and the command bear out, with that of the sampling times (µm rms)."""
        return math.hypot(self.shown_um, self.jittered_um)

    @property
    def total_um(self) -> float:
        """All together (µm rms)."""
        return math.hypot(self.sampled_um, self.jittered_um)

    @property
    def sampled_um(self) -> float:
        """The part that falls with the sampling time (µm rms)."""
        return math.hypot(self.step_um, self.held_um, self.turned_um)

    def needed_hz(self, noise_um: float) -> float:
        """Return the sampling rate (Hz) at which the floor no longer matters beside the noise."""
        least = _NO_MATTER * max(noise_um, 1e-300)
        return self.fastest_hz * math.sqrt(max(self.sampled_um / least, 1.0))


def numerical_floor(variant: Variant[Core], records: Sequence[Record]) -> NumericalFloor:
    """Simulate a model again: half the step, another command between samples, another clock."""
    jittered_um, off_s = _jitter(variant, records)
    if not variant.effects:
        fastest_hz = max(1.0 / r.ts_s for r in records)
        return NumericalFloor(0.0, 0.0, fastest_hz, jittered_um=jittered_um, off_s=off_s)
    found = [_Between.of(variant, record) for record in records]
    squares, pulls = np.array([f.squares for f in found]), np.array([f.pulls for f in found])
    counts = [f.changes.shape[1] for f in found]
    worst = int(np.argmax(np.sum(squares, axis=1)))
    step, held, turns = np.sqrt(np.average(squares, axis=0, weights=counts)).tolist()
    fastest_hz = 1.0 / records[worst].ts_s
    weights = np.array(counts) / sum(counts)
    jumps = np.array([_jumps(record.u_V) for record in records])
    shown_um2 = weights[jumps] @ squares[jumps]
    shown_um2 += _borne_out(weights[~jumps] @ pulls[~jumps], weights[~jumps] @ squares[~jumps])
    shown_um = math.sqrt(float(shown_um2 @ [_WHOLE**2, 1.0, 1.0]))
    return NumericalFloor(_WHOLE * step, held, fastest_hz, turns, jittered_um, off_s, shown_um)


def open_squares(variant: Variant[Core], record: Record) -> Array:
    """Return what the simulation of a record leaves open at each of its samples (µm²).

    Its mean over the samples that count is the square of :attr:`NumericalFloor.borne_um`: where a
    command jumps it is large, and next to nothing elsewhere.
    """
    found = np.zeros(record.u_V.size)
    if record.jitter_s > 0.0:
        found += _shaken(variant, record) ** 2
    if variant.effects and record.error_mask.any():
        own = _Between.of(variant, record)
        jumps = _jumps(record.u_V)
        borne = own.squares if jumps else _borne_out(own.pulls, own.squares)
        weights = borne / np.maximum(own.squares, 1e-300) * [_WHOLE**2, 1.0, 1.0]
        found[record.error_mask] += weights @ own.changes**2
    return found


@dataclass(frozen=True)
class _Between:
    """Changes by half the step and by other commands between the samples of a record, about their means."""

    changes: Array  # (3, N), µm
    squares: Array  # Mean squares (µm²)
    pulls: Array  # Mean products with the error (µm²)

    @classmethod
    def of(cls, variant: Variant[Core], record: Record) -> _Between:
        """Simulate the changes at the samples that count."""
        mask, simulated = record.error_mask, simulate_effects([variant], record)[:, 0]
        changed = [
            simulate_between(variant, record, 2) - simulated,
            *_changed(variant, record, held_about, turned_between),
        ]
        changes = np.array([change[mask] for change in changed])
        changes -= changes.mean(axis=1, keepdims=True)
        error = (record.y_um - simulated)[mask]
        pulls = changes @ (error - error.mean()) / max(error.size, 1)
        return cls(changes, (changes**2).mean(axis=1), pulls)


def _jumps(u_V: Array) -> bool:
    """Whether a command changes its steps so much that lines between its samples are a guess."""
    steps = np.diff(u_V)
    return bool(np.mean(np.diff(steps) ** 2) > _JUMPS**2 * np.mean(steps**2))


def _borne_out(pulls_um2: Array, squares_um2: Array) -> Array:
    """Squares of changes (µm²) that the errors bear out."""
    shares = np.maximum(pulls_um2, 0.0) / np.maximum(squares_um2, 1e-300)
    shares = np.where(shares < _BORNE_OUT, shares, 1.0)
    return np.asarray(shares**2 * squares_um2)


def _jitter(variant: Variant[Core], records: Sequence[Record]) -> tuple[float, float]:
    """Change by uneven sampling times (µm rms over all records), and the largest of them (s)."""
    squares = [
        float(np.var(_shaken(variant, r)[r.error_mask])) if r.jitter_s > 0.0 else 0.0
        for r in records
    ]
    counts = [int(r.error_mask.sum()) for r in records]
    return math.sqrt(np.average(squares, weights=counts)), max(r.jitter_s for r in records)


def _shaken(variant: Variant[Core], record: Record) -> Array:
    """Change of the simulation (µm) if the samples are taken at times that are off by those of the stamps.

    Command and displacement are taken at one time: each sample is moved to and fro by one of a few
    steps with the command linear between, and what that changes is carried on in proportion.
    """
    early, whole = record.before_V.size, record.with_history
    own = replace(variant, effects=tuple(e.sampled_at(record.ts_s) for e in variant.effects))
    even = _SHAKEN * np.arange(whole.u_V.size)
    taken = even + np.random.default_rng(_SEED).choice([-1, 1], even.size)
    taken[0], taken[-1] = even[0], even[-1]
    places = np.arange(even[-1] + 1)
    found = []
    for at in (even, taken):
        u = np.interp(places, at, whole.u_V)
        t_s = whole.t_s[0] + places * (record.ts_s / _SHAKEN)
        fine = Record(record.name, t_s, u, np.zeros_like(u), ts_s=record.ts_s / _SHAKEN)
        found.append(simulate_effects([own], fine)[at, 0])
    return np.asarray((found[1] - found[0])[early:] * (record.jitter_s * _SHAKEN / record.ts_s))


def _changed(
    variant: Variant[Core], record: Record, *between: Callable[[Array, int], Array]
) -> list[Array]:
    """Change at the samples (µm) by other commands between them."""
    effects = tuple(effect.sampled_at(record.ts_s) for effect in variant.effects)
    # jumps have no rate: only what does not hang on it is asked for
    slow = Variant(variant.hysteresis.static(), effects)
    early, whole = record.before_V.size, record.with_history
    linear = simulate_effects([slow], whole)[:, 0]
    commands = [way(whole.u_V, _PARTS_WITHIN) for way in between]
    ts_s = record.ts_s / _PARTS_WITHIN
    t_s = whole.t_s[0] + np.arange(len(commands[0])) * ts_s
    fine = [Record(record.name, t_s, u, np.zeros_like(u), ts_s=ts_s) for u in commands]
    return [(simulate_effects([slow], each)[::_PARTS_WITHIN, 0] - linear)[early:] for each in fine]


def _along(u_V: Array, share: Array) -> Array:
    """Commands after each sample, ``(N, P)``, at shares of the way to the next; level at the end."""
    after = np.append(u_V[1:], u_V[-1])
    return np.asarray(u_V[:, None] + (after - u_V)[:, None] * share)


def held_about(u_V: Array, parts: int) -> Array:
    """Hold a command about each sample: it jumps in the middle between two."""
    step = np.sign(2 * np.arange(parts) - parts)  # before, in and after the middle
    return _along(u_V, 0.5 * (1.0 + step)).ravel()


def turned_between(u_V: Array, parts: int) -> Array:
    """Let a command turn between two samples, where the lines before and after them meet."""
    part = np.arange(parts) / parts
    fine = _along(u_V, part)
    if len(u_V) > 3:
        into = (u_V[1:-2] - u_V[:-3])[:, None]
        out = (u_V[3:] - u_V[2:-1])[:, None]
        on, back = u_V[1:-2, None] + into * part, u_V[2:-1, None] - out * (1.0 - part)
        inner = fine[1:-2]
        turns = into * out < 0.0
        beyond = np.where(into > 0.0, np.minimum(on, back), np.maximum(on, back))
        further = np.where(into > 0.0, beyond > inner, beyond < inner)
        fine[1:-2] = np.where(turns & further, beyond, inner)
    return fine.ravel()


# At most this many times the noise floor is explained.
EXPLAINED = 1.15
# Of what exceeds the noise, the numerical floor's share from which on it is all that is said.
_DOMINATES = 0.5
# Noise floors from which on the numerical one matters; and up to which a model that is within both
# is explained although its error does not show which of them it is.
_MATTERS, _CLOSE = 0.5, 1.5
# Steps between two samples with which it is tried whether the sampling is what is left.
_PARTS = (2, 4, 8)
# Rounds in which the motion between samples and the parameters are found in turn; and of what is
# left, the share that this motion has to have for a try.
_CORRECTIONS, _LEAST_SHARE = 3, 0.1
# Of the sampling rate, the highest frequency, and in samples, the shortest time constant, of which
# records show more than that it is there.
_HIGHEST_SHARE, _FEWEST_SAMPLES = 0.1, 2.0

Rest = Literal["noise", "between", "uneven", "numerical"]
"""Kind of the residual, by its code in the texts."""

_FASTER = Notice(Code.FASTER)
_BETWEEN: Rest = "between"


@dataclass(frozen=True)
class Judgement:
    """A verdict with the reservation that it stands under."""

    verdict: Verdict  # as in the files
    # A reservation where records are sampled too slowly for the model, with the rate that would do,
    # or at times that are too uncertain
    sampling: Notice | None = None
    rest: Rest = "noise"  # what is then left
    again: Notice = _FASTER  # what is then to be measured


def judge(
    setting: Setting,
    variant: Variant[Core],
    rmse_um: float,
    noise_um: float,
    numerical: NumericalFloor,
    added: bool,
) -> Judgement:
    """Judge a model as it is saved.

    Notes
    -----
    A model that is right leaves more than the noise where records are sampled so slowly that the
    motion between the samples matters. That is tried: with steps between the samples, the command
    linear from one to the next, the same model has to reach the noise floor, as it is or with its
    parameters fitted once more to what such steps change. What half the step and a command held
    between the samples change is the numerical floor. What the error bears out of it is added to
    the noise: an error within both is explained too, and where it is most of the error nothing
    else is concluded. An alternative that the error speaks against (a command that is held, where
    one that is linear fits better) explains nothing, and is no reason to sample faster; unless
    the command jumps, and nobody knows what it does between two samples.
    """
    good: Verdict = "explained" if added else "no missing effect"
    if rmse_um <= EXPLAINED * noise_um:
        return Judgement(good)
    validation = setting.validation
    sampling = _between_samples(variant, noise_um, validation)
    if sampling is None and _misses(variant, validation) > _LEAST_SHARE * (
        rmse_um**2 - noise_um**2
    ):
        sampling = _between_samples(_corrected(setting, variant), noise_um, validation)
    if sampling is not None:
        return Judgement(good, sampling, _BETWEEN)
    matters = numerical.borne_um > _MATTERS * noise_um
    if matters and rmse_um <= EXPLAINED * math.hypot(noise_um, numerical.borne_um):
        return _by_floor(good, numerical, noise_um)
    if rmse_um <= min(EXPLAINED * math.hypot(noise_um, numerical.total_um), _CLOSE * noise_um):
        return Judgement(good, rest="numerical")
    if matters and numerical.borne_um**2 > _DOMINATES * (rmse_um**2 - noise_um**2):
        return _by_floor("unexplained", numerical, noise_um)
    if not added or numerical.total_um <= _MATTERS * noise_um:
        return Judgement("unexplained")
    return Judgement("unexplained", _beyond_sampling(variant, validation), _BETWEEN)


def _by_floor(verdict: Verdict, numerical: NumericalFloor, noise_um: float) -> Judgement:
    """Return a verdict that stands under the reservation of the larger part of the floor."""
    if numerical.jittered_um <= numerical.sampled_um:
        return Judgement(verdict, _faster(numerical, noise_um), _BETWEEN)
    uneven = Notice(Code.STAMPS_UNEVEN, numbers=(numerical.off_s, numerical.jittered_um))
    rest: Rest = "uneven"
    return Judgement(verdict, uneven, rest, Notice(Code.CLOCKED))


def _faster(numerical: NumericalFloor, noise_um: float) -> Notice:
    numbers = (numerical.needed_hz(noise_um), numerical.borne_um)
    return Notice(Code.STEP_TOO_LONG, numbers=numbers)


def _misses(variant: Variant[Core], records: Sequence[Record]) -> float:
    """Return what steps between the samples change in the displacement (µm², mean square)."""
    changes = [_change(variant, record)[record.error_mask] for record in records]
    return float(np.average([np.var(c) for c in changes], weights=[len(c) for c in changes]))


def _change(variant: Variant[Core], record: Record) -> Array:
    still = simulate_effects([variant], record)[:, 0]
    return simulate_between(variant, record, _PARTS[-1]) - still


def _corrected(setting: Setting, variant: Variant[Core]) -> Variant[Core]:
    """Return the model fitted to records from which the motion between samples is taken off."""
    for _ in range(_CORRECTIONS):
        train = [replace(r, y_um=r.y_um - _change(variant, r)) for r in setting.train]
        try:
            variant = fit_joint(train, variant.hysteresis, variant.effects).variant
        except NO_FIT:
            return variant
    return variant


def _between_samples(
    variant: Variant[Core], noise_um: float, validation: Sequence[Record]
) -> Notice | None:
    """Say how fast to sample where steps between the samples bring the error to the noise floor."""
    samples = [int(np.count_nonzero(r.error_mask)) for r in validation]
    before = [_mean_square(variant, r, 1) for r in validation]
    for parts in _PARTS:
        after = [_mean_square(variant, r, parts) for r in validation]
        left_um = math.sqrt(np.average(after, weights=samples))
        if left_um <= EXPLAINED * noise_um:
            gained = [n * (b - a) for n, b, a in zip(samples, before, after, strict=True)]
            record = validation[int(np.argmax(gained))]
            numbers = (parts / record.ts_s, 1.0 / record.ts_s, parts, left_um)
            return Notice(Code.MOTION_BETWEEN, (record.name,), numbers)
    return None


def _mean_square(variant: Variant[Core], record: Record, parts: int) -> float:
    error = (record.y_um - simulate_between(variant, record, parts))[record.error_mask]
    return float(np.var(error))


def _beyond_sampling(variant: Variant[Core], validation: Sequence[Record]) -> Notice | None:
    """Say how fast to sample for an effect that is faster than the records can show."""
    fastest_hz = max(1.0 / record.ts_s for record in validation)
    needed: list[tuple[float, Notice]] = []

    def need(rate_hz: float, name: str, unit: str, value: float) -> None:
        numbers = (rate_hz, value, fastest_hz)
        needed.append((rate_hz, Notice(Code.EFFECT_TOO_FAST, (name, unit), numbers)))

    for effect in variant.effects:
        for parameter in effect.parameters:
            value = effect.values[parameter.name]
            if parameter.unit == "Hz" and value > _HIGHEST_SHARE * fastest_hz:
                need(value / _HIGHEST_SHARE, effect.name, parameter.unit, value)
            if parameter.unit == "s" and 0.0 < value < _FEWEST_SAMPLES / fastest_hz:
                need(_FEWEST_SAMPLES / value, effect.name, parameter.unit, value)
    return max(needed, key=lambda each: each[0])[1] if needed else None
