"""Measured quantities: name, symbol and unit of input and output, and sentences that use them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from string import Formatter
from typing import Any, Self

from rdpi_gym.measurement.units import measured_by, ratio, shown_unit
from rdpi_gym.support.documents import PLAIN, Document, at
from rdpi_gym.support.errors import InputError, printable
from rdpi_gym.support.words import digits, quoted

_LONGEST = 30  # characters of a header's name that serves as the name of a quantity
SIDES: Mapping[str, str] = {"input": "u", "output": "y"}
"""The quantities by the column that each is in."""


@dataclass(frozen=True)
class Quantity:
    """One quantity of a record.

    Parameters
    ----------
    name
        In words: ``force``.
    symbol
        What stands in formulas and on axes: ``F``.
    unit
        Of its numbers: ``kN``.
    """

    name: str
    symbol: str
    unit: str


STANDARD: Mapping[str, Quantity] = {
    "input": Quantity("voltage", "u", "V"),
    "output": Quantity("displacement", "y", "µm"),
}
"""Default quantities."""


@dataclass(frozen=True)
class Quantities(Document):
    """Input and output of a data set.

    The records and models keep the names of their fields, ``u_V`` and ``y_um``, whatever the numbers
    in them are; what is printed uses the quantities.

    Parameters
    ----------
    input, output
        By default the voltage u in V and the displacement y in µm.

    Examples
    --------
    >>> damper = Quantities(Quantity("displacement", "x", "mm"), Quantity("force", "F", "kN"))
    >>> damper.said("The displacement moves by 3 µm, 2.5 µm/V, as the voltage passes 0 V.")
    'The force moves by 3 kN, 2.5 kN/mm, as the displacement passes 0 mm.'
    >>> Quantities().said("3 µm"), damper.said("Displacement (µm)"), damper.unit("V/s")
    ('3 µm', 'Force (kN)', 'mm/s')
    """

    input: Quantity = STANDARD["input"]
    output: Quantity = STANDARD["output"]

    @classmethod
    def from_dict(cls, document: Any, source: str = "document") -> Self:
        """Build from the object of :meth:`to_dict`, which has both."""
        whole = PLAIN.read(Mapping[str, Any], document, source)
        return cls(*(PLAIN.read(Quantity, whole.get(side), at(source, side)) for side in SIDES))

    @property
    def are_standard(self) -> bool:
        """Whether they are a voltage in V and a displacement in µm, under these names."""
        return self.input == STANDARD["input"] and self.output == STANDARD["output"]

    @property
    def are_piezo(self) -> bool:
        """Whether they are a voltage in V and a displacement in µm, whatever they are called."""
        return (self.input.unit, self.output.unit) == ("V", "µm")

    def text(self, template: str, *names: str, **values: object) -> str:
        """Write a text with its numbers in these quantities.

        Parameters
        ----------
        template
            With fields for words, ``{input}`` and ``{output}``, a capital where they begin; for
            units, ``{input_unit}`` and ``{output_unit}``; and for what is given,
            with a kind: ``{x:output}`` and ``{x:input}`` are numbers with the unit, ``{x:~2}`` is
            one of two digits.
        names, values
            What is given; it is written as it is, whatever stands in it.

        Examples
        --------
        >>> damper = Quantities(Quantity("displacement", "x", "mm"), Quantity("force", "F", "kN"))
        >>> damper.text("{Output} of {0}: {peak:output} at {u:input}", "V", peak=2.5, u=3.0)
        'Force of V: 2.5 kN at 3 mm'
        """
        return self._writer.vformat(template, names, {**self._fields, **values})

    @cached_property
    def _writer(self) -> _Writer:
        return _Writer({"output": self.output.unit, "input": self.input.unit})

    @cached_property
    def _fields(self) -> dict[str, str]:
        """Values of the fields that every template may have."""
        found: dict[str, str] = {}
        for side in SIDES:
            own: Quantity = getattr(self, side)
            found |= {side: own.name, side.capitalize(): own.name[:1].upper() + own.name[1:]}
            found |= {f"{side}_unit": own.unit, f"{side}_symbol": own.symbol}
            found[f"{side}_divisor"] = _divisor(own.unit)
        return found

    def fill(self, template: str) -> str:
        """Fill in the words and units of a text, and leave all else in it as it is.

        Parameters
        ----------
        template
            A text with the fields that :meth:`text` knows, as ``{output}`` and ``{input_unit}``;
            what a user has named may stand in it.

        Examples
        --------
        >>> damper = Quantities(Quantity("displacement", "x", "mm"), Quantity("force", "F", "kN"))
        >>> damper.fill("{Output} ({output_unit}) of {V} over %{x:.4g} {input_unit}: V-shaped")
        'Force (kN) of {V} over %{x:.4g} mm: V-shaped'
        """
        if "put" in template:
            for field, text in self._fields.items():
                template = template.replace(f"{{{field}}}", text)
        return template

    def unit(self, symbol: str) -> str:
        """Return what a unit in V and µm is in these quantities.

        Examples
        --------
        >>> amplifier = Quantities(Quantity("current", "I", "A"), Quantity("force", "F", "N/m"))
        >>> [amplifier.unit(symbol) for symbol in ("µm/V²", "1/µm", "V/s", "Hz")]
        ['N/m/A²', '1/(N/m)', 'A/s', 'Hz']
        """
        return self.fill(unit_template(symbol))

    def said(self, text: str, keep: Iterable[str] = ()) -> str:
        """Turn a text that was made for a voltage in V and a displacement in µm.

        It is for rooms that write no templates; a template is filled by :meth:`text` or :meth:`fill`.

        Parameters
        ----------
        text
            Made for V and µm.
        keep
            A user's own words in it, which stay: titles, names of records.
        """
        if self.are_standard:
            return text
        own = [re.escape(words) for words in sorted(set(keep), key=len, reverse=True) if words]
        parts = re.split(f"({'|'.join(own)})", text) if own else [text]
        return "".join(p if k % 2 else self.fill(template_of(p)) for k, p in enumerate(parts))

    @property
    def words(self) -> str:
        """From what to what.

        Examples
        --------
        >>> Quantities().words
        'from voltage u (V) to displacement y (µm)'
        """
        parts = (f"{q.name} {q.symbol} ({q.unit})" for q in (self.input, self.output))
        return f"from {' to '.join(parts)}"

    @property
    def by_column(self) -> dict[str, str]:
        """Unit of each column that holds one of them."""
        return {"u": self.input.unit, "y": self.output.unit, "reference": self.output.unit}

    @property
    def units(self) -> dict[str, str]:
        """Units of what results hold, as the JSON files name them."""
        return {"error": self.output.unit, "command": self.input.unit}


def stated_quantities(identification: Mapping[str, Any]) -> Quantities:
    """Return what a plant's input and output are, as the fit that made it has stated.

    Parameters
    ----------
    identification
        Of the plant.

    Examples
    --------
    >>> force = Quantities(output=Quantity("force", "F", "kN"))
    >>> stated_quantities({"quantities": force.to_dict()}) == force
    True
    >>> stated_quantities({}).are_standard
    True
    """
    stated = identification.get("quantities")
    sides = stated if isinstance(stated, Mapping) else {}
    found = dict(STANDARD)
    for side in found:
        with suppress(InputError):
            found[side] = PLAIN.read(Quantity, sides.get(side), side)
    return Quantities(found["input"], found["output"])


class _Writer(Formatter):
    """Writes numbers as a kind asks, with a unit where it is the name of a side."""

    def __init__(self, units: Mapping[str, str]) -> None:
        self._units = units

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec in self._units:
            finite = math.isfinite(value)
            return f"{digits(value, 3)} {self._units[format_spec]}" if finite else "no finite error"
        if format_spec.startswith("~"):
            return digits(value, int(format_spec[1:]))
        return str(super().format_field(value, format_spec))


_BASES = {"V": "input", "µm": "output"}
_NAMES = {"voltage": "{input}", "Voltage": "{Input}", "displacement": "{output}"}
_NAMES |= {"Displacement": "{Output}", "u (V)": "{input_symbol} ({input_unit})"}
_NAMES |= {"y (µm)": "{output_symbol} ({output_unit})"}
# "V-shaped" and "voltage-driven" are neither a unit nor a quantity.
_WORDS = re.compile(
    r"\bu \(V\)|\by \(µm\)|\b(?:[vV]oltage|[dD]isplacement)(?=s?\b(?!-))"
    r"|(?<![\w/])(?:µm|V|1(?=/(?:µm|V)))[²³]?(?:/(?:µm|V|s)[²³]?)?(?![\w²³-])"
)


def unit_template(symbol: str) -> str:
    """Return the template of a unit in V and µm.

    Examples
    --------
    >>> unit_template("µm/V²"), unit_template("Hz")
    ('{output_unit}/{input_divisor}²', 'Hz')
    """
    over, slash, under = symbol.partition("/")
    return f"{_of_base(over, 'unit')}{slash}{_of_base(under, 'divisor')}"


def _of_base(symbol: str, place: str) -> str:
    """Return the template of one factor of a unit."""
    base = symbol.rstrip("²³")
    return f"{{{_BASES[base]}_{place}}}{symbol[len(base) :]}" if base in _BASES else symbol


def template_of(text: str) -> str:
    """Return a text of a room that knows V and µm alone as a template.

    Examples
    --------
    >>> template_of("A V-shaped loop of the displacement (µm/V²), voltage-driven, at 3 V")
    'A V-shaped loop of the {output} ({output_unit}/{input_divisor}²), voltage-driven, at 3 {input_unit}'
    """
    return _WORDS.sub(lambda found: _NAMES.get(found[0]) or unit_template(found[0]), text)


def _divisor(unit: str) -> str:
    return f"({unit})" if re.search(r"[/·* ]", unit) else unit


def in_output(value: float) -> str:
    """Write a number of the output as a template: three significant digits with the unit."""
    return f"{digits(value, 3)} {{output_unit}}" if math.isfinite(value) else "no finite error"


def quantities_of(
    said: Mapping[str, Mapping[str, str]],
    units: Mapping[str, str],
    names: Mapping[str, str],
    where: str,
) -> Quantities:
    """Settle what was measured."""
    found = {
        side: _quantity(side, said.get(side, {}), units.get(column), names.get(column, ""), where)
        for side, column in SIDES.items()
    }
    return Quantities(found["input"], found["output"])


def _quantity(
    side: str, said: Mapping[str, str], unit: str | None, name: str, where: str
) -> Quantity:
    standard = STANDARD[side]
    is_standard = unit is None or ratio(unit, standard.unit) is not None
    shown = said.get("unit") or (standard.unit if is_standard else unit) or standard.unit
    if said.get("name", standard.name) != standard.name and unit is None and "unit" not in said:
        raise InputError(
            f"{where}: the {side}, {quoted(said['name'])}, has no unit; give it one, as in "
            f'{side} = {{ name = "force", unit = "kN" }}'
        )
    if unit is not None and ratio(unit, shown) is None:
        raise InputError(
            f"{where}: the {side} is shown in {quoted(shown)} while column {SIDES[side]} is in "
            f"{quoted(unit)}, and one is not turned into the other; give both the same unit"
        )
    own = standard.name if ratio(shown, standard.unit) is not None else measured_by(shown)
    # what a file calls a column in another unit than ours is a better name than a guess by its unit
    is_word = 2 < len(name) <= _LONGEST and printable(name) == name
    word = name if is_word and not is_standard else ""
    named = said.get("name") or word or own
    if not named:
        raise InputError(
            f"{where}: the {side} in {quoted(shown)} has no name; give it one, as in "
            f'{side} = {{ name = "force", unit = "kN" }}'
        )
    letter = name if 0 < len(name) <= 2 and name.isalnum() and not is_standard else standard.symbol
    return Quantity(named, said.get("symbol") or letter, shown_unit(shown))
