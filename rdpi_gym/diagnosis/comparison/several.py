"""Several models beside one measurement: which is nearer, on which record, rate and amplitude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from rdpi_gym.diagnosis.comparison.compare import FORMAT, VERSION, Comparison, compare_each
from rdpi_gym.diagnosis.comparison.findings import FEW_HALF_CYCLES
from rdpi_gym.measurement import Dataset, Quantities, stated_quantities
from rdpi_gym.measurement.quantities import in_output
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import joined

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
