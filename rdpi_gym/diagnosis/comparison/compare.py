"""Models against a measurement: the error in numbers, taken apart by what the command was doing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.checks import Check, run_checks
from rdpi_gym.diagnosis.comparison import breakdown, findings
from rdpi_gym.diagnosis.comparison.breakdown import Plane
from rdpi_gym.diagnosis.comparison.findings import FEW_HALF_CYCLES
from rdpi_gym.diagnosis.comparison.over_time import (
    clock_finding,
    clock_table,
    since_rest_finding,
    since_rest_table,
)
from rdpi_gym.diagnosis.comparison.spectrum import (
    distortion_finding,
    distortion_table,
    spectrum_finding,
    spectrum_table,
)
from rdpi_gym.diagnosis.comparison.traces import Trace, fitted_extremum_V, trace
from rdpi_gym.diagnosis.features.noise import noise_floor
from rdpi_gym.diagnosis.preprocessing.finding import Finding
from rdpi_gym.diagnosis.preprocessing.inspection import Inspected, inspect
from rdpi_gym.diagnosis.telling import told
from rdpi_gym.measurement import Dataset, Quantities, Record, stated_quantities
from rdpi_gym.measurement.quantities import in_output
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import joined

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


MOST_MODELS = 6
"""Models that a page shows together: more colours are not told apart."""
_AS_GOOD = 0.03  # of the least error, what another may have more and be named beside it
_ROLES = ("train", "validation", "test")
_POOLED = {"train": "all training", "validation": "all validation", "test": "all test"}


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """Errors of several models on one data set.

    Parameters
    ----------
    names
        Of the models, each its own.
    comparisons
        Of each model.
    findings
        Which model is nearer: ``overall``, ``records``, ``by_frequency``, ``by_amplitude``.
    quantities
        What was measured: sentences use its words and units.
    """

    names: tuple[str, ...]
    comparisons: tuple[Comparison, ...]
    findings: dict[str, str]
    quantities: Quantities = field(default_factory=Quantities)

    @property
    def title(self) -> str:
        """Of the data set."""
        return self.comparisons[0].title

    @property
    def noise_floor_um(self) -> float:
        """What no model can explain (µm, rms): the least of what each comparison found."""
        return min(each.noise_floor_um for each in self.comparisons)

    @property
    def noise_origin(self) -> str:
        """Where :attr:`noise_floor_um` comes from."""
        return min(self.comparisons, key=lambda each: each.noise_floor_um).noise_origin

    @property
    def records(self) -> pd.DataFrame:
        """RMS error (µm) of every record and of each role, one column a model.

        Columns ``record``, ``role``, ``samples``, the names of the models, ``noise_floor`` and
        ``best``, the models within three per cent of the least error.
        """
        table = self._beside("records", ["name", "role", "samples"]).rename(
            columns={"name": "record"}
        )
        pooled = []
        for role in _ROLES:
            rows = table[table["role"] == role]
            if len(rows):
                errors = [each.rmse_um(role) for each in self.comparisons]
                samples = int(rows["samples"].sum())
                pooled.append([_POOLED[role], role, samples, *errors])
        heads = ["record", "role", "samples", *self.names]
        return self._judged(pd.concat([table, pd.DataFrame(pooled, columns=heads)]))

    @property
    def by_frequency(self) -> pd.DataFrame:
        """RMS error (µm) by frequency of the command (Hz), in the columns of :attr:`records`."""
        return self._judged(self._beside("by_frequency", ["frequency_hz", "half_cycles"]))

    @property
    def by_amplitude(self) -> pd.DataFrame:
        """RMS error (µm) by amplitude of the command (V), in the columns of :attr:`records`."""
        return self._judged(self._beside("by_amplitude", ["amplitude_V", "half_cycles"]))

    def _beside(self, table: str, keys: list[str]) -> pd.DataFrame:
        # the classes are those of the command, the same for every model
        tables = [getattr(each, table) for each in self.comparisons]
        found: pd.DataFrame = tables[0][keys].copy()
        for name, each in zip(self.names, tables, strict=True):
            found[name] = each["rmse_um"].to_numpy()
        return found

    def _judged(self, table: pd.DataFrame) -> pd.DataFrame:
        table = table.reset_index(drop=True)
        near = self.near(table)
        table["noise_floor"] = self.noise_floor_um
        table["best"] = [", ".join(near.columns[row]) for row in near.to_numpy(dtype=bool)]
        return table

    def near(self, table: pd.DataFrame) -> pd.DataFrame:
        """Return which models (columns) are nearest in the rows of one of the tables, or as good."""
        errors = table[list(self.names)]
        return errors.le((1.0 + _AS_GOOD) * errors.min(axis=1), axis=0)

    def rmse_um(self, role: str | None = None) -> dict[str, float | None]:
        """RMS error (µm) of each model over the records of a role; None without such."""
        return {n: c.rmse_um(role) for n, c in zip(self.names, self.comparisons, strict=True)}

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers as a JSON object of format ``rdpi-compare``.

        What one model has stands under ``models``, in the keys that its own comparison has.
        """
        shared = ("format", "version", "units", "data", "checks")
        wholes = [each.to_dict() for each in self.comparisons]
        return {
            "format": FORMAT,
            "version": VERSION,
            **{key: wholes[0][key] for key in shared[2:]},
            "noise_floor_um": self.noise_floor_um,
            "noise_origin": self.noise_origin,
            "findings": list(self.findings.values()),
            "best": {
                "records": self._rows(self.records),
                "by_frequency": self._rows(self.by_frequency),
                "by_amplitude": self._rows(self.by_amplitude),
            },
            "models": [
                {key: value for key, value in whole.items() if key not in shared}
                | {
                    "model": {
                        **whole["model"],
                        "name": name,
                        "plant": each.model.name,
                        "core": each.model.hysteresis.name,
                        "effects": [effect.name for effect in each.model.effects],
                    }
                }
                for name, each, whole in zip(self.names, self.comparisons, wholes, strict=True)
            ],
        }

    def _rows(self, table: pd.DataFrame) -> list[dict[str, Any]]:
        rows = []
        for row in table.to_dict(orient="records"):
            errors = {name: row.pop(name) for name in self.names}
            rows.append({**{str(k): v for k, v in row.items()}, "rmse_um": errors})
        return rows


