"""Model against measurement: the error in numbers, taken apart by what the command was doing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.checks import Check, run_checks
from rdpi_gym.diagnosis.comparison import breakdown, findings
from rdpi_gym.diagnosis.comparison.breakdown import Plane
from rdpi_gym.diagnosis.comparison.distortion import distortion_finding, distortion_table
from rdpi_gym.diagnosis.comparison.over_time import (
    clock_finding,
    clock_table,
    since_rest_finding,
    since_rest_table,
)
from rdpi_gym.diagnosis.comparison.spectrum import spectrum_finding, spectrum_table
from rdpi_gym.diagnosis.comparison.traces import Trace, fitted_extremum_V, trace
from rdpi_gym.diagnosis.features.noise import noise_floor
from rdpi_gym.diagnosis.hygiene import Finding, Inspected, inspect
from rdpi_gym.diagnosis.telling import told
from rdpi_gym.measurement import Dataset, Quantities, Record
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.errors import InputError

FORMAT, VERSION = "rdpi-compare", 1


@dataclass(frozen=True, eq=False)
class Comparison:
    """A model's error on a data set; residuals are measured minus model (µm).

    Parameters
    ----------
    title
        Of the data set.
    model
        The model compared.
    traces
        The records, sample by sample: training, validation, test.
    records, by_frequency, by_amplitude, by_direction, by_command
        Tables of the error; see :mod:`rdpi_gym.diagnosis.comparison.breakdown`.
    plane
        Mean residual over command and rate.
    spectrum, distortion, since_rest, clock
        Tables of the error by its own frequency, by harmonics, by time since the command came to
        rest or last rested, and by the experiment's clock; see the modules of these names and
        :mod:`rdpi_gym.diagnosis.comparison.over_time`.
    noise_floor_um, noise_origin
        What no model can explain (µm, rms), and where the figure comes from.
    checks
        What tests without a model say of the data.
    left_out
        What was not counted, one sentence each.
    findings
        What each table suggests, by the table's name; ``overall`` and, where there is cause,
        ``far`` and ``range``.
    quantities
        What was measured: sentences use its words and units.
    """

    title: str
    model: PlantModel
    traces: tuple[Trace, ...]
    records: pd.DataFrame
    by_frequency: pd.DataFrame
    by_amplitude: pd.DataFrame
    by_direction: pd.DataFrame
    by_command: pd.DataFrame
    plane: Plane
    spectrum: pd.DataFrame
    distortion: pd.DataFrame
    since_rest: pd.DataFrame
    clock: pd.DataFrame
    noise_floor_um: float
    noise_origin: str
    checks: tuple[Check, ...]
    left_out: tuple[str, ...]
    findings: dict[str, str]
    quantities: Quantities = field(default_factory=Quantities)

    def rmse_um(self, role: str | None = None) -> float | None:
        """RMS error (µm) over the records of a role, weighted by samples; None without such."""
        rows = self.records if role is None else self.records[self.records["role"] == role]
        return findings.rms_over(rows) if len(rows) else None

    @property
    def systematic_share(self) -> float:
        """Share of the squared error that is more than noise, over all records (0 to 1)."""
        return findings.systematic_share(self.records)

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers as a JSON object of format ``rdpi-compare``."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "units": self._units(),
            "model": {"name": self.model.name, "note": self.model.note},
            "data": {"title": self.title, "records": len({t.name for t in self.traces})},
            "train_rmse_um": self.rmse_um("train"),
            "validation_rmse_um": self.rmse_um("validation"),
            "test_rmse_um": self.rmse_um("test"),
            "noise_floor_um": self.noise_floor_um,
            "noise_origin": self.noise_origin,
            "systematic_share": self.systematic_share,
            "records": _rows(self.records),
            "by_frequency": _rows(self.by_frequency),
            "by_amplitude": _rows(self.by_amplitude),
            "by_direction": _rows(self.by_direction),
            "by_command": _rows(self.by_command),
            "by_command_and_rate": {
                "command_edges_V": self.plane.command_edges_V.tolist(),
                "rate_edges_V_s": self.plane.rate_edges_V_s.tolist(),
                "mean_um": _nested(self.plane.mean_um.tolist()),
                "samples": self.plane.samples.tolist(),
                "outside": self.plane.outside,
                "explained_percent": self.plane.explained_percent,
            },
            "spectrum": _rows(self.spectrum),
            "distortion": _rows(self.distortion),
            "since_rest": _rows(self.since_rest),
            "clock": _rows(self.clock),
            "checks": [check.to_dict() for check in self.checks],
            "left_out": list(self.left_out),
            "findings": list(self.findings.values()),
        }

    def _units(self) -> dict[str, str]:
        quantities = self.quantities
        if quantities.are_standard:
            return {
                "error": "um",
                "command": "V",
                "rate": "V/s",
                "frequency": "Hz",
            }
        rate = quantities.unit("V/s")
        return {**quantities.units, "rate": rate, "frequency": "Hz"}


def compare(dataset: Dataset, model: PlantModel) -> Comparison:
    """Compare a model with a measurement, one free offset a record.

    Every record is simulated whole, from its first sample, without memory of what came before
    unless the model's fit has found it; its error counts where its mask says so, and where it is
    a measurement: outliers, dropouts and clipped samples are left out. Records of constant voltage
    are too.

    Parameters
    ----------
    dataset
        The measurement.
    model
        The plant.

    Raises
    ------
    InputError
        No sample of any record counts.

    Examples
    --------
    >>> from rdpi_gym.measurement import Record
    >>> from rdpi_gym.plant import Plant, named_plant
    >>> t = np.arange(2000) * 1e-3
    >>> u = 10.0 * np.sin(2 * np.pi * 5.0 * t)
    >>> y = 1.1 * Plant(named_plant("P5"), 1e-3).simulate(u)
    >>> data = Dataset("a tenth too much gain", (Record("sine", t, u, y, ts_s=1e-3),))
    >>> result = compare(data, named_plant("P5"))
    >>> result.records["gain_ratio"].round(3).tolist()
    [1.1, 1.1]
    >>> result.by_frequency["frequency_hz"].round(2).tolist()
    [5.0]
    """
    (found,) = compare_each(dataset, [model])
    return found


def compare_each(dataset: Dataset, models: Sequence[PlantModel]) -> tuple[Comparison, ...]:
    """Return what :func:`compare` does of each of several models; the data are looked at once."""
    inspected = inspect(dataset)
    dataset = inspected.dataset
    records = [*dataset.train, *dataset.validation, *dataset.test]
    counting = [r for r in records if r.error_mask.any()]
    if not counting:
        raise InputError(
            f"{dataset.title}: no sample counts in any record; leave out less (skip_s, mask_s)"
        )
    checks = run_checks(dataset)
    return tuple(_compared(inspected, counting, checks, model) for model in models)


def _compared(
    inspected: Inspected, counting: Sequence[Record], checks: tuple[Check, ...], model: PlantModel
) -> Comparison:
    dataset = inspected.dataset
    traces = tuple(trace(record, model) for record in counting)
    unique = {record.name: record for record in counting}
    floor, origin = noise_floor(
        dataset.quiet, list(unique.values()), [each.residual_um[each.counted] for each in traces]
    )
    table = breakdown.record_table(traces, floor)
    samples = breakdown.sample_table(traces)
    frequency, amplitude = breakdown.by_frequency(samples), breakdown.by_amplitude(samples)
    directions, command = breakdown.by_direction(samples), breakdown.by_command(samples)
    plane = breakdown.plane(samples)
    spectrum, distortion = spectrum_table(traces, floor), distortion_table(traces)
    rests, clock = since_rest_table(traces), clock_table(traces)
    rmse_um = findings.rms_over(table)
    train, validation = (
        findings.rms_over(rows) if len(rows := table[table["role"] == role]) else None
        for role in ("train", "validation")
    )
    sentences = {
        "far": findings.far_away(table),
        "range": findings.out_of_range(samples, model.command_range_V, model.name),
        "overall": findings.errors(table, train, validation, origin),
        "records": findings.record_spread(table),
        "drift": findings.drift(traces, rmse_um),
        "clock": clock_finding(clock, rmse_um),
        "since_rest": since_rest_finding(rests, floor),
        "largest": findings.largest(traces),
        "gain": findings.gain(table),
        "by_frequency": findings.trend(frequency, "frequency_hz", "Hz", "frequency"),
        "by_amplitude": findings.trend(amplitude, "amplitude_V", "{input_unit}", "amplitude"),
        "by_direction": findings.direction(directions, command, rmse_um),
        "distortion": distortion_finding(distortion, floor),
        "spectrum": spectrum_finding(spectrum),
        "plane": findings.command_and_rate(plane),
    }
    found = Comparison(
        title=dataset.title,
        model=model,
        traces=traces,
        records=table,
        by_frequency=frequency,
        by_amplitude=amplitude,
        by_direction=directions,
        by_command=command,
        plane=plane,
        spectrum=spectrum,
        distortion=distortion,
        since_rest=rests,
        clock=clock,
        noise_floor_um=floor,
        noise_origin=origin,
        checks=checks,
        left_out=(
            *_left_out(dataset, samples, plane),
            *_of_hygiene(inspected.findings),
            *_remembered(counting, model),
        ),
        findings={key: text for key, text in sentences.items() if text is not None},
        quantities=dataset.quantities,
    )
    return told(found, dataset.quantities)


def _left_out(dataset: Dataset, samples: pd.DataFrame, plane: Plane) -> tuple[str, ...]:
    say = partial(dataset.quantities.said, keep=[record.name for record in dataset.records])
    lines = [f"{r.name}: {say(remark)}" for r in dataset.records for remark in r.remarks]
    lines += [f"{r.name}: constant {{input}}, no part of the comparison" for r in dataset.quiet]
    lines += map(say, dataset.remarks)
    without = int(samples["frequency_hz"].isna().sum())
    if without:
        lines.append(
            f"{without} of {len(samples)} samples lie before the first or after the last reversal "
            "of their record, or where the command mostly rests: they have no frequency and no "
            "amplitude, and count everywhere else"
        )
    if plane.outside:
        lines.append(
            f"{plane.outside} samples at the largest rates are off the plane of command and rate"
        )
    return tuple(lines)


def _of_hygiene(findings: Sequence[Finding]) -> list[str]:
    # an opening of unknown history counts all the same
    return [finding.sentence for finding in findings if finding.kind != "in motion"]


def _remembered(records: Sequence[Record], model: PlantModel) -> list[str]:
    extrema_V = {record.name: fitted_extremum_V(model, record.name) for record in records}
    return [
        f"{name}: simulated from the memory that the fit found, a turn at {extremum_V:.4g} {{input_unit}}"
        for name, extremum_V in extrema_V.items()
        if extremum_V is not None
    ]


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [
        {str(key): _nested(value) for key, value in row.items()}
        for row in table.to_dict(orient="records")
    ]


def _nested(value: Any) -> Any:
    """Replace NaN by null, and NumPy's numbers by Python's."""
    if isinstance(value, list):
        return [_nested(each) for each in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
