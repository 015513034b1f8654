"""What was measured: name, symbol and unit of input and output, and sentences that use them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from string import Formatter
from typing import Any

from rdpi_gym.measurement.units import measured_by, ratio, shown_unit
from rdpi_gym.support.errors import InputError, printable
from rdpi_gym.support.fields import Fields
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
"""What is taken where nothing else is said."""


@dataclass(frozen=True)
class Quantities:
    r"""Input and output of a data set.

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
    'The force moves by 3 kN, 2.5 kN/mm, as the\xa0displacement passes 0 mm.'
    >>> Quantities().said("3 µm"), damper.said("Displacement (µm)"), damper.said("V/s")
    ('3 µm', 'Force (kN)', 'mm/s')
    """

    input: Quantity = STANDARD["input"]
    output: Quantity = STANDARD["output"]

    @property
    def are_standard(self) -> bool:
        """Whether they are a voltage in V and a displacement in µm, under these names."""
        return self.input == STANDARD["input"] and self.output == STANDARD["output"]

    @property
    def are_piezo(self) -> bool:
        """Whether they are a voltage in V and a displacement in µm, whatever they are called."""
        return (self.input.unit, self.output.unit) == ("V", "µm")

    @cached_property
    def _words(self) -> dict[str, str]:
        """What stands for each word of the sentences that are made for V and µm."""
        u, y = self.input, self.output
        found = {
            "µm/V": f"{y.unit}/{_divisor(u.unit)}",
            "1/µm": f"1/{_divisor(y.unit)}",
            "1/V": f"1/{_divisor(u.unit)}",
            "µm": y.unit,
            "V": u.unit,
            "u (V)": f"{u.symbol} ({u.unit})",
            "y (µm)": f"{y.symbol} ({y.unit})",
        }
        for old, new in (("voltage", u.name), ("displacement", y.name)):
            found |= {old: new, old.capitalize(): new[:1].upper() + new[1:]}
        return found

    def text(self, template: str, *names: str, **values: object) -> str:
        """Write a text with its numbers in these quantities.

        Parameters
        ----------
        template
            With fields for words, ``{input}`` and ``{output}``, a capital where they begin; for
            units, ``{input_unit}``, ``{output_unit}`` and ``{gain_unit}``; and for what is given,
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
        """What stands for the fields of a template that every text may have."""
        found = {"gain_unit": f"{self.output.unit}/{_divisor(self.input.unit)}"}
        for side in SIDES:
            own: Quantity = getattr(self, side)
            found |= {side: own.name, side.capitalize(): own.name[:1].upper() + own.name[1:]}
            found |= {f"{side}_unit": own.unit, f"{side}_symbol": own.symbol}
        return found

    def said(self, text: str, keep: Iterable[str] = ()) -> str:
        """Turn a sentence, a heading or the caption of an axis into these quantities.

        Parameters
        ----------
        text
            Made for a voltage in V and a displacement in µm.
        keep
            A user's own words in it, which stay: titles, names of records.
        """
        if self.are_standard:
            return text
        own = [re.escape(words) for words in sorted(set(keep), key=len, reverse=True) if words]
        parts = re.split(f"({'|'.join(own)})", text) if own else [text]
        return "".join(p if k % 2 else _WORDS.sub(self._word, p) for k, p in enumerate(parts))

    def _word(self, found: re.Match[str]) -> str:
        before, word = found[1], found[2]
        new = self._words[word]
        # a sentence may come here again inside another one: behind such a blank it is left alone
        return f"{_DONE if before and _WORDS.search(f' {new}') else before}{new}"

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

    def to_dict(self) -> dict[str, dict[str, str]]:
        """Return them as a JSON object."""
        return {"input": dict(vars(self.input)), "output": dict(vars(self.output))}

    @classmethod
    def from_fields(cls, fields: Fields) -> Quantities:
        """Build them from the JSON object.

        Raises
        ------
        InputError
            A text is missing.
        """
        found = [
            Quantity(side.text("name"), side.text("symbol"), side.text("unit"))
            for side in (fields.inner("input"), fields.inner("output"))
        ]
        return cls(found[0], found[1])


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
    sides, found = identification.get("quantities"), dict(STANDARD)
    if isinstance(sides, Mapping):
        for key, standard in STANDARD.items():
            side = sides.get(key)
            texts = [side.get(k) for k in vars(standard)] if isinstance(side, Mapping) else [None]
            if all(isinstance(text, str) for text in texts):
                found[key] = Quantity(*map(str, texts))
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


_DONE = "\N{NO-BREAK SPACE}"
_WORDS = re.compile(
    rf"(?<!{_DONE})( ?)(\bu \(V\)|\by \(µm\)|µm/V\b|1/µm|1/V\b|µm|\bV\b"
    r"|\b[vV]oltage(?=s?\b)|\b[dD]isplacement(?=s?\b))"
)


def _divisor(unit: str) -> str:
    return f"({unit})" if re.search(r"[/·* ]", unit) else unit


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
