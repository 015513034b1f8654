"""The answer of a search in one sentence: which effect, how large, error before and after."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.support.words import closed, digits, joined, micrometres

_UNIT_IN_NAME = re.compile(r"(_per)?_(hz|V_s|um_s|s|V|um|rad)$")
# Of the error without an effect, the share that is no improvement.
_NO_BETTER = 0.98
_TIMES = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def sized(effect: Effect) -> str:
    """Name an effect with its fitted parameters."""
    places, sizes = [], []
    for parameter in effect.parameters:
        value = effect.values[parameter.name]
        if parameter.fixed or parameter.unit == "rad":
            continue
        if parameter.unit == "Hz":
            places.append(f" at {digits(value, 3)} Hz")
            continue
        label = _UNIT_IN_NAME.sub("", parameter.name).replace("_", " ")
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        quantity = _time(value) if parameter.unit == "s" else f"{_figures(value)}{unit}"
        sizes.append(f"{label} {quantity}")
    return effect.full_name() + "".join(places) + (f" ({', '.join(sizes)})" if sizes else "")


def headline(
    asked: str,
    effects: Sequence[str],
    errors_um: tuple[float, float],
    noise_um: float,
    verdict: str,
    undecided: str | None,
    sampling: str | None,
) -> str:
    """Answer a search."""
    before, after = (micrometres(error) for error in errors_um)
    noise = f"noise {micrometres(noise_um)}"
    rest = "" if sampling is None else f" {closed(sampling.partition(':')[0])}"
    if not effects:
        numbers = f"Error {after}, {noise}.{rest}"
        if undecided is not None:
            return f"Undecided. {undecided} {numbers}"
        if verdict == "no missing effect":
            return f"Nothing is missing. {numbers}"
        return f"Unexplained: no effect of the catalogue improves held-out error. {numbers}"
    verb = {"addition": "Added", "removal": "Removed"}.get(asked, "Missing")
    numbers = f"Error {before.removesuffix(' µm')} to {after}, {noise}.{rest}"
    names = joined(effects)
    if undecided is not None:
        return f"{verb}: {names}. Undecided whether it is there. {undecided} {numbers}"
    if asked == "addition" and errors_um[1] > _NO_BETTER * errors_um[0]:
        return f"{verb}: {names}, which does not improve held-out error. {numbers}"
    if verdict != "unexplained" or asked == "removal":
        return f"{verb}: {names}. {numbers}"
    if asked == "addition":
        return f"{verb}: {names}, which leaves part of the error unexplained. {numbers}"
    return f"{verb}: {names}, and something that no effect of the catalogue explains. {numbers}"


def _figures(value: float) -> str:
    """Write a parameter: an exponent only where the number is very large or very small."""
    return digits(value, 3) if 1e-4 <= abs(value) < 1e6 or value == 0.0 else f"{value:.3g}"


def _time(value_s: float) -> str:
    scale, unit = next(((s, u) for s, u in _TIMES if abs(value_s) >= s), _TIMES[-1])
    return f"{digits(value_s / scale, 3)} {unit}"
