"""Records as a search looks through them, and models on them, one by one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rdpi_gym.diagnosis.preprocessing.finding import Finding
from rdpi_gym.diagnosis.preprocessing.inspection import inspect
from rdpi_gym.diagnosis.results import Errors
from rdpi_gym.diagnosis.search.candidates import assess
from rdpi_gym.diagnosis.search.plants import Refit, refit_of
from rdpi_gym.diagnosis.search.refitting import setting_of
from rdpi_gym.diagnosis.suitability import falls, turned
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import JointFit
from rdpi_gym.measurement import Dataset
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


@dataclass(frozen=True)
class Response:
    """Response of a model to the records, one offset free in each.

    Parameters
    ----------
    model_um
        Displacement of the model (µm) by record, ``(T,)``, its free offset included.
    errors
        Over the samples that a search counts (µm rms).
    """

    model_um: Mapping[str, Array]
    errors: Errors


class Inspection:
    """Records as a search looks through them, and models on them, one by one.

    Parameters
    ----------
    dataset
        The measurement.

    Attributes
    ----------
    findings : tuple of Finding
        What is no measurement and does not count: spikes, dropouts, clipping.

    Raises
    ------
    InputError
        No record to fit, or none to validate on.
    """

    def __init__(self, dataset: Dataset) -> None:
        if not dataset.train or not dataset.validation:
            raise InputError(
                f"{dataset.title} has {len(dataset.train)} records to fit and "
                f"{len(dataset.validation)} to validate on in which the {dataset.quantities.input.name} moves; "
                "give one of each"
            )
        self._sign = -1.0 if falls((*dataset.train, *dataset.validation)) else 1.0
        inspected = inspect(dataset if self._sign > 0 else turned(dataset))
        self.findings: tuple[Finding, ...] = inspected.findings
        self._recorded = dataset
        self._inspected = {record.name: record for record in inspected.dataset.records}
        self._setting = setting_of(inspected.dataset)

    def respond(self, model: PlantModel[Any]) -> Response:
        """Simulate a model on every record, as fast as a search does.

        Parameters
        ----------
        model
            The model; where the displacement falls as the voltage rises it describes the negative of
            it, as that of a search does, and its response is turned.
        """
        variant = Variant(model.hysteresis, model.effects)
        model_um = {}
        for record in self._recorded.records:
            looked = self._inspected.get(record.name, record)
            y = self._sign * simulate_effects([variant], looked)[:, 0]
            counted = looked.error_mask if looked.error_mask.any() else slice(None)
            model_um[record.name] = y + float(np.mean((record.y_um - y)[counted]))
        left = assess(self._setting, "", JointFit(variant, math.nan, (), {}, 0, True))
        return Response(model_um, left.errors)

    def refit(self, model: PlantModel[Any], held: Iterable[str] = ()) -> Refit:
        """Fit a model anew from where it stands: core and effects together.

        Parameters
        ----------
        model
            The model; the number of its plays stays.
        held
            Parameters that stay as they are, as ``creep.tau_s``.

        Raises
        ------
        InputError
            The model has no such parameter.
        """
        names = {f"{e.name}.{p.name}" for e in model.effects for p in e.parameters}
        names |= {p.name for p in type(model.hysteresis).shape}
        if unknown := [name for name in held if name not in names]:
            raise InputError(
                f"held: the model has no parameter {unknown[0]}; it has {', '.join(sorted(names))}"
            )
        fit = self._setting.fit(model.hysteresis, model.effects, held=frozenset(held))
        return refit_of(self._setting, assess(self._setting, "", fit), model)