def compare_several(dataset: Dataset, models: Mapping[str, PlantModel]) -> ModelComparison:
    """Compare several models with a measurement.

    Parameters
    ----------
    dataset
        The measurement.
    models
        By name; any cores and effects.

    Raises
    ------
    InputError
        As :func:`~rdpi_gym.diagnosis.compare`; more than ``MOST_MODELS``, or
        a model of other quantities than the data's.

    Examples
    --------
    >>> import numpy as np
    >>> from rdpi_gym.measurement import Record
    >>> from rdpi_gym.plant import Plant, named_plant
    >>> t = np.arange(2000) * 1e-3
    >>> u = 10.0 * np.sin(2 * np.pi * 5.0 * t)
    >>> y = Plant(named_plant("P5"), 1e-3).simulate(u)
    >>> data = Dataset("a sine", (Record("sine", t, u, y, ts_s=1e-3),))
    >>> plants = {name: named_plant(name) for name in ("P5-static", "P5")}
    >>> compare_several(data, plants).by_frequency["best"].tolist()
    ['P5']
    """
    if len(models) > MOST_MODELS:
        raise InputError(
            f"{len(models)} models are more than a page shows clearly; give {MOST_MODELS} at most"
        )
    for name, model in models.items():
        _check_quantities(name, model, dataset.quantities)
    comparisons = compare_each(dataset, list(models.values()))
    names = tuple(models)
    bare = ModelComparison(names, comparisons, {}, dataset.quantities)
    said = {
        "overall": _overall(bare),
        "records": _on_records(bare),
        "by_frequency": _where(bare.by_frequency, "frequency_hz", "Hz", "frequency"),
        "by_amplitude": _where(bare.by_amplitude, "amplitude_V", "{input_unit}", "amplitude"),
    }
    findings = {k: dataset.quantities.fill(t) for k, t in said.items() if t is not None}
    return ModelComparison(names, comparisons, findings, dataset.quantities)


def _check_quantities(name: str, model: PlantModel, measured: Quantities) -> None:
    own = stated_quantities(model.identification)
    units = [own.input.unit, own.output.unit]
    there = [measured.input.unit, measured.output.unit]
    if units != there:
        raise InputError(
            f"model {name} turns {units[0]} into {units[1]}, and these data have {there[0]} and {there[1]}; leave it out, or fit it to these data"
        )


def _overall(found: ModelComparison) -> str:
    role = "validation" if found.rmse_um("validation")[found.names[0]] is not None else None
    errors = {n: e for n, e in found.rmse_um(role).items() if e is not None}
    order = sorted(errors, key=lambda name: errors[name])
    near = [name for name in order if errors[name] <= (1.0 + _AS_GOOD) * errors[order[0]]]
    where = "held out" if role else "on all records"
    rest = [f"{name} {in_output(errors[name])}" for name in order if name not in near]
    best = f"{joined(near)} {'is' if len(near) == 1 else 'are'} nearest"
    others = f"; {joined(rest)}" if rest else ""
    floor = in_output(found.noise_floor_um)
    return f"{best} with {in_output(errors[order[0]])} rms {where}{others}. The noise floor is {floor}."


def _on_records(found: ModelComparison) -> str | None:
    count = len(found.comparisons[0].records)
    if count < 2:
        return None
    wins = found.near(found.records[:count]).sum().to_dict()
    said = [f"{name} on {wins[name]}" for name in sorted(wins, key=lambda n: -wins[n])]
    return f"Of {count} records, least error or as good as that: {joined(said)}."


def _where(table: pd.DataFrame, column: str, unit: str, word: str) -> str | None:
    rows = table[table["half_cycles"] >= FEW_HALF_CYCLES]
    if not len(rows):
        return None
    first, last = rows[column].iloc[0], rows[column].iloc[-1]
    if rows["best"].nunique() == 1:
        single = f"{first:.3g} {unit}" if len(rows) == 1 else f"{first:.3g} to {last:.3g} {unit}"
        return f"By {word}: {rows['best'].iloc[0]} throughout ({single})."
    said, runs = [], _runs(rows["best"].tolist())
    for start, stop in runs:
        low, high = rows[column].iloc[start], rows[column].iloc[stop]
        at = f"at {low:.3g}" if start == stop else f"from {low:.3g} to {high:.3g}"
        said.append(f"{rows['best'].iloc[start]} {at} {unit}")
    return f"By {word}: {'; '.join(said)}."


def _runs(labels: Sequence[str]) -> list[tuple[int, int]]:
    starts = [i for i, label in enumerate(labels) if i == 0 or label != labels[i - 1]]
    return [(a, b - 1) for a, b in zip(starts, [*starts[1:], len(labels)], strict=True)]
