"""How far a simulation of these records can be trusted: half the step, another command between."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.identification.jacobian import Variant, simulate_between, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

# The error of a linear interpolation falls with the square of the step: half of it shows three
# quarters.
_WHOLE = 4.0 / 3.0
# Steps within a sample that show a command held between the samples.
_HELD_PARTS = 4
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
        What a command held between samples, in place of one linear between them, changes beyond a
        shift in time (µm rms): a delay and the lags take up a shift.
    fastest_hz
        Sampling rate (Hz) of the record in which that is largest.
    """

    step_um: float
    held_um: float
    fastest_hz: float

    @property
    def total_um(self) -> float:
        """Both together (µm rms)."""
        return math.hypot(self.step_um, self.held_um)

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
    steps, held, counts = [], [], []
    for record in records:
        still = simulate_effects([variant], record)[:, 0]
        counted = record.error_mask
        halved = simulate_between(variant, record, 2) - still
        steps.append(float(np.var(halved[counted])))
        other = _held(variant, record) - still
        held.append(float(np.var(_unshifted(other, still)[counted])))
        counts.append(int(counted.sum()))
    worst = int(np.argmax(np.add(steps, held)))
    return NumericalFloor(
        _WHOLE * math.sqrt(float(np.average(steps, weights=counts))),
        math.sqrt(float(np.average(held, weights=counts))),
        1.0 / records[worst].ts_s,
    )


def _held(variant: Variant, record: Record) -> Array:
    """Simulate with each command held until the next, at the samples."""
    effects = tuple(effect.sampled_at(record.ts_s) for effect in variant.effects)
    variant = replace(variant, effects=effects)
    fine = replace(
        record,
        t_s=record.t_s[0] + np.arange(len(record.u_V) * _HELD_PARTS) * record.ts_s / _HELD_PARTS,
        u_V=np.repeat(record.u_V, _HELD_PARTS),
        y_um=np.repeat(record.y_um, _HELD_PARTS),
        ts_s=record.ts_s / _HELD_PARTS,
        reference_um=None,
        temperature_C=None,
        others={},
        period=None,
        error_mask=np.repeat(record.error_mask, _HELD_PARTS),
    )
    slow = replace(variant.hysteresis, delta2_s=0.0)
    # jumps have no rate: only what stands behind the plays is asked for
    y_held = simulate_effects([replace(variant, hysteresis=slow)], fine)[::_HELD_PARTS, 0]
    y_linear = simulate_effects([replace(variant, hysteresis=slow)], record)[:, 0]
    with_rate = simulate_effects([variant], record)[:, 0]
    return np.asarray(with_rate + y_held - y_linear)


def _unshifted(change: Array, y: Array) -> Array:
    """What is left of a change beside a shift in time and an offset."""
    columns = np.column_stack([np.ones_like(y), np.gradient(y), np.gradient(np.gradient(y))])
    weights, *_ = np.linalg.lstsq(columns, change, rcond=None)
    return np.asarray(change - columns @ weights)
