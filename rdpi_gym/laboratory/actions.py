"""Questions and actions of the page: what a request says, and what the laboratory is called with."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from rdpi_gym.laboratory import views
from rdpi_gym.laboratory.data_import import preview
from rdpi_gym.laboratory.downloads import download
from rdpi_gym.laboratory.examples import examples
from rdpi_gym.laboratory.lab import Lab
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


def _text(said: Mapping[str, Any], key: str) -> str:
    value = said.get(key)
    if not isinstance(value, str):
        raise InputError(f"{key} is {quoted(value)}; give a text")
    return value


def _number(said: Mapping[str, Any], key: str) -> float:
    value = said.get(key)
    try:
        found = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{key} is {quoted(value)}; give a number") from None
    if found != found or abs(found) == float("inf"):
        raise InputError(f"{key} is {quoted(value)}; give a finite number")
    return found


def _optional(said: Mapping[str, Any], key: str) -> float | None:
    return None if said.get(key) in (None, "") else _number(said, key)


def _preview(lab: Lab, asked: Mapping[str, str]) -> Any:
    session = lab.session
    return preview(session.data_folder, session.files, _text(asked, "file"), asked.get("separator"))


def _trace(lab: Lab, asked: Mapping[str, str]) -> Any:
    data = lab.session.need_data()
    record = views.record_named(data, _text(asked, "record"))
    plant = lab.plant_shown(asked.get("step") or None)
    effect = asked.get("effect")
    other = lab.plant_with(effect, asked.get("step") or None) if effect else None
    part = views.stretch(record, _optional(asked, "from_s"), _optional(asked, "to_s"))
    points = int(_optional(asked, "points") or views.POINTS)
    return views.trace(
        record,
        None if plant is None else lab.displacement(plant, record.name),
        None if other is None else lab.displacement(other, record.name),
        part,
        min(max(points, 100), 20_000),
    )


def _views(lab: Lab, asked: Mapping[str, str]) -> Any:
    record, model_um = _modelled(lab, asked)
    return views.residual_views(record, model_um, lab.noise_um())


def _brush(lab: Lab, asked: Mapping[str, str]) -> Any:
    record, model_um = _modelled(lab, asked)
    ends = (_optional(asked, "from_s"), _optional(asked, "to_s"))
    return views.brushed(record, model_um, asked.get("by") or "time", *ends)


def _modelled(lab: Lab, asked: Mapping[str, str]) -> tuple[Record, Array]:
    """Return a record, and what the model of a step makes of it (µm)."""
    record = views.record_named(lab.session.need_data(), _text(asked, "record"))
    plant = lab.plant_shown(asked.get("step") or None)
    if plant is None:
        raise InputError("there is no model yet; wait for the base model")
    return record, lab.displacement(plant, record.name)


def take(lab: Lab, name: str, asked: Mapping[str, str]) -> tuple[str, str]:
    """Return media type and content of a file to download."""
    rate_hz = None if asked.get("rate_hz") is None else _number(asked, "rate_hz")
    return download(lab.session, name, rate_hz)


QUESTIONS: Mapping[str, Callable[[Lab, Mapping[str, str]], Any]] = {
    "examples": lambda lab, asked: [example.to_dict() for example in examples()],
    "preview": _preview,
    "trace": _trace,
    "views": _views,
    "brush": _brush,
}
"""By the name of their path; answered in threads."""


async def _parameter(lab: Lab, said: Mapping[str, Any]) -> dict[str, Any]:
    effect = said.get("effect") or ""
    name, value = _text(said, "parameter"), _number(said, "value")
    if not isinstance(effect, str):
        raise InputError(f"effect is {quoted(effect)}; give a text")
    if said.get("commit"):
        return await lab.set_parameter(effect, name, value)
    plant = lab.moved(effect, name, value)

    def answer() -> dict[str, Any]:
        response = lab.respond(plant, keep=False)
        found: dict[str, Any] = {
            "errors": {
                "train_um": views.number(response.errors.train_rmse_um),
                "validation_um": views.number(response.errors.validation_rmse_um),
            },
            "trace": None,
        }
        if said.get("record"):
            record = views.record_named(lab.session.need_data(), _text(said, "record"))
            part = views.stretch(record, _optional(said, "from_s"), _optional(said, "to_s"))
            model_um = response.model_um[record.name]
            found["trace"] = views.trace(record, model_um, None, part)
        return found

    return await asyncio.to_thread(answer)


async def _hold(lab: Lab, said: Mapping[str, Any]) -> dict[str, Any]:
    effect = said.get("effect") or ""
    return await lab.hold(str(effect), _text(said, "parameter"), bool(said.get("held")))


async def _payoff(lab: Lab, said: Mapping[str, Any]) -> dict[str, Any]:
    reference = said.get("reference")
    if not isinstance(reference, dict):
        raise InputError(f"reference is {quoted(reference)}; give an object")
    return await lab.payoff(reference)


ACTIONS: Mapping[str, Callable[[Lab, Mapping[str, Any]], Awaitable[dict[str, Any]]]] = {
    "open": lambda lab, said: lab.open(),
    "example": lambda lab, said: lab.take_example(_text(said, "key")),
    "settings": lambda lab, said: lab.set_settings(said),
    "core": lambda lab, said: lab.set_core(_text(said, "core")),
    "rank": lambda lab, said: lab.rank(),
    "cancel": lambda lab, said: lab.cancel(),
    "add": lambda lab, said: lab.add(_text(said, "effect")),
    "remove": lambda lab, said: lab.remove(_text(said, "effect")),
    "unknown": lambda lab, said: lab.add("unknown"),
    "undo": lambda lab, said: lab.undo(),
    "redo": lambda lab, said: lab.redo(),
    "go": lambda lab, said: lab.go(_text(said, "step")),
    "hold": _hold,
    "refit": lambda lab, said: lab.refit(),
    "settle": lambda lab, said: lab.settle(),
    "parameter": _parameter,
    "payoff": _payoff,
}
"""By the name of their path; called in the loop of the server."""
