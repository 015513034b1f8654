"""What a user takes home from a session."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rdpi_gym import face
from rdpi_gym.diagnosis.notices import Notice
from rdpi_gym.laboratory.bringing import SETTINGS, data_files
from rdpi_gym.laboratory.notebook import notebook_of
from rdpi_gym.laboratory.session import Session, Step
from rdpi_gym.report.thin import thin_index
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.fields import Fields
from rdpi_gym.support.words import quoted

FORMAT, VERSION = "rdpi-lab-session", 1
_DRAWN = 800  # samples of the next experiment that the page draws


@dataclass(frozen=True)
class Taken:
    """A file to take home.

    Parameters
    ----------
    name
        Of the file.
    media_type
        What it is, as HTTP says it.
    content
        What it holds.
    """

    name: str
    media_type: str
    content: bytes


def take(session: Session, name: str, rate_hz: float | None = None) -> Taken:
    """Return a file to take home."""
    if name not in FILES:
        raise InputError(f"{quoted(name)} cannot be taken home; there are {', '.join(FILES)}")
    media_type, make = FILES[name]
    text = _experiment(session, rate_hz) if make is None else make(session)
    return Taken(name, media_type, text.encode())


def _present(session: Session) -> Step:
    if session.current is None:
        raise InputError("there is no model yet; drop a file or take an exercise")
    return session.step(session.current)


def _records(session: Session) -> face.Dataset:
    data = session.data
    if data is None:
        raise InputError("there are no data yet; drop a file or take an exercise")
    return data


def _model(session: Session) -> str:
    plant = _present(session).plant
    with TemporaryDirectory() as folder:
        return plant.save(Path(folder) / "model.json").read_text(encoding="utf-8")


def _report(session: Session) -> str:
    plant, data = _present(session).plant, _records(session)
    with TemporaryDirectory() as folder:
        path = face.compare(data, plant).page(Path(folder) / "report.html")
        return path.read_text(encoding="utf-8")


def _settings(session: Session) -> str:
    path = session.data_folder / SETTINGS
    if path.exists():
        return path.read_text(encoding="utf-8")
    # what `load` found by itself, said
    roles = [
        f"[records.{json.dumps(r.name)}]\nrole = {json.dumps(r.role)}\n"
        for r in _records(session).records
    ]
    return "\n".join(roles)


def _session(session: Session) -> str:
    files = {
        file.name: hashlib.sha256(file.read_bytes()).hexdigest()
        for file in data_files(session.data_folder)
    }
    document = {
        "format": FORMAT,
        "version": VERSION,
        "title": None if session.data is None else session.data.title,
        "folder": str(session.folder.resolve()),
        "files_sha256": files,
        "path": session.path,
        "steps": [session.step(name).to_dict() for name in session.steps],
        "events": list(session.events()),
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _experiment(session: Session, rate_hz: float | None) -> str:
    present = _present(session)
    ranking = session.ranking_of(present.id)
    if ranking is None or ranking.result is None:
        raise InputError("the next experiment is known when the ranking is done; wait for it")
    fields = Fields(ranking.result, "ranking")
    # a session of before holds the text alone
    advice = Notice.optional(fields, "advice") or ranking.result["next_experiment"]
    planned = face.plan_experiment(advice, _records(session), present.plant, rate_hz)
    if planned is None:
        raise InputError("no experiment is advised that is a motion; there is nothing to play")
    return planned.csv()


def experiment_shown(planned: face.PlannedExperiment | None) -> dict[str, Any] | None:
    """Return the next experiment as the page draws it, thinned; None where there is none."""
    if planned is None:
        return None
    at = thin_index(planned.u_V, samples=_DRAWN)
    return {
        "title": planned.title,
        "rate_hz": planned.rate_hz,
        "seconds": planned.seconds,
        "unit": planned.quantities.input.unit,
        "t_s": [float(f"{t:.9g}") for t in planned.t_s[at].tolist()],
        "u": [float(f"{u:.6g}") for u in planned.u_V[at].tolist()],
    }


FILES: Mapping[str, tuple[str, Callable[[Session], str] | None]] = {
    "model.json": ("application/json", _model),
    "report.html": ("text/html; charset=utf-8", _report),
    "notebook.ipynb": ("application/x-ipynb+json", notebook_of),
    "session.json": ("application/json", _session),
    "dataset.toml": ("application/toml", _settings),
    "experiment.csv": ("text/csv; charset=utf-8", None),
}
"""Files to take home, each with what it is."""
