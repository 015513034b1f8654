"""The renderer of the diagnosis: statements and notices in words, and the answer of a search in one sentence."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, Literal, TypeVar, cast

from rdpi_gym.diagnosis import texts
from rdpi_gym.diagnosis.notices import Code, Notice, Statement
from rdpi_gym.measurement import Quantities, Quantity
from rdpi_gym.measurement.quantities import SIDES, in_output, unit_template
from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.signals.experiments import standard_protocol
from rdpi_gym.support.words import capital, closed, digits, joined, pm

T = TypeVar("T")
Grade = Literal["found", "likely", "stand-in", ""]
"""Grade of a name: from 90 % on; from 50 %, of it or a rival; one that a free block beats; less likely than not."""
_MISSING: Mapping[Grade, str] = {
    "found": "missing: {}",
    "likely": "probably missing: {}",
    "": "possibly missing: {}",
    "stand-in": "the error falls as with {}, {} the cause",
}
# Fields of results that hold no text for a reader.
_NO_TEXTS = frozenset(["model", "plane", "plant", "quantities", "traces", "views"])
_UNIT_IN_NAME = re.compile(r"(_per)?_(hz|V_s|um_s|s|V|um|rad)$")
# Of the error without an effect, the share that is no improvement.
_NO_BETTER = 0.98
# Sizes of one effect that a sentence states; those of a curve are in the files.
_MOST_SIZES = 4
_TIMES = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))

_PLAIN = Quantities()
# Quantities whose words and units are the fields of a template.
_FIELDS = Quantities(
    *(Quantity(f"{{{side}}}", f"{{{side}_symbol}}", f"{{{side}_unit}}") for side in SIDES)
)


def text_of(found: Notice | Statement, quantities: Quantities = _PLAIN) -> str:
    """Write a notice or a statement in the words and units of a data set."""
    if isinstance(found, Notice):
        return _written(texts.NOTICES[found.code], found, quantities)
    values = dict[str, object]()
    for name, value in found.values.items():
        values[name] = _value(value, quantities)
        if isinstance(value, int):
            values[f"{name}_s"] = "" if value == 1 else "s"
        elif isinstance(value, Statement):
            text = str(values[name]).rstrip(".")
            values[f"{name}_clause"] = text[:1].lower() + text[1:]
            values[f"{name}_sentence"] = capital(text)
    return quantities.text(texts.TEXTS[found.code], **values)


def template(code: str, **values: object) -> str:
    """Write a statement whose words and units are filled in later, by :func:`in_words`."""
    return text_of(Statement(code, values), _FIELDS)


def _value(value: object, quantities: Quantities) -> object:
    """Write a statement, a list of them or of names, or a number with its error; leave all else."""
    if isinstance(value, Statement):
        return text_of(value, quantities)
    if isinstance(value, list):
        return "; ".join(str(_value(each, quantities)) for each in value)
    if isinstance(value, tuple):
        if len(value) == 2 and not any(isinstance(each, str | Statement) for each in value):
            return pm(*value)
        return joined([str(_value(each, quantities)) for each in value])
    return value


def notice_of(text: str) -> Notice | None:
    """Return the notice that has a code, or this very text without names and numbers; else None."""
    known = {template: code for code, template in texts.NOTICES.items()}
    known |= {code.value: code for code in Code}
    code = known.get(text)
    return None if code is None or "{" in texts.NOTICES[code] else Notice(code)


def request_of(notice: Notice) -> str:
    """Write what a reservation asks for without its reason; any other notice whole."""
    template, *_ = texts.REQUESTS.get(notice.code, (texts.NOTICES[notice.code],))
    return _written(template, notice, _PLAIN)


def _written(template: str, notice: Notice, quantities: Quantities) -> str:
    values: dict[str, object] = {f"n{i}": number for i, number in enumerate(notice.numbers)}
    values["others"] = joined(notice.names[1:])
    if notice.code is Code.STAMPS_UNEVEN:
        values["us"] = 1e6 * notice.numbers[0]
    elif notice.code is Code.UNRELATED:
        values["percent"] = 100.0 * notice.numbers[0]
    elif notice.code is Code.EFFECTS_APART:
        slowness = (*notice.numbers, 1.0)[0]
        protocol = standard_protocol(0.0, 1.0, 1.0, slowness=slowness)
        chosen = {experiment.name: experiment for experiment in protocol}[notice.names[0]]
        values |= {
            "slowed": "" if slowness == 1.0 else f", slowed {slowness:.0f}-fold",
            "purpose": chosen.purpose,
            "seconds": chosen.duration_s,
            "rate_hz": 1 / chosen.ts_s,
        }
    return quantities.text(template, *notice.names, **values)


def sized(effect: Effect) -> str:
    """Name an effect with its fitted parameters, as a template."""
    places, sizes = [], []
    for parameter in effect.parameters:
        value = effect.values[parameter.name]
        if parameter.fixed or parameter.unit == "rad":
            continue
        if parameter.unit == "Hz":
            places.append(f" at {digits(value, 3)} Hz")
            continue
        label = _UNIT_IN_NAME.sub("", parameter.name).replace("_", " ")
        unit = "" if parameter.unit == "1" else f" {unit_template(parameter.unit)}"
        quantity = _time(value) if parameter.unit == "s" else f"{_figures(value)}{unit}"
        sizes.append(f"{label} {quantity}")
    said = f" ({', '.join(sizes)})" if 0 < len(sizes) <= _MOST_SIZES else ""
    return f"{effect.full_name()}{''.join(places)}{said}"


def headline(
    asked: str,
    effects: Mapping[str, Grade],
    errors_um: tuple[float, float],
    noise_um: float,
    verdict: str,
    undecided: str | None,
    request: str | None,
    nothing: Grade,
) -> str:
    """Answer a search, as a template.

    `effects` are names with their grades and `nothing` is that of none;
    `request` is what a reservation asks for.
    """
    before, after = (in_output(error) for error in errors_um)
    noise = f"noise {in_output(noise_um)}"
    rest = "" if request is None else f" {closed(request)}"
    if not effects:
        numbers = f"Error {after}, {noise}.{rest}"
        if undecided is not None:
            return f"Undecided. {undecided} {numbers}"
        if verdict == "no missing effect":
            word = {"found": "", "likely": "probably "}.get(nothing, "possibly ")
            return capital(f"{word}nothing is missing. {numbers}")
        return f"Unexplained: no effect of the catalogue is found. {numbers}"
    numbers = f"Error {before.removesuffix(' {output_unit}')} to {after}, {noise}.{rest}"
    verb = {"addition": "Added", "removal": "Removed"}.get(asked)
    names = f"{verb}: {joined(list(effects))}" if verb else _missing(effects)
    if undecided is not None:
        return f"{names}. Undecided whether it is there. {undecided} {numbers}"
    if asked == "addition" and errors_um[1] > _NO_BETTER * errors_um[0]:
        return f"{names}, which does not improve held-out error. {numbers}"
    if verdict != "unexplained" or asked == "removal":
        return f"{names}. {numbers}"
    if asked == "addition":
        return f"{names}, which leaves part of the error unexplained. {numbers}"
    return f"{names}, and something that no effect of the catalogue explains. {numbers}"


def _missing(effects: Mapping[str, Grade]) -> str:
    """Name what is missing, by grade, the surest first."""
    groups = {text: [n for n, own in effects.items() if own == g] for g, text in _MISSING.items()}
    said = [
        text.format(joined(names), "which is not" if len(names) == 1 else "none of which is")
        for text, names in groups.items()
        if names
    ]
    return capital("; ".join(said))


def grade_of(probability: float) -> Grade:
    """Return the grade of a probability (0 to 1)."""
    from rdpi_gym.diagnosis.beam.constants import FOUND, LIKELY  # they read these words

    if probability < LIKELY:
        return ""
    return "found" if probability >= FOUND else "likely"


def _figures(value: float) -> str:
    """Write a parameter: an exponent only where the number is very large or very small."""
    return digits(value, 3) if 1e-4 <= abs(value) < 1e6 or value == 0.0 else f"{value:.3g}"


def _time(value_s: float) -> str:
    scale, unit = next(((s, u) for s, u in _TIMES if abs(value_s) >= s), _TIMES[-1])
    return f"{digits(value_s / scale, 3)} {unit}"


def in_words(result: T, quantities: Quantities) -> T:
    """Return a result with the words and units of a data set in its texts, which are templates."""
    return cast("T", _filled(result, quantities))


def _filled(value: Any, quantities: Quantities) -> Any:
    if isinstance(value, str):
        return quantities.fill(value)
    if isinstance(value, tuple | list):
        return type(value)([_filled(each, quantities) for each in value])
    if isinstance(value, Mapping):
        return {key: _filled(each, quantities) for key, each in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        own = {f.name: getattr(value, f.name) for f in fields(value) if f.name not in _NO_TEXTS}
        found = {name: _filled(each, quantities) for name, each in own.items()}
        return value if found == own else replace(value, **found)
    return value
