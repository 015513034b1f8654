"""Declarations of an effect as a JSON object and as a Markdown page."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterable
from typing import Any

from rdpi_gym.plant.effects.base import Effect, Parameter, Slot
from rdpi_gym.support.markdown import table

PLACES: dict[Slot, str] = {
    "input": "on the command, in front of the plays",
    "rate": "on the rate that sets the plays' thresholds",
    "memory": "in the plays' initial state",
    "hysteresis": "on the hysteretic displacement",
    "output": "on the path behind the hysteresis",
}
"""Slots in words."""


def summary(kind: type[Effect]) -> str:
    """First sentence of an effect's description."""
    return (inspect.getdoc(kind) or "").partition("\n\n")[0].replace("\n", " ")


def describe(kind: type[Effect]) -> dict[str, Any]:
    """Return what an effect declares as a JSON object."""
    texts = ("cause", "hardware", "magnitude", "signature", "experiment", "remedy")
    return {
        "effect": kind.name,
        "summary": summary(kind),
        "slot": kind.slot,
        "order": kind.order,
        "equation": kind.equation,
        "parameters": _parameters(kind),
        "forms": [
            {
                "form": form.form,
                "summary": summary(form),
                "equation": form.equation,
                "parameters": _parameters(form),
            }
            for form in kind.forms
        ],
        **{text: getattr(kind, text) for text in texts},
        "mistaken_for": list(kind.mistaken_for),
        "source": kind.source,
    }


def _parameters(kind: type[Effect]) -> list[dict[str, Any]]:
    defaults = kind().values
    return [
        {"name": p.name, "unit": p.unit, "default": defaults[p.name]}
        | {
            key: getattr(p, key)
            for key in ("low", "high", "typical", "neutral", "fixed", "meaning")
        }
        | {"typical": list(p.typical)}
        for p in kind.parameters
    ]


def typical(parameter: Parameter) -> str:
    """Typical range of a parameter in words, with its unit."""
    low, high = parameter.typical
    values = f"{low:.6g}" if math.isclose(low, high) else f"{low:.6g} to {high:.6g}"
    return values if parameter.unit == "1" else f"{values} {parameter.unit}"


def paragraphs(kind: type[Effect], quote: str = "") -> dict[str, str]:
    """Return what an effect's file says in sentences, by headings; what it leaves out is missing."""
    mistaken = ", ".join(f"{quote}{name}{quote}" for name in kind.mistaken_for)
    said = {
        "Cause": kind.cause,
        "Met on": kind.hardware,
        "Usual size": kind.magnitude,
        "Trace in a residual": kind.signature,
        "Best experiment": kind.experiment,
        "Easily mistaken for": f"{mistaken or 'nothing in the catalogue'}.",
        "What to do": kind.remedy,
        "Source": kind.source,
    }
    return {heading: text for heading, text in said.items() if text}


def further_forms(kind: type[Effect], quote: str = "") -> list[str]:
    """Return a line for each further form of an effect: what it is, its equation and parameters."""
    lines = []
    for form in kind.forms:
        named = ", ".join(f"{quote}{p.name}{quote}" for p in form.parameters)
        lines.append(
            f"{form.form}: {summary(form)} {quote}{form.equation}{quote} (parameters {named})"
        )
    return lines


def page(kind: type[Effect], level: int = 2) -> str:
    """Describe an effect on a page (Markdown) made from what its file declares."""
    head = ["parameter", "meaning", "unit", "default", "typical", "bounds", "remark"]
    rows = [
        [
            f"`{p.name}`", p.meaning, p.unit, f"{kind().values[p.name]:.4g}", typical(p),
            f"{p.low:.6g} to {p.high:.6g}", _role(p),
        ]
        for p in kind.parameters
    ]  # fmt: skip
    text = f"""{"#" * level} {kind.name}

{summary(kind)} It acts {PLACES[kind.slot]}.

    {kind.equation}

{table(head, rows, rule="tight")}

"""
    if kind.forms:
        listed = "\n".join(f"- {line}" for line in further_forms(kind, quote="`"))
        text += f"**Further forms**, which a search tries where the simplest leaves its own trace:\n\n{listed}\n\n"
    return text + "\n".join(f"**{h}:** {t}\n" for h, t in paragraphs(kind, quote="`").items())


def pages(kinds: Iterable[type[Effect]]) -> str:
    """Describe effects one after another on pages (Markdown)."""
    intro = "Every effect is one file of `rdpi_gym/plant/effects/`; this text is made from them."
    return "\n".join(["# Effects", "", intro, "", *(page(kind) for kind in kinds)])


def _role(parameter: Parameter) -> str:
    if parameter.fixed:
        return "chosen, not fitted"
    return "" if parameter.neutral is None else f"no effect at {parameter.neutral:g}"
