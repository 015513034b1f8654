"""`compare`: one model or several against measured records, as a result that shows itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, TypeAlias, overload

import numpy as np
import pandas as pd

from rdpi_gym import diagnosis, measurement
from rdpi_gym.diagnosis.search.discover import Inspection, Response
from rdpi_gym.diagnosis.search.plants import Refit
from rdpi_gym.face.catalogues import HasPlant, as_plant
from rdpi_gym.face.data import as_dataset, in_words_of
from rdpi_gym.face.display import DisplayMixin
from rdpi_gym.plant import PLANTS, PlantModel
from rdpi_gym.support.checks import checked
from rdpi_gym.support.words import first_sentence

if TYPE_CHECKING:
    from rdpi_gym.report.chart import Chart

_COLUMNS = {
    "name": "record",
    "role": "role",
    "rmse_um": "RMSE ({output_unit})",
    "nrmse_percent": "of the stroke (%)",
    "systematic_percent": "systematic (%)",
    "max_um": "largest ({output_unit})",
}


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(DisplayMixin, diagnosis.Comparison):
    """A model's error on a data set, as :func:`rdpi_gym.compare` returns it.

    Everything that :class:`rdpi_gym.diagnosis.Comparison` is, and it shows itself.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> result = rg.compare(rg.simulate("P5", seed=1, ts_factor=4.0), "P5")
    >>> result.rmse_um() < 0.02
    True
    """

    saved_as: ClassVar[str] = "comparison"

    def _lines(self) -> Sequence[str]:
        order = dict.fromkeys(("far", "range", *self.leading, *self.findings))
        said = [self.findings[k] for k in order if k in self.findings and k != "overall"]
        noticed = [check.sentence for check in self.checks if check.zone == "yes"]
        return [self.findings["overall"], *(f"- {text}" for text in (*said, *noticed))]

    def _evidence(self) -> Sequence[str]:
        keys = [key for key in ("far", "range", *self.leading) if key in self.findings]
        return [first_sentence(self.findings[key]) for key in keys[:3]]

    def brief(self) -> pd.DataFrame:
        """Return the errors record by record, the largest first."""
        order = self.records["rmse_um"].to_numpy().argsort()[::-1]
        return self.overview().iloc[order]

    def to_dataframe(self) -> pd.DataFrame:
        """Return the errors record by record; see :attr:`records`."""
        return self.records.copy()

    def overview(self) -> pd.DataFrame:
        """Return the errors record by record, with the columns that matter most."""
        return self._table_in_units(self.records[list(_COLUMNS)].rename(columns=_COLUMNS))

    def _chart(self) -> Chart:
        from rdpi_gym.report.comparison import comparison_chart

        return comparison_chart(self)

    def page(self, path: Path | str) -> Path:
        """Write the page of ``rdpi compare``: every table with its figure.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        from rdpi_gym.report.comparison_page import write_compare_page

        return write_compare_page(path, self)


@dataclass(frozen=True, eq=False, repr=False)
class ModelComparison(DisplayMixin, diagnosis.ModelComparison):
    """Errors of several models on one data set, as :func:`rdpi_gym.compare` returns them.

    Everything that :class:`rdpi_gym.diagnosis.ModelComparison` is, and it shows itself.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> both = rg.compare(rg.simulate("P5", seed=1, ts_factor=4.0), "P5", "P5-static")
    >>> both.to_dataframe().query("record == 'all validation'")["best"].tolist()
    ['P5']
    """

    saved_as: ClassVar[str] = "models"

    def _lines(self) -> Sequence[str]:
        first, *rest = self.findings.values()
        return [first, *(f"- {text}" for text in rest)]

    def _evidence(self) -> Sequence[str]:
        return [first_sentence(text) for text in list(self.findings.values())[1:4]]

    def brief(self) -> pd.DataFrame:
        """Return the errors by role, the noise floor, and the errors by record."""
        table, count = self.overview(), len(self.comparisons[0].records)
        return pd.concat([table.iloc[count:], table.iloc[:count]])

    def to_dataframe(self) -> pd.DataFrame:
        """Return the errors (µm) by record and role, a column a model; see :attr:`records`."""
        return self.records

    def overview(self) -> pd.DataFrame:
        """Return the errors by record and role, the nearest marked, and the noise floor."""
        table, near = self.records, self.near(self.records)
        frame = table[["record", "role"]].copy()
        for name in self.names:
            marks = np.where(near[name], " *", "")
            frame[name] = [f"{e:.3g}{m}" for e, m in zip(table[name], marks, strict=True)]
        frame.loc[len(frame)] = [
            "noise floor",
            "",
            *[f"{self.noise_floor_um:.3g}"] * len(self.names),
        ]
        return self._table_in_units(
            frame.rename(columns={"record": "RMS error ({output_unit}), * nearest"})
        )

    def _chart(self) -> Chart:
        from rdpi_gym.report.comparison import models_chart

        return models_chart(self)

    def page(self, path: Path | str) -> Path:
        """Write the page of ``rdpi compare`` with several models.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        from rdpi_gym.report.comparison_page import write_models_page

        return write_models_page(path, self)


Model: TypeAlias = PlantModel | HasPlant | PathLike[str] | str
"""A plant, a result that has one, the path of a plant file, or a plant's name."""


