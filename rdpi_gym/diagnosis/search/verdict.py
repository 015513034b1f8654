"""The verdict on a model, one for every search: explained, nothing missing, or something left."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.diagnosis.notices import Code, Notice
from rdpi_gym.diagnosis.results import Verdict
from rdpi_gym.diagnosis.search.candidates import Setting
from rdpi_gym.diagnosis.search.numerics import NumericalFloor
from rdpi_gym.identification.jacobian import Variant, simulate_between, simulate_effects
from rdpi_gym.identification.joint import NO_FIT, fit_joint
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array

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

_FASTER = Notice(Code.FASTER)
_BETWEEN = "motion between the samples"


@dataclass(frozen=True)
class Judgement:
    """A verdict with the reservation that it stands under.

    Parameters
    ----------
    verdict
        As in the files.
    sampling
        A reservation where records are sampled too slowly for the model, with the rate that would
        do, or at times that are too uncertain.
    rest
        What is then left.
    again
        What is then to be measured.
    """

    verdict: Verdict
    sampling: Notice | None = None
    rest: str = "the noise"
    again: Notice = _FASTER


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
        return Judgement(good, rest="the noise, and what a simulation of these records leaves open")
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
    rest = "what uneven sampling times change"
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
