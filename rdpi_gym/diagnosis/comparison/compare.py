"""Models against a measurement: the error in numbers, taken apart by what the command was doing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.checks import Check, run_checks
from rdpi_gym.diagnosis.comparison import findings
from rdpi_gym.diagnosis.comparison import traces as tables
from rdpi_gym.diagnosis.comparison.error_views import (
    PARTS,
    clock_finding,
    clock_table,
    distortion_finding,
    distortion_table,
    resting,
    share_of_peak,
    share_of_rests,
    since_rest_finding,
    since_rest_table,
    spectrum_finding,
    spectrum_table,
    squares_of_clock,
)
from rdpi_gym.diagnosis.comparison.findings import FEW_HALF_CYCLES
from rdpi_gym.diagnosis.comparison.traces import Plane, Trace, fitted_extremum_V, trace
from rdpi_gym.diagnosis.features.noise import noise_floor
from rdpi_gym.diagnosis.notices import Statement, statement
from rdpi_gym.diagnosis.preprocessing import Inspected, inspect
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.measurement import Dataset, Quantities, Record, stated_quantities
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.effects.creep import Creep
from rdpi_gym.support.errors import InputError

FORMAT, VERSION = "rdpi-compare", 1
_LEADING = 3
_CARRIES = 0.05  # of the squared error: a finding that leads
_PEAKED = 0.5  # of the squared error: a peak in the spectrum that explains the motion after a move
_MARKS_NOTHING = frozenset(
    [
        "records/one", "records/alike", "gain/still", "gain/fits", "drift/few", "drift/little",
        "direction/rises", "direction/falls", "direction/right", "plane/few", "since_rest/none",
        "since_rest/on little", "since_rest/back little", "clock/overlap", "clock/few",
        *(f"clock/{way}/{kind}" for way in ("rises", "falls") for kind in ("little", "unsure")),
        "spectrum/short", "spectrum/noise", "spectrum/slow", "distortion/none", "distortion/noise",
        "distortion/other",
        *(f"trend/{by}/{kind}" for by in ("frequency", "amplitude")
          for kind in ("none", "one", "stays/alone", "stays/confounded")),
    ]
)  # fmt: skip
"""Codes of findings that there is nothing to find."""


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
        Tables of the error; see :mod:`rdpi_gym.diagnosis.comparison.traces`.
    plane
        Mean residual over command and rate.
    spectrum, distortion, since_rest, clock
        Tables of the error by its own frequency, by harmonics, by time since the command came to
        rest or last rested, and by the experiment's clock; see
        :mod:`rdpi_gym.diagnosis.comparison.error_views`.
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
    def leading(self) -> tuple[str, ...]:
        """Keys of the at most three findings that carry most of the squared error, the first most."""
        told = {key for key, each in _statements(self).items() if each.code not in _MARKS_NOTHING}
        share, frequency_hz = share_of_peak(self.spectrum)
        rests = resting(self.since_rest)["time_s"]
        # the motion after a move rings at the peak
        if share >= _PEAKED and len(rests) and frequency_hz * float(rests.iloc[-1]) > 1.0:
            told.discard("since_rest")
        carried = {key: s for key, s in _shares(self).items() if key in told and s >= _CARRIES}
        return tuple(sorted(carried, key=lambda key: -carried[key])[:_LEADING])

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
    whole = traces
    if dataset.holds_out_quarters:  # blocks are too short for a spectrum
        kept = [r for r in dataset.records if r.name in unique]
        whole = tuple(trace(record, model) for record in kept)
    floor, origin = noise_floor(
        dataset.quiet, list(unique.values()), [each.residual_um[each.counted] for each in traces]
    )
    table = tables.record_table(traces, floor)
    samples = tables.sample_table(traces)
    frequency, amplitude = tables.by_frequency(samples), tables.by_amplitude(samples)
    directions, command = tables.by_direction(samples), tables.by_command(samples)
    plane = tables.plane(samples)
    spectrum, distortion = spectrum_table(whole, floor), distortion_table(whole)
    rests, clock = since_rest_table(traces), clock_table(traces)
    say = partial(text_of, quantities=dataset.quantities)
    bare = Comparison(
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
        noise_origin=say(origin),
        checks=checks,
        left_out=(
            *map(say, _left_out(dataset, samples, plane)),
            *inspected.left_out,
            *map(say, _remembered(counting, model)),
        ),
        findings={},
        quantities=dataset.quantities,
    )
    roles = (bare.rmse_um("train"), bare.rmse_um("validation"))
    found = {
        "far": findings.far_away(table),
        "range": findings.out_of_range(samples, model.command_range_V, model.name),
        "overall": findings.errors(table, *roles, origin),
        **_statements(bare),
    }
    return replace(bare, findings={key: say(s) for key, s in found.items() if s is not None})


def _statements(found: Comparison) -> dict[str, Statement]:
    """Return what each table suggests."""
    rmse_um = findings.rms_over(found.records)
    creeps = any(effect.name == Creep.name for effect in found.model.effects)
    return {
        "records": findings.record_spread(found.records),
        "drift": findings.drift(found.traces, rmse_um),
        "clock": clock_finding(found.clock, rmse_um),
        "since_rest": since_rest_finding(found.since_rest, found.noise_floor_um, creeps),
        "largest": findings.largest(found.traces),
        "gain": findings.gain(found.records),
        "by_frequency": findings.trend(found.by_frequency, "frequency_hz"),
        "by_amplitude": findings.trend(found.by_amplitude, "amplitude_V"),
        "by_direction": findings.direction(found.by_direction, found.by_command, rmse_um),
        "distortion": distortion_finding(found.distortion, found.noise_floor_um),
        "spectrum": spectrum_finding(found.spectrum),
        "plane": findings.command_and_rate(found.plane),
    }


def _shares(found: Comparison) -> dict[str, float]:
    """Return the share of the squared error (0 to 1) that each finding carries."""
    records = found.records
    total = float((records["samples"] * records["rmse_um"] ** 2).sum())
    return {
        "records": findings.share_above_rest(records),
        "drift": findings.share_of_drift(found.traces, records),
        "clock": squares_of_clock(found.clock) / max(total, 1e-300),
        "since_rest": share_of_rests(found.since_rest),
        "largest": findings.share_of_largest(found.traces, records),
        "gain": findings.share_of_gain(found.traces, records),
        "by_frequency": findings.share_above_rest(found.by_frequency),
        "by_amplitude": findings.share_above_rest(found.by_amplitude),
        "by_direction": findings.share_of_width(found.by_command, records),
        "distortion": findings.share_of_periodic(found.distortion, PARTS, records),
        "spectrum": share_of_peak(found.spectrum)[0],
        "plane": (found.plane.explained_percent or 0.0) / 100.0,
    }


def _left_out(dataset: Dataset, samples: pd.DataFrame, plane: Plane) -> list[Statement]:
    say = partial(dataset.quantities.said, keep=[record.name for record in dataset.records])
    found = [
        statement("left out/remark", record=r.name, remark=say(remark))
        for r in dataset.records
        for remark in r.remarks
    ]
    found += [statement("left out/quiet", record=r.name) for r in dataset.quiet]
    found += [statement("as written", text=say(remark)) for remark in dataset.remarks]
    without = int(samples["frequency_hz"].isna().sum())
    if without:
        found.append(statement("left out/reversals", count=without, whole=len(samples)))
    if plane.outside:
        found.append(statement("left out/fast", count=plane.outside))
    return found


def _remembered(records: Sequence[Record], model: PlantModel) -> list[Statement]:
    extrema_V = {record.name: fitted_extremum_V(model, record.name) for record in records}
    return [
        statement("left out/memory", record=name, extremum=extremum_V)
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
        """Title of the data set."""
        return self.comparisons[0].title

    @property
    def noise_floor_um(self) -> float:
        """Noise that no model can explain (µm, rms): the least of all comparisons."""
        return min(each.noise_floor_um for each in self.comparisons)

    @property
    def noise_origin(self) -> str:
        """Origin of :attr:`noise_floor_um`."""
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
    found = {
        "overall": _overall(bare),
        "records": _on_records(bare),
        "by_frequency": _where(bare.by_frequency, "frequency_hz"),
        "by_amplitude": _where(bare.by_amplitude, "amplitude_V"),
    }
    texts = {k: text_of(s, dataset.quantities) for k, s in found.items() if s is not None}
    return ModelComparison(names, comparisons, texts, dataset.quantities)


def _check_quantities(name: str, model: PlantModel, measured: Quantities) -> None:
    own = stated_quantities(model.identification)
    units = [own.input.unit, own.output.unit]
    there = [measured.input.unit, measured.output.unit]
    if units != there:
        raise InputError(
            f"model {name} turns {units[0]} into {units[1]}, and these data have {there[0]} and {there[1]}; leave it out, or fit it to these data"
        )


def _overall(found: ModelComparison) -> Statement:
    role = "validation" if found.rmse_um("validation")[found.names[0]] is not None else None
    errors = {n: e for n, e in found.rmse_um(role).items() if e is not None}
    order = sorted(errors, key=lambda name: errors[name])
    near = [name for name in order if errors[name] <= (1.0 + _AS_GOOD) * errors[order[0]]]
    rest = [statement("models/error", model=n, error=errors[n]) for n in order if n not in near]
    kind = "one" if len(near) == 1 else "several"
    return statement(
        f"models/nearest/{kind}/{'held out' if role else 'all'}/{'others' if rest else 'alone'}",
        models=tuple(near), error=errors[order[0]], others=tuple(rest), noise=found.noise_floor_um,
    )  # fmt: skip


def _on_records(found: ModelComparison) -> Statement | None:
    count = len(found.comparisons[0].records)
    if count < 2:
        return None
    wins = found.near(found.records[:count]).sum().to_dict()
    order = sorted(wins, key=lambda n: -wins[n])
    each = tuple(statement("models/wins", model=name, count=wins[name]) for name in order)
    return statement("models/records", count=count, wins=each)


def _where(table: pd.DataFrame, column: Literal["frequency_hz", "amplitude_V"]) -> Statement | None:
    rows = table[table["half_cycles"] >= FEW_HALF_CYCLES]
    if not len(rows):
        return None
    by = column.partition("_")[0]
    unit, values, best = statement(f"trend/unit/{by}"), rows[column].tolist(), rows["best"].tolist()

    def between(start: int, stop: int) -> Statement:
        kind = "value" if start == stop else "range"
        return statement(f"models/place/{kind}", low=values[start], high=values[stop], unit=unit)

    if len(set(best)) == 1:
        places = between(0, len(rows) - 1)
        return statement(f"models/throughout/{by}", models=best[0], places=places)
    parts = [
        statement("models/at" if a == b else "models/from", models=best[a], places=between(a, b))
        for a, b in _runs(best)
    ]
    return statement(f"models/by {by}", parts=parts)


def _runs(labels: Sequence[str]) -> list[tuple[int, int]]:
    starts = [i for i, label in enumerate(labels) if i == 0 or label != labels[i - 1]]
    return [(a, b - 1) for a, b in zip(starts, [*starts[1:], len(labels)], strict=True)]
