"""Units that a column may be written in: what they measure, and how to turn one into another."""

from __future__ import annotations

import re

_PREFIXES = {
    "": 1.0, "k": 1e3, "M": 1e6, "G": 1e9, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9, "p": 1e-12,
}  # fmt: skip
_BASES = {
    "V": "voltage",
    "m": "displacement",
    "N": "force",
    "A": "current",
    "Pa": "pressure",
    "N·m": "torque",
    "rad": "angle",
    "m/s": "velocity",
    "m/s²": "acceleration",
    "A/m": "magnetic field",
}
# Those without prefixes; nothing else is turned into them.
_ALONE = {
    "deg": "angle", "°": "angle", "bar": "pressure", "psi": "pressure", "lbf": "force",
    "kip": "force", "kgf": "force", "in": "displacement", "inch": "", "K": "temperature",
    "%": "share",
}  # fmt: skip
_SPELLED = {"Nm": "N·m", "N*m": "N·m", "N m": "N·m", "m/s^2": "m/s²", "m/s2": "m/s²"}
_BRACKETS = re.compile(r"(.*\S)\s*[\[(]\s*([^\[\]()]+?)\s*[\])]")
_SUFFIX = re.compile(r"(.*[^_/\s])(?:_|\s*/\s*|\s+)([A-Za-zµμ%]+)")
# Without brackets these are as often a word's beginning: y_m may be what was measured.
_NO_SUFFIXES = ("m", "A", "K", "in", "p", "n")


def plain_unit(unit: str) -> str:
    """Write a unit in one way: u for micro, a dot between units."""
    text = unit.strip().replace("µ", "u").replace("μ", "u")  # micro sign and Greek mu
    for spelled, right in _SPELLED.items():
        if text.endswith(spelled) and text.removesuffix(spelled) in _PREFIXES:
            return text.removesuffix(spelled) + right
    return text


def shown_unit(unit: str) -> str:
    """Write a unit as a reader expects it."""
    plain = plain_unit(unit)
    base, _ = _parted(plain)
    return f"µ{plain[1:]}" if base != plain and plain.startswith("u") else plain


def _parted(plain: str) -> tuple[str, float]:
    """Part a unit into its base and the factor to it; an unknown one is its own base."""
    if plain in _ALONE or plain in _BASES:
        return plain, 1.0
    for base in _BASES:
        prefix = plain.removesuffix(base)
        # a hundredth is used with metres alone
        if prefix != plain and prefix in _PREFIXES and (prefix != "c" or base == "m"):
            return base, _PREFIXES[prefix]
    return plain, 1.0


def measured_by(unit: str) -> str:
    """Name the quantity that a unit measures; nothing where the unit is not known."""
    base, _ = _parted(plain_unit(unit))
    return _BASES.get(base, _ALONE.get(base, ""))


def ratio(unit: str, shown: str) -> float | None:
    """Give the factor from one unit to another; None where they measure different quantities."""
    one, other = plain_unit(unit), plain_unit(shown)
    if one == other:
        return 1.0
    base, factor = _parted(one)
    shown_base, shown_factor = _parted(other)
    return float(f"{factor / shown_factor:.12g}") if base == shown_base else None


def split_name(name: str) -> tuple[str, str]:
    """Split the name of a column into what it names and its unit, where it carries one."""
    for pattern, refused in ((_BRACKETS, ()), (_SUFFIX, _NO_SUFFIXES)):
        found = pattern.fullmatch(name.strip())
        if found and found[2] not in refused and (measured_by(found[2]) or found[2] in _OTHERS):
            return found[1].strip(), found[2]
    return name, ""


def is_unit(cell: str) -> bool:
    """Whether a cell below a name holds its unit, in brackets or without."""
    bare = cell.strip(" []()")
    return bool(measured_by(bare)) or bare in _OTHERS


# Units of time and temperature, which have columns of their own.
_OTHERS = ("s", "ms", "us", "µs", "μs", "C", "degC", "°C")
