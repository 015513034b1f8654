"""Tests of a data set without a model, each in one of three zones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, Zone
from rdpi_gym.diagnosis.checks.drift import holds, repeats
from rdpi_gym.diagnosis.checks.loops import (
    closed_loops,
    congruency,
    gain_over_amplitude,
    initial_memory,
    rate_law,
    saturation,
)
from rdpi_gym.diagnosis.checks.recording import (
    clipping,
    clocks,
    excitation,
    feedback,
    mains_hum,
    resolution,
)
from rdpi_gym.diagnosis.checks.steady_periods import half_wave, small_signal
from rdpi_gym.diagnosis.features.cycles import half_cycles, steady_periods
from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.diagnosis.features.recurrence import find_rests
from rdpi_gym.measurement import Dataset, Record, longest_counted

__all__ = ["Check", "Zone", "run_checks"]

_FEWEST = 16


def run_checks(dataset: Dataset) -> tuple[Check, ...]:
    """Run every test that needs no model, and every check of the data."""
    kept = [part for r in dataset.records if r.role != "test" and (part := _counted(r))]
    moving = [(r, half_cycles(r.u_V, r.ts_s)) for r in kept if not r.is_quiet]
    records = [record for record, _ in moving]
    span_V = max((float(np.ptp(r.u_V)) for r in records), default=0.0)
    stroke_um = max((float(np.ptp(r.y_um)) for r in records), default=0.0)
    noise_um = min((rough_part(r.y_um) for r in kept), default=0.0)
    rests = [rest for record in kept for rest in find_rests(record, span_V)]
    stretches = [p for record, cycles in moving if (p := steady_periods(record, cycles))]
    loops = [loop for record, cycles in moving for loop in closed_loops(record, cycles)]
    whole = {r.name for r in dataset.records if r.error_mask[:1].all()}
    found = (
        *excitation(moving, rests, stretches),
        clipping(records),
        resolution(kept),
        feedback(records),
        clocks(stretches),
        initial_memory([(r, c) for r, c in moving if r.name in whole]),
        half_wave(stretches),
        saturation(moving, span_V),
        gain_over_amplitude(loops),
        congruency(loops),
        rate_law(moving, span_V),
        *small_signal(stretches, span_V, stroke_um / span_V if span_V > 0.0 else 0.0),
        *holds(rests, stroke_um),
        *repeats(records, stretches),
        mains_hum(rests, records, noise_um, stroke_um),
    )
    return tuple(replace(check, quantities=dataset.quantities) for check in found)


def _counted(record: Record) -> Record | None:
    """Longest stretch of a record that counts."""
    kept = longest_counted(record)
    return kept if kept is not None and kept.t_s.size >= _FEWEST else None
