"""Diagnosers that ship: the laboratory, and three that any other one has to beat."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.diagnosis.answers import Answer, Diagnoser
from benchmarks.diagnosis.draws import drawn_cases
from benchmarks.diagnosis.signatures import (
    SAMPLES,
    Library,
    best_sparse_models,
    changes,
    library_of,
    nearest_places,
    signature_rows,
)
from rdpi_gym.diagnosis.features.noise import noise_floor
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import first_steps, fit_joint
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.plugins import load_attribute
from rdpi_gym.support.words import quoted

_PLAYS, _SPREAD = 40, 1.5  # of the base model: finer where loops are small
_SMALL = 1e-3  # of the noise: a signature that is smaller moves nothing


def laboratory(dataset: Dataset) -> Answer:
    """Diagnose as ``rg.discover`` does, in one process."""
    from rdpi_gym.diagnosis.search.discover import discover

    found = discover(dataset, jobs=1)
    stated = found.probabilities
    named = {candidate.effect: candidate.confidence for candidate in found.added}
    effects = named if stated is None else dict(stated.effects)
    other = 0.0 if stated is None else stated.other
    variant = Variant(found.plant.hysteresis, found.plant.effects)
    return Answer(effects, other, partial(simulated, variant))


def base_model(dataset: Dataset) -> Variant[Any]:
    """Return the base model on a comb of thresholds, fitted to the records; δ2 from two starts."""
    records = dataset.train
    scale = data_scale(records)
    thresholds = scale.span_V * (np.arange(1, _PLAYS + 1) / _PLAYS) ** _SPREAD
    gain = scale.stroke_um / scale.span_V
    weights = (0.7 * gain, *[0.3 * gain / _PLAYS] * _PLAYS)
    found = [
        fit_joint(records, RDPI(weights, tuple(thresholds.tolist()), delta2_s))
        for delta2_s in (0.0, 0.03 * scale.span_V / max(scale.fastest_V_s, 1e-9))
    ]
    return min(found, key=lambda fit: fit.train_rmse_um).variant


def simulated(variant: Variant[Any], record: Record) -> Array:
    """Displacement (µm) of a model over a record."""
    return np.asarray(simulate_effects([variant], record)[:, 0])


def most_frequent(dataset: Dataset) -> Answer:
    """State of every effect how often the benchmark hides it, whatever the records are."""
    cases = drawn_cases(0)
    counts = Counter(
        "other" if case.study == "outside" else name
        for _, case in cases
        for name in case.subject or ("nothing",)
    )
    effects = {name: counts[name] / len(cases) for name in CATALOGUE}
    return Answer(effects, counts["other"] / len(cases), partial(simulated, base_model(dataset)))


@dataclass(frozen=True, eq=False)
class _Residual:
    """Residual of the base model beside the signatures of the effects that move it."""

    variant: Variant[Any]
    library: Library
    rows: Array  # of each effect at its nearest place, rms 1, [rows, effects]
    sizes_um: Array
    left_um: Array
    noise_um: float

    def predicted(self, coefficients: Array, record: Record) -> Array:
        """Displacement (µm) of the base model with signatures added."""
        still = simulate_effects([self.variant], record)[:, 0]
        added = (
            changes(self.variant, self.library, record) if self.library else still[:, None][:, :0]
        )
        return np.asarray(still + added @ (coefficients / self.sizes_um))  # fmt: skip

    def unexplained(self, share: float) -> float:
        """Share of the residual's squares that is neither noise nor explained."""
        noise = min(1.0, self.noise_um**2 / max(float(np.mean(self.left_um**2)), 1e-300))
        return float(np.clip(1.0 - share - noise, 0.0, 1.0))


def _residual(dataset: Dataset) -> _Residual:
    variant, records = base_model(dataset), dataset.train
    whole = first_steps(records, variant.hysteresis, (), 0, samples=SAMPLES).left_um
    noise_um, _ = noise_floor(dataset.quiet, records, whole)
    library = library_of(CATALOGUE, data_scale(records))
    rows, left = signature_rows(variant, library, records)
    moving = nearest_places(library, rows, left, _SMALL * noise_um)
    sizes = np.sqrt(np.mean(rows[:, moving] ** 2, axis=0))
    near = [library[k] for k in moving]
    return _Residual(variant, near, rows[:, moving] / sizes, sizes, left, noise_um)


def residual_correlation(dataset: Dataset) -> Answer:
    """State of every effect the squared correlation of its signature with the base model's residual."""
    found = _residual(dataset)
    dot = found.left_um @ found.rows / len(found.rows)
    squares = np.clip(dot**2 / max(float(np.mean(found.left_um**2)), 1e-300), 0.0, 1.0)
    best = np.arange(squares.size) == (int(np.argmax(squares)) if squares.size else 0)
    effects = {name: float(p) for (name, _), p in zip(found.library, squares, strict=True)}
    other = found.unexplained(float(squares.max(initial=0.0)))
    return Answer(effects, other, partial(found.predicted, np.where(best, dot, 0.0)))


def e_sindy(dataset: Dataset) -> Answer:
    """State of every effect the share of resampled sparse regressions that have it (E-SINDy)."""
    try:
        import pysindy as _  # noqa: F401
    except ImportError:
        raise InputError(
            "PySINDy is not installed; install it with: pip install 'rdpi-gym[sindy]'"
        ) from None
    found = _residual(dataset)
    held = np.arange(len(found.rows)) * 8 // len(found.rows) % 2 == 1  # every second eighth
    models = best_sparse_models(
        found.rows[~held], found.left_um[~held], found.rows[held], found.left_um[held],
        found.noise_um, 0,
    )  # fmt: skip
    chances = np.mean(models != 0.0, axis=0)
    effects = {name: float(p) for (name, _), p in zip(found.library, chances, strict=True)}
    typical = np.median(models, axis=0)
    rest = float(np.mean((found.left_um - found.rows @ typical) ** 2))
    share = 1.0 - rest / max(float(np.mean(found.left_um**2)), 1e-300)
    return Answer(effects, found.unexplained(share), partial(found.predicted, typical))


ENTRIES: Mapping[str, Diagnoser] = {
    "laboratory": laboratory,
    "most-frequent": most_frequent,
    "residual-correlation": residual_correlation,
    "e-sindy": e_sindy,
}
"""Diagnosers of this package by name."""


def find_diagnoser(name: str) -> Diagnoser:
    """Return a diagnoser of this package, or what a module that the user names has."""
    if name in ENTRIES:
        return ENTRIES[name]
    if ":" not in name:
        raise InputError(
            f"no diagnoser is named {quoted(name)}; give {', '.join(ENTRIES)} or module:attribute"
        )
    found = load_attribute(name, "diagnoser")
    if not callable(found):
        raise InputError(f"{quoted(name)} is no callable; give one that takes a data set")
    made: Diagnoser = found
    return made


def named_diagnosers(names: Sequence[str]) -> list[str]:
    """Return names of diagnosers, by default all that can run here; refuse unknown ones."""
    here = [name for name in ENTRIES if name != "e-sindy" or find_spec("pysindy") is not None]
    chosen = list(dict.fromkeys(names)) or here
    for name in chosen:
        find_diagnoser(name)
    return chosen
