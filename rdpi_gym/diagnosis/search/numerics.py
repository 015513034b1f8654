"""How far a simulation of these records can be trusted: half the step, another command between."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.identification.jacobian import Variant, simulate_between, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

# The error of a linear interpolation falls with the square of the step: half of it shows three
# quarters.
_WHOLE = 4.0 / 3.0
# Steps within a sample that show another command between the samples.
_PARTS = 4
# Of the noise, what the numerical floor has to fall to for it not to matter.
_NO_MATTER = 0.3


@dataclass(frozen=True)
class NumericalFloor:
    """What the simulation of records leaves open.

    Parameters
    ----------
    step_um
        What half the step changes, carried on to a step of zero (µm rms).
    held_um
        What a command held about each sample, in place of one linear between them, changes (µm
        rms). One that is held from a sample to the next is the same with half a sampling time of
        delay, which a delay and the lags take up.
    fastest_hz
        Sampling rate (Hz) of the record in which that is largest.
    turned_um
        What a command that turns between two samples, where the straight lines before and after
        them meet, changes (µm rms): memory and gaps keep an extremum that no sample shows.
    """

    step_um: float
    held_um: float
    fastest_hz: float
    turned_um: float = 0.0

    @property
    def total_um(self) -> float:
        """All together (µm rms)."""
        return math.hypot(self.step_um, self.held_um, self.turned_um)

    def needed_hz(self, noise_um: float) -> float:
        """Return the sampling rate (Hz) at which the floor no longer matters beside the noise.

        Parameters
        ----------
        noise_um
            Noise floor (µm rms).

        Examples
        --------
        >>> NumericalFloor(0.03, 0.0, 1000.0).needed_hz(0.1), NumericalFloor(1.2, 0, 1e3).needed_hz(1)
        (1000.0, 2000.0)
        """
        least = _NO_MATTER * max(noise_um, 1e-300)
        return self.fastest_hz * math.sqrt(max(self.total_um / least, 1.0))


def numerical_floor(variant: Variant, records: Sequence[Record]) -> NumericalFloor:
    """Simulate a model again with half the step, and with the command held between samples.

    Parameters
    ----------
    variant
        The model.
    records
        Records whose errors are judged.
    """
    if not variant.effects:
        return NumericalFloor(0.0, 0.0, max(1.0 / r.ts_s for r in records))
    squares, counts = [], []
    for record in records:
        changes = (
            simulate_between(variant, record, 2) - simulate_effects([variant], record)[:, 0],
            *_changed(variant, record, held_about, turned_between),
        )
        squares.append([float(np.var(change[record.error_mask])) for change in changes])
        counts.append(int(record.error_mask.sum()))
    worst = int(np.argmax(np.sum(squares, axis=1)))
    step, held, turns = np.sqrt(np.average(squares, axis=0, weights=counts)).tolist()
    return NumericalFloor(_WHOLE * step, held, 1.0 / records[worst].ts_s, turns)


def _changed(
    variant: Variant, record: Record, *between: Callable[[Array, int], Array]
) -> list[Array]:
    """What other commands between the samples change at the samples (µm)."""
    effects = tuple(effect.sampled_at(record.ts_s) for effect in variant.effects)
    # jumps have no rate: only what does not hang on it is asked for
    slow = Variant(replace(variant.hysteresis, delta2_s=0.0), effects)
    linear = simulate_effects([slow], record)[:, 0]
    fine = replace(
        record,
        t_s=record.t_s[0] + np.arange(len(record.u_V) * _PARTS) * record.ts_s / _PARTS,
        u_V=np.repeat(record.u_V, _PARTS),
        y_um=np.repeat(record.y_um, _PARTS),
        ts_s=record.ts_s / _PARTS,
        reference_um=None,
        temperature_C=None,
        others={},
        period=None,
        error_mask=np.repeat(record.error_mask, _PARTS),
    )
    commands = [replace(fine, u_V=way(record.u_V, _PARTS)) for way in between]
    return [simulate_effects([slow], each)[::_PARTS, 0] - linear for each in commands]


def _along(u_V: Array, share: Array) -> Array:
    """Commands after each sample, ``(N, P)``, at shares of the way to the next; level at the end."""
    after = np.append(u_V[1:], u_V[-1])
    return np.asarray(u_V[:, None] + (after - u_V)[:, None] * share)


def held_about(u_V: Array, parts: int) -> Array:
    """Hold a command about each sample: it jumps in the middle between two.

    Parameters
    ----------
    u_V : float64[N]
        Command at the samples (V).
    parts
        Steps from sample to sample; even.

    Returns
    -------
    float64[N parts]
        The command; level after the last sample.

    Examples
    --------
    >>> held_about(np.array([1.0, 2.0]), 4).tolist()
    [1.0, 1.0, 1.5, 2.0, 2.0, 2.0, 2.0, 2.0]
    """
    step = np.sign(2 * np.arange(parts) - parts)  # before, in and after the middle
    return _along(u_V, 0.5 * (1.0 + step)).ravel()


def turned_between(u_V: Array, parts: int) -> Array:
    """Let a command turn between two samples, where the lines before and after them meet.

    Parameters
    ----------
    u_V : float64[N]
        Command at the samples (V).
    parts
        Steps from sample to sample.

    Returns
    -------
    float64[N parts]
        The command; level after the last sample.

    Examples
    --------
    >>> turned_between(np.array([0.0, 2.0, 4.0, 4.0, 2.0, 0.0]), 2).tolist()
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0, 0.0]
    """
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
