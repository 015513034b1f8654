"""One record beside what a model makes of it, sample by sample."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis.features.cycles import HalfCycles, half_cycles
from rdpi_gym.identification.residuals import simulate_record
from rdpi_gym.measurement import Record
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array


@dataclass(frozen=True, eq=False)
class Trace:
    """A record of N samples and the model's displacement for it.

    Parameters
    ----------
    name, role
        Of the record.
    t_s, u_V, rate_V_s
        Time (s), command (V) and its rate (V/s), each ``(N,)``.
    measured_um, model_um
        Displacement (µm), ``(N,)``; the model's with the record's free offset.
    counted
        ``bool[N]``; False where a sample is left out of the error.
    cycles
        The command cut at its reversals.
    offset_um
        The free offset (µm): mean of measured minus simulated over the samples that count.
    ts_s
        Sampling time (s).
    """

    name: str
    role: str
    t_s: Array
    u_V: Array
    rate_V_s: Array
    measured_um: Array
    model_um: Array
    counted: NDArray[np.bool_]
    cycles: HalfCycles
    offset_um: float
    ts_s: float

    @property
    def residual_um(self) -> Array:
        """Measured minus model (µm), ``(N,)``, also where no sample counts."""
        return self.measured_um - self.model_um


def trace(record: Record, model: PlantModel) -> Trace:
    """Simulate a record from its first sample and free its offset.

    A record of which the fit has found the initial memory begins with it.
    """
    extremum_V = fitted_extremum_V(model, record.name)
    left = (
        simulate_record(model, record)
        if extremum_V is None
        else simulate_record(model, record, extremum_V)
    )
    cycles = half_cycles(record.u_V, record.ts_s)
    return Trace(
        name=record.name,
        role=record.role,
        t_s=record.t_s,
        u_V=record.u_V,
        rate_V_s=smooth_rate(record.u_V, record.ts_s, cycles),
        measured_um=record.y_um,
        model_um=left.simulated_um + left.offset_um,
        counted=record.error_mask,
        cycles=cycles,
        offset_um=left.offset_um,
        ts_s=record.ts_s,
    )


def fitted_extremum_V(model: PlantModel, name: str) -> float | None:
    """Give the command (V) at which the plant had turned before a record, where a fit found it."""
    known = model.identification.get("memory_extrema_V")
    value = known.get(name) if isinstance(known, Mapping) else None
    if not isinstance(value, int | float) or not math.isfinite(value) or value == 0.0:
        return None
    return float(value)


def smooth_rate(u_V: Array, ts_s: float, cycles: HalfCycles) -> Array:
    """Rate of a measured command (V/s), ``(N,)``, that its noise does not drown.

    Central differences over a twentieth of a short half-cycle (the tenth percentile of all),
    which is 0.4 % low at the crest of a sine's rate.
    """
    lengths = np.diff(cycles.edges)
    whole = lengths[cycles.whole] if cycles.whole.any() else lengths
    reach = max(1, round(float(np.percentile(whole, 10)) / 40.0))
    sample = np.arange(u_V.size)
    after = np.minimum(sample + reach, u_V.size - 1)
    before = np.maximum(sample - reach, 0)
    rate: Array = (u_V[after] - u_V[before]) / ((after - before) * ts_s)
    return rate
