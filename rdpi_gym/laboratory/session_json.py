"""State of a session as JSON for the page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rdpi_gym.laboratory import data_import, views
from rdpi_gym.laboratory.session import Session, Step
from rdpi_gym.measurement import Quantities
from rdpi_gym.measurement.table import stem_of
from rdpi_gym.plant import CORES


def state_of(
    session: Session,
    job: Mapping[str, Any] | None,
    problem: str | None,
    pictures: Mapping[str, Any],
) -> dict[str, Any]:
    """Return everything that the page shows but traces."""
    data, current = session.data, session.current
    said = {} if current is None else session.said.get(current, {})
    quantities = Quantities() if data is None else data.quantities
    return {
        "title": "New session" if data is None else data.title,
        "session_folder": str(session.folder),
        "problem": problem,
        "quantities": views.quantities_of(quantities),
        "files": [{"name": name, **entry} for name, entry in sorted(session.files.items())],
        "records": _records(session),
        "settings": _settings(session),
        "noise_um": noise_um(session),
        "steps": {id: views.step_row(step, quantities.unit) for id, step in session.steps.items()},
        "path": session.path,
        "redo": session.redo,
        "current": current,
        "sentence": said.get("sentence"),
        "ranking": _ranking(session, pictures),
        "job": job,
        "payoff": None if current is None else session.payoffs.get(current),
    }


def _records(session: Session) -> list[dict[str, Any]]:
    data, folder = session.data, session.data_folder
    if data is None:
        return []
    said = data_import.settings_of(folder).get("records", {})
    files = {stem_of(file): file.name for file in data_import.data_files(folder)}
    only = next(iter(files.values()), "")
    asked = data.units_assumed.partition(";")[0]  # the page gives no options
    rows = (
        views.record_row(r, files.get(r.name, only), said.get(r.name, {})) for r in data.records
    )
    return [{**row, "remarks": [*row["remarks"], *filter(None, [asked])]} for row in rows]


def _settings(session: Session) -> dict[str, Any]:
    document = data_import.settings_of(session.data_folder)
    return {
        "title": document.get("title"),
        "skip_s": document.get("skip_s"),
        "quantities": document.get("quantities", {}),
        "cores": [{"key": key, "title": core.title} for key, core in CORES.items()],
    }


def noise_um(session: Session) -> float | None:
    """Return the noise floor (µm rms) as far as it is known."""
    current = session.current
    for step in [] if current is None else reversed(session.path):
        ranking = session.rankings.get(step)
        result = None if ranking is None else ranking.result
        if result is not None and result["noise_floor"] is not None:
            return float(result["noise_floor"])
    said = [session.said[s]["noise_um"] for s in session.path if s in session.said]
    return min(said, default=None)


def _ranking(session: Session, pictures: Mapping[str, Any]) -> dict[str, Any] | None:
    current = session.current
    ranking = None if current is None else session.rankings.get(current)
    if current is None or ranking is None:
        return None
    result = ranking.result
    return {
        "step": ranking.step,
        "status": ranking.status,
        "problem": ranking.problem,
        "cards": cards_of(session, current, pictures),
        "verdict": None if result is None else result["headline"],
        "lines": [] if result is None else result["lines"],
        "left": None if result is None else _left(result),
        "settled": None if result is None else _settled(session.step(current), result),
    }


def _settled(step: Step, result: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the error of the model as the ranking ended with it, where that leaves less."""
    final = result["final"]
    left_um = final["validation_rmse"]
    if result["settled"] is None or left_um is None or left_um >= step.validation_um:
        return None
    return {"train_um": final["train_rmse"], "validation_um": final["validation_rmse"]}


def _left(result: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "sentence": result["remainder"],
        "portrait_lines": result["portrait_lines"],
        "next_experiment": result["next_experiment"],
        "experiment": result.get("experiment"),
    }


def cards_of(session: Session, step: str, pictures: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the candidates of a step as cards."""
    ranking, own = session.rankings[step], session.step(step)
    base = ranking.refits.get(("", ""))
    base_um = own.validation_um if base is None else base["validation_um"]
    plant = own.plant
    return views.cards(
        ranking,
        base_um,
        noise_um(session),
        type(plant.hysteresis),
        {effect.name for effect in plant.effects},
        pictures,
        str if session.data is None else session.data.quantities.unit,
    )