@overload
def compare(data: measurement.Dataset | PathLike[str] | str, model: Model) -> Comparison: ...


@overload
def compare(
    data: measurement.Dataset | PathLike[str] | str, model: Model, second: Model, /, *others: Model
) -> ModelComparison: ...


@checked
def compare(
    data: measurement.Dataset | PathLike[str] | str, model: Model, *others: Model
) -> Comparison | ModelComparison:
    """Compare models with measured records: the error taken apart, and tests without a model.

    Parameters
    ----------
    data
        From :func:`rdpi_gym.load`, or the path of a measurement.
    model
        A plant, a result that has one (of a fit, of a search), the path of a plant file, or a name
        of :data:`rdpi_gym.plants`.
    *others
        More of them, of any cores and effects, to be shown beside it.

    Returns
    -------
    Comparison or ModelComparison
        Of one model, or of several. It prints what it found; ``.plot()`` draws the record of the
        largest error.

    Raises
    ------
    InputError
        No sample counts, no such plant, an argument of another type; of several, more than six
        models, or one of other quantities than the data's.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", seed=1, ts_factor=4.0)
    >>> rg.compare(data, "P5").to_dataframe()["name"].nunique()
    15
    """
    dataset = as_dataset(data)
    with in_words_of(dataset):
        if not others:
            return Comparison.of(diagnosis.compare(dataset, as_plant(model)))
        return ModelComparison.of(diagnosis.compare_several(dataset, _named((model, *others))))


def _named(models: Sequence[Model]) -> dict[str, PlantModel]:
    """Return the plants, each by a name that no other has."""
    plants = [as_plant(model) for model in models]
    names = []
    for model, plant in zip(models, plants, strict=True):
        path = None if isinstance(model, PlantModel | HasPlant) else Path(model)
        if path is None or str(model) in PLANTS:
            names.append((plant.name, f"{plant.name} ({plant.hysteresis.name})"))
        else:  # `rdpi fit` calls every file model.json
            folder = path.absolute().parent.name
            names.append((path.stem, folder if path.stem == "model" else f"{folder}/{path.stem}"))
    firsts = [first for first, _ in names]
    found: dict[str, PlantModel] = {}
    for (first, second), plant in zip(names, plants, strict=True):
        name = base = first if firsts.count(first) == 1 else second
        count = 1
        while name in found:
            count += 1
            name = f"{base} {count}"
        found[name] = plant
    return found


__all__ = ["Inspection", "Refit", "Response", "inspect", "respond"]


@checked
def inspect(data: measurement.Dataset | PathLike[str] | str) -> Inspection:
    """Look through records as a search does, and keep them for models that are tried one by one.

    Parameters
    ----------
    data
        From :func:`rdpi_gym.load`, or the path of a measurement.

    Returns
    -------
    Inspection
        Its ``findings`` say what is no measurement; ``.respond(model)`` simulates a model on every
        record within milliseconds, ``.refit(model, held)`` fits one from where it stands.

    Raises
    ------
    InputError
        No record to fit, or none to validate on; an argument of another type.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)
    >>> looked = rg.inspect(data.select("stairs", "sine-50hz", "validation-stairs", "quiet"))
    >>> before = looked.respond(rg.plants["P5"]).errors
    >>> looked.refit(rg.plants["P5"]).errors.train_rmse_um < before.train_rmse_um
    True
    """
    dataset = as_dataset(data)
    with in_words_of(dataset):
        return Inspection(dataset)


@checked
def respond(
    model: PlantModel | HasPlant | PathLike[str] | str,
    data: measurement.Dataset | PathLike[str] | str,
) -> Response:
    """Simulate a model on every record as a search does, one offset free in each.

    Parameters
    ----------
    model
        A plant, a result that has one, the path of a plant file, or a plant's name.
    data
        From :func:`rdpi_gym.load`, or the path of a measurement; for one model after another on the
        same records see :func:`inspect`.

    Returns
    -------
    Response
        ``model_um`` (µm) by record, and ``errors`` (µm rms).

    Raises
    ------
    InputError
        As :func:`inspect`; no such plant.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> found = rg.respond("P5", rg.simulate("P5", seed=1, ts_factor=4.0))
    >>> found.errors.validation_rmse_um < 0.02
    True
    """
    plant = as_plant(model)
    return inspect(data).respond(plant)
