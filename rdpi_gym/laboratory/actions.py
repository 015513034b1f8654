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


def _text(body: Mapping[str, Any], key: str) -> str:
    value = body.get(key)
    if not isinstance(value, str):
        raise InputError(f"{key} is {quoted(value)}; give a text")
    return value


def _number(body: Mapping[str, Any], key: str) -> float:
    value = body.get(key)
    try:
        found = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{key} is {quoted(value)}; give a number") from None
    if found != found or abs(found) == float("inf"):
        raise InputError(f"{key} is {quoted(value)}; give a finite number")
    return found


def _optional(body: Mapping[str, Any], key: str) -> float | None:
    return None if body.get(key) in (None, "") else _number(body, key)


def _preview(lab: Lab, query: Mapping[str, str]) -> Any:
    session = lab.session
    return preview(session.data_folder, session.files, _text(query, "file"), query.get("separator"))


def _trace(lab: Lab, query: Mapping[str, str]) -> Any:
    data = lab.session.need_data()
    record = views.record_named(data, _text(query, "record"))
    plant = lab.plant_shown(query.get("step") or None)
    effect = query.get("effect")
    other = lab.plant_with(effect, query.get("step") or None) if effect else None
    part = views.stretch(record, _optional(query, "from_s"), _optional(query, "to_s"))
    points = int(_optional(query, "points") or views.POINTS)
    return views.trace(
        record,
        None if plant is None else lab.displacement(plant, record.name),
        None if other is None else lab.displacement(other, record.name),
        part,
        min(max(points, 100), 20_000),
    )


def _views(lab: Lab, query: Mapping[str, str]) -> Any:
    record, model_um = _modelled(lab, query)
    return views.residual_views(record, model_um, lab.noise_um())


def _brush(lab: Lab, query: Mapping[str, str]) -> Any:
    record, model_um = _modelled(lab, query)
    ends = (_optional(query, "from_s"), _optional(query, "to_s"))
    return views.brushed(record, model_um, query.get("by") or "time", *ends)


def _modelled(lab: Lab, query: Mapping[str, str]) -> tuple[Record, Array]:
    """Return a record, and what the model of a step makes of it (µm)."""
    record = views.record_named(lab.session.need_data(), _text(query, "record"))
    plant = lab.plant_shown(query.get("step") or None)
    if plant is None:
        raise InputError("there is no model yet; wait for the base model")
    return record, lab.displacement(plant, record.name)


def take(lab: Lab, name: str, query: Mapping[str, str]) -> tuple[str, str]:
    """Return media type and content of a file to download."""
    rate_hz = None if query.get("rate_hz") is None else _number(query, "rate_hz")
    return download(lab.session, name, rate_hz)


QUESTIONS: Mapping[str, Callable[[Lab, Mapping[str, str]], Any]] = {
    "examples": lambda lab, query: [example.to_dict() for example in examples()],
    "preview": _preview,
    "trace": _trace,
    "views": _views,
    "brush": _brush,
}
"""By the name of their path; answered in threads."""


async def _parameter(lab: Lab, body: Mapping[str, Any]) -> dict[str, Any]:
    effect = body.get("effect") or ""
    name, value = _text(body, "parameter"), _number(body, "value")
    if not isinstance(effect, str):
        raise InputError(f"effect is {quoted(effect)}; give a text")
    if body.get("commit"):
        return await lab.set_parameter(effect, name, value)
    plant = lab.moved(effect, name, value)

    def answer() -> dict[str, Any]:
        response = lab.respond(plant, keep=False)
        found: dict[str, Any] = {"errors": views.errors_of(response.errors), "trace": None}
        if body.get("record"):
            record = views.record_named(lab.session.need_data(), _text(body, "record"))
            part = views.stretch(record, _optional(body, "from_s"), _optional(body, "to_s"))
            model_um = response.model_um[record.name]
            found["trace"] = views.trace(record, model_um, None, part)
        return found

    return await asyncio.to_thread(answer)


async def _hold(lab: Lab, body: Mapping[str, Any]) -> dict[str, Any]:
    effect = body.get("effect") or ""
    return await lab.hold(str(effect), _text(body, "parameter"), bool(body.get("held")))


async def _payoff(lab: Lab, body: Mapping[str, Any]) -> dict[str, Any]:
    reference = body.get("reference")
    if not isinstance(reference, dict):
        raise InputError(f"reference is {quoted(reference)}; give an object")
    return await lab.payoff(reference)


ACTIONS: Mapping[str, Callable[[Lab, Mapping[str, Any]], Awaitable[dict[str, Any]]]] = {
    "open": lambda lab, body: lab.open(),
    "example": lambda lab, body: lab.take_example(_text(body, "key")),
    "settings": lambda lab, body: lab.set_settings(body),
    "core": lambda lab, body: lab.set_core(_text(body, "core")),
    "rank": lambda lab, body: lab.rank(),
    "cancel": lambda lab, body: lab.cancel(),
    "add": lambda lab, body: lab.add(_text(body, "effect")),
    "remove": lambda lab, body: lab.remove(_text(body, "effect")),
    "unknown": lambda lab, body: lab.add("unknown"),
    "undo": lambda lab, body: lab.undo(),
    "redo": lambda lab, body: lab.redo(),
    "go": lambda lab, body: lab.go(_text(body, "step")),
    "hold": _hold,
    "refit": lambda lab, body: lab.refit(),
    "settle": lambda lab, body: lab.settle(),
    "parameter": _parameter,
    "payoff": _payoff,
}
"""By the name of their path; called in the loop of the server."""
