"""Downloads of a session: model, report, notebook, log, settings, next experiment."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rdpi_gym import face
from rdpi_gym.diagnosis.notices import Notice
from rdpi_gym.laboratory.data_import import SETTINGS, data_files
from rdpi_gym.laboratory.session import Session, Step
from rdpi_gym.laboratory.views import numbers
from rdpi_gym.report.traces import thin_index
from rdpi_gym.support.documents import PLAIN
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

_PREPARED = """\
import warnings
from dataclasses import replace

import rdpi_gym as rg

DATA = {folder!r}  # the records of the session; write where they are now
JOBS = -1  # processes of a ranking; -1: one for each core
data = rg.load(DATA)
data"""

_HELPERS = '''\
class Enough(Exception):
    """A ranking has come as far as it is needed."""


def ranked(model=None, core=None, until=None):
    """Rank the candidates on a model; return every refit, the model itself first."""
    global diagnosis
    refits = []

    def heard(refit):
        refits.append(refit)
        if until is not None and until(refits):
            raise Enough

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of refits that are not needed any more
        try:
            diagnosis = rg.diagnose(data, model, core=core, jobs=JOBS, on_candidate=heard)
            print(diagnosis)
        except Enough:
            pass
    return refits


def refits_with(refits, effect, form=""):
    """Return the refits with a candidate in one of its forms, in the order they were made."""
    return [r for r in refits if (r.effect, r.form) == (effect, form) and r.plant is not None]


errors = {}


def note(step, found):
    """Keep and print the error of a step (µm rms)."""
    errors[step] = (found.train_rmse_um, found.validation_rmse_um)
    print(f"{step}: {errors[step][0]!r} um on records to fit, {errors[step][1]!r} um on the others")'''

_SAME = """\
laboratory = {errors!r}
for step, (train_um, validation_um) in laboratory.items():
    # to nine digits: the order of a sum hangs on the number of processes
    same = all(abs(a - b) <= 1e-9 * b for a, b in zip(errors[step], (train_um, validation_um)))
    print(step, "the same numbers" if same else f"the laboratory had {{train_um!r}}, {{validation_um!r}}")"""


def notebook_of(session: Session) -> str:
    """Return a notebook (nbformat 4) that repeats the way to the present model."""
    session.present()
    data, steps = session.need_data(), [session.step(name) for name in session.path]
    present = steps[-1]
    title = (
        f"# {_plain(data.title)}\n\nWhat was done in the laboratory, step by step, with `rdpi_gym`."
    )
    cells = [
        _text(title),
        _code(_PREPARED.format(folder=str(session.data_folder.resolve()))),
        _code(_HELPERS),
    ]
    events = list(session.events())
    last = max((k for k, event in enumerate(events) if event["do"] == "read"), default=-1)
    for text, code in _repeated(steps, events[last + 1 :]):  # a new history began there
        cells += [_text(text), _code(code)]
    said = {step.id: (step.train_um, step.validation_um) for step in steps}
    cells += [
        _text("## The present model on all records"),
        _code(f"rg.compare(data, {present.id})"),
        _code(f"{present.id}.to_dict()"),
        _text("The errors here beside those of the laboratory."),
        _code(_SAME.format(errors=said)),
    ]
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    document = {
        "cells": [{"id": f"c{number}", **cell} for number, cell in enumerate(cells)],
        "metadata": {"kernelspec": kernel, "language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _plain(text: str) -> str:
    """Write a text of the session in Markdown, none of whose marks it makes."""
    return re.sub(r"([\\`*_\[\]!$])", r"\\\1", escape(" ".join(text.split()), quote=False))


def _text(text: str) -> dict[str, Any]:
    return {"cell_type": "markdown", "metadata": {}, "source": text.splitlines(keepends=True)}


def _code(code: str) -> dict[str, Any]:
    lines = code.splitlines(keepends=True)
    return {
        "cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": lines,
    }  # fmt: skip


def _repeated(steps: list[Step], events: list[Mapping[str, Any]]) -> Iterator[tuple[str, str]]:
    """Yield Markdown on each step of a path, and code that leaves its model in a variable of its name."""
    for number, step in enumerate(steps):
        before = steps[number - 1] if number else None
        following = steps[number + 1] if number + 1 < len(steps) else None
        text = f"## {_plain(step.label)}\n\nIn the laboratory: {step.validation_um:.6g} µm on validation records."
        lines = [_made(step, before, events), _ranking(step, following, events)]
        yield text, "\n".join(line for line in lines if line)


def _made(step: Step, before: Step | None, events: list[Mapping[str, Any]]) -> str:
    """Return what makes the model of a step as it was at first."""
    made, name = step.made, step.id
    kind, effect = made["kind"], made.get("effect", "")
    if kind == "fit":
        if _is_bettered(step, events):
            return ""  # by the search's own base model, which stands on the data alone
        core = made.get("core")
        fit = f"rg.fit_core(data, {core!r}, " if core and core != "rdpi" else "rg.fit(data, "
        return _noted(name, f"{fit}name='base').plant", f"rg.respond({name}, data).errors")
    assert before is not None
    if kind == "settled":  # the ranking on the step before was waited for
        return _noted(name, "diagnosis.plant", "diagnosis.final")
    if kind in ("candidate", "added", "removal", "refit"):
        if kind == "candidate":
            form = made.get("form", "")
            at = _refits_before(step, before, effect, form, events) - 1
            call = f"refits_with(refits, {effect!r}, {form!r})[{at}]"
        elif kind == "added":
            call = f"rg.add({effect!r}, data, {before.id})"
        elif kind == "removal":
            kept = f"tuple(e for e in {before.id}.effects if e.name != {effect!r})"
            call = f"ranked(replace({before.id}, effects={kept}), until=len)[0]"
        else:
            call = f"rg.inspect(data).refit({before.id}, {list(made['held'])!r})"
        errors = "found.final" if kind == "added" else "found.errors"
        return f"found = {call}\n{_noted(name, 'found.plant', errors)}"
    values = {made["parameter"]: made["value"]}
    changed = f"hysteresis={before.id}.hysteresis.with_shape({values!r})"
    if effect:
        moved = f"e.with_values({values!r}) if e.name == {effect!r} else e"
        changed = f"effects=tuple({moved} for e in {before.id}.effects)"
    model = f"replace({before.id}, {changed})"
    return _noted(name, model, f"rg.respond({name}, data).errors")


def _noted(name: str, model: str, errors: str) -> str:
    return f"{name} = {model}\nnote({name!r}, {errors})"


def _is_bettered(step: Step, events: list[Mapping[str, Any]]) -> bool:
    """Whether the search's own refit took the place of a step's first model."""
    plants = [
        e["step"]["plant"]
        for e in events
        if e["do"] in ("step", "update") and e["step"]["id"] == step.id
    ]
    made_by_search = step.made["kind"] == "fit" and step.made.get("core") == "auto"
    return made_by_search or plants[0] != plants[-1]


def _ranking(step: Step, following: Step | None, events: list[Mapping[str, Any]]) -> str:
    """Return the ranking on a step, as far as it was waited for or is needed; empty without one."""
    if step.made["kind"] == "fit" and _is_bettered(step, events):
        model, core = "None", repr(step.made.get("core"))
    else:
        model, core = step.id, "None"
    until, bettered = "len", _is_bettered(step, events)
    if _is_done(step, following, events):
        until = "None"
    elif following is not None and following.made["kind"] == "candidate":
        effect, form = following.made["effect"], following.made.get("form", "")
        count = _refits_before(following, step, effect, form, events)
        until = f"lambda so_far: len(refits_with(so_far, {effect!r}, {form!r})) == {count}"
    elif not bettered:
        return ""
    call = f"refits = ranked({model}, {core}, until={until})"
    if not bettered:
        return call
    return f"{call}\nfound = refits[0]\n{_noted(step.id, 'found.plant', 'found.errors')}"


def _is_done(step: Step, following: Step | None, events: list[Mapping[str, Any]]) -> bool:
    """Whether the ranking on a step was waited for before the next step was made."""
    done = False
    for event in events:
        if event["do"] == "ranking" and event["step"] == step.id:
            done = event["status"] == "done"
        elif following and event["do"] == "step" and event["step"]["id"] == following.id:
            break
    return done


def _refits_before(
    step: Step, before: Step, effect: str, form: str, events: list[Mapping[str, Any]]
) -> int:
    """Count the refits with a candidate in the ranking that a step was taken from."""
    count = 0
    for event in events:
        if event["do"] == "ranking" and event["step"] == before.id and event["status"] == "running":
            count = 0
        elif event["do"] == "refit" and event["step"] == before.id:
            refit = event["refit"]
            count += (refit["effect"], refit["form"]) == (effect, form) and (
                refit["plant"] is not None
            )
        elif event["do"] == "step" and event["step"]["id"] == step.id:
            break
    return count


FORMAT, VERSION = "rdpi-lab-session", 1
_DRAWN = 800  # samples of the next experiment that the page draws


def download(session: Session, name: str, rate_hz: float | None = None) -> tuple[str, str]:
    """Return media type and content of a file to download."""
    if name not in FILES:
        raise InputError(f"{quoted(name)} cannot be taken home; there are {', '.join(FILES)}")
    media_type, make = FILES[name]
    return media_type, _experiment(session, rate_hz) if make is None else make(session)


def _model(session: Session) -> str:
    plant = session.present().plant
    with TemporaryDirectory() as folder:
        return plant.save(Path(folder) / "model.json").read_text(encoding="utf-8")


def _report(session: Session) -> str:
    plant, data = session.present().plant, session.need_data()
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
        for r in session.need_data().records
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
    present = session.present()
    ranking = session.rankings.get(present.id)
    if ranking is None or ranking.result is None:
        raise InputError("the next experiment is known when the ranking is done; wait for it")
    stated = PLAIN.read(Notice | None, ranking.result["advice"], "ranking: advice")
    advice = stated or ranking.result["next_experiment"]  # an old session holds the text alone
    planned = face.plan_experiment(advice, session.need_data(), present.plant, rate_hz)
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
        "u": numbers(planned.u_V[at]),
    }


FILES: Mapping[str, tuple[str, Callable[[Session], str] | None]] = {
    "model.json": ("application/json", _model),
    "report.html": ("text/html; charset=utf-8", _report),
    "notebook.ipynb": ("application/x-ipynb+json", notebook_of),
    "session.json": ("application/json", _session),
    "dataset.toml": ("application/toml", _settings),
    "experiment.csv": ("text/csv; charset=utf-8", None),
}
"""Files to download, with their media types and writers."""
