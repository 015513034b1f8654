"""The long work of the laboratory, as it is done in a worker process."""

from __future__ import annotations

import threading
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from rdpi_gym import face
from rdpi_gym.laboratory import compensator_comparison, views
from rdpi_gym.laboratory.downloads import experiment_shown
from rdpi_gym.laboratory.work import Tell
from rdpi_gym.measurement import Record
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.effects.base import in_chain_order
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.parallel import run_cases

_RDPI = "rdpi"
_REPORTED = (
    "candidates", "chosen", "headline", "verdict", "sampling", "undecided", "remainder", "left",
    "next_experiment", "advice", "noise_floor", "noise_origin", "indistinguishable", "limits", "notes",
    "seconds", "base", "final",
)  # fmt: skip
_WARM_SAMPLES = 800


def rank(
    tell: Tell,
    data: face.Dataset,
    model: PlantModel | None,
    core: str | None,
    jobs: int,
) -> dict[str, Any]:
    """Rank all candidates on a model; without one, a base model is fitted first."""
    if model is None:
        first = _first_fit(data, core)
        if first is not None:
            errors = views.errors_of(face.respond(first, data).errors)
            found = {"effect": "", "form": "", "plant": first.to_dict(), **errors}
            tell.news("refit", found | {"parameters": {}, "standard_errors": {}, "at_bound": []})
    if jobs > 1:
        warm_helpers(jobs)
    diagnosis = face.diagnose(
        data,
        model,
        core=None if model is not None else core,
        jobs=jobs,
        progress=tell.progress,
        on_candidate=lambda refit: tell.news("refit", refit_to_dict(refit)),
    )
    document = diagnosis.to_dict()
    portrait = diagnosis.portrait
    return {key: document[key] for key in _REPORTED} | {
        "findings": [finding.sentence for finding in diagnosis.findings],
        "portrait_lines": [] if portrait is None else str(portrait).splitlines(),
        "lines": repr(diagnosis).splitlines(),
        # where nothing is advised: the same model, its core in few numbers
        "settled": None if diagnosis.added else diagnosis.plant.to_dict(),
        "experiment": experiment_shown(diagnosis.experiment()),
    }


def _first_fit(data: face.Dataset, core: str | None) -> PlantModel | None:
    """Fit a base model at once; None where only a search can choose it."""
    try:
        if core is None or core == _RDPI:
            return face.fit(data, name="base").plant
        if core != "auto":
            return face.fit_core(data, core, name="base").plant
    except InputError:  # the search says it better, or takes another core
        pass
    return None


def refit(tell: Tell, data: face.Dataset, model: PlantModel, held: list[str]) -> dict[str, Any]:
    """Fit a model anew from where it stands, some of its parameters held."""
    return refit_to_dict(face.inspect(data).refit(model, held))


def simulate(tell: Tell, model: str, hide: list[str], seed: int, ts_factor: float) -> face.Dataset:
    """Simulate the standard protocol with hidden effects, as if it had been measured."""
    found = face.simulate(model, hide, seed=seed, ts_factor=ts_factor, progress=tell.progress)
    return face.Dataset.of(found)


def add(
    tell: Tell, effect: str, data: face.Dataset, model: PlantModel, jobs: int
) -> dict[str, Any]:
    """Add an effect that was not tried before, or ``unknown``: the block that records teach."""
    found = face.add(effect, data, model, jobs=jobs, progress=tell.progress)
    added = {"effect": effect, "form": found.added[0].form, "plant": found.plant.to_dict()}
    return added | views.errors_of(found.final)


def payoff(tell: Tell, **asked: Any) -> dict[str, Any]:
    """Compare compensators on a reference with two beliefs."""
    return compensator_comparison.payoff(**asked, progress=tell.progress)


def refit_to_dict(refit: face.Refit) -> dict[str, Any]:
    """Return the object of the journal for a refit."""
    return {
        "effect": refit.effect,
        "form": refit.form,
        "plant": None if refit.plant is None else refit.plant.to_dict(),
        **views.errors_of(refit.errors),
        "parameters": dict(refit.parameters),
        "standard_errors": dict(refit.standard_errors),
        "at_bound": list(refit.at_bound),
        "remark": refit.remark,
    }


def warm_up() -> None:
    """Load what every job needs: modules, and kernels for a small record."""
    data = _small()
    model = face.fit(data, 3)
    looked = face.inspect(data)
    every = tuple(kind() for kind in face.effects.values())
    looked.refit(replace(model.plant, effects=every[-1:]))
    looked.respond(replace(model.plant, effects=in_chain_order(every)))
    with suppress(_EarlyStopError):
        face.diagnose(data, jobs=1, on_candidate=_stop_early)


class _EarlyStopError(Exception):
    """Ends a search that has shown its beginning."""


def _stop_early(refit: face.Refit) -> None:
    raise _EarlyStopError


def _small() -> face.Dataset:
    t_s = np.arange(_WARM_SAMPLES, dtype=np.float64) * 1e-3
    u_V = 10.0 * np.sin(2.0 * np.pi * 5.0 * t_s) * np.linspace(0.5, 1.0, t_s.size)
    y_um = 1.1 * u_V + 0.1 * np.abs(u_V) + 0.01 * np.cos(777.0 * t_s)
    return face.Dataset("warm-up", (Record("warm-up", t_s, u_V, y_um, ts_s=1e-3),))


def warm_helpers(count: int) -> threading.Thread:
    """Start the processes among which a ranking divides its candidates, if they do not run yet."""

    def start() -> None:
        for _ in run_cases(_warm, range(count), count):
            pass

    thread = threading.Thread(target=start, daemon=True)
    thread.start()
    return thread


def _warm(_: int) -> None:
    warm_up()
