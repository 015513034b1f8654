"""What a search found for one candidate, whole: for whoever watches it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from rdpi_gym.diagnosis.results import Errors
from rdpi_gym.diagnosis.search.candidates import Outcome, Setting
from rdpi_gym.diagnosis.search.law import plant_of
from rdpi_gym.plant import PlantModel


@dataclass(frozen=True)
class Refit:
    """A model that was refitted whole, as a search goes through its candidates.

    Parameters
    ----------
    effect, form
        The candidate in it; an empty effect is the model that the candidates are added to, an empty
        form the simplest.
    plant
        The model; None where no refit converged.
    errors
        What it leaves (µm rms).
    parameters
        Of the candidate.
    standard_errors
        Of every number that was fitted, as ``effect.parameter``, those of the core by their name
        alone; None where the records do not fix it.
    at_bound
        Which of them ended at a bound.
    remark
        Why there is no refit.
    """

    effect: str
    form: str
    plant: PlantModel[Any] | None
    errors: Errors
    parameters: Mapping[str, float]
    standard_errors: Mapping[str, float | None]
    at_bound: tuple[str, ...] = ()
    remark: str = ""


OnCandidate: TypeAlias = Callable[[Refit], None]
"""Called as soon as a refit is there, in the process that searches."""


def refit_of(setting: Setting, outcome: Outcome, given: PlantModel[Any] | None) -> Refit:
    """Return what a search found for one candidate."""
    if outcome.fit is None:
        nothing = Refit(outcome.effect, outcome.form, None, outcome.errors, {}, {})
        return replace(nothing, remark=outcome.remark)
    values = outcome.fitted.values if outcome.effect else {}
    return Refit(
        outcome.effect, outcome.form, plant_of(setting, outcome, given), outcome.errors, values,
        dict(outcome.fit.standard_errors), tuple(outcome.fit.at_bound),
    )  # fmt: skip
