"""Operators and functions of the mathematics: on known numbers as Python has them, else as C text."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rdpi_gym.firmware.program import Kind, Known, Number, literal
from rdpi_gym.support.errors import InputError

BINARY: Mapping[str, tuple[str, Callable[[Any, Any], Any]]] = {
    "Add": ("+", operator.add),
    "Sub": ("-", operator.sub),
    "Mult": ("*", operator.mul),
    "Div": ("/", operator.truediv),
    "FloorDiv": ("//", operator.floordiv),
    "Mod": ("%", operator.mod),
    "Pow": ("**", operator.pow),
    "LShift": ("<<", operator.lshift),
    "RShift": (">>", operator.rshift),
}
"""Operators by the name of their node."""

COMPARISONS: Mapping[str, tuple[str, Callable[[Any, Any], bool]]] = {
    "Lt": ("<", operator.lt),
    "LtE": ("<=", operator.le),
    "Gt": (">", operator.gt),
    "GtE": (">=", operator.ge),
    "Eq": ("==", operator.eq),
    "NotEq": ("!=", operator.ne),
}
"""Comparisons by the name of their node."""

MATHEMATICS: Mapping[str, Callable[[float], float]] = {
    "exp": math.exp,
    "expm1": math.expm1,
    "log": math.log,
    "log1p": math.log1p,
    "sin": math.sin,
    "cos": math.cos,
    "tanh": math.tanh,
    "sqrt": math.sqrt,
    "floor": math.floor,
    "ceil": math.ceil,
}
"""Functions of one number that C has under the same name."""


@dataclass(frozen=True)
class Entry(Number):
    """A number that stands in a table: read there, and known as the code is written."""

    value: float = 0.0


@dataclass(frozen=True)
class Constant(Known):
    """A known argument of a kernel: the text has its name where it stands itself."""

    name: str = ""


Scalar = Known | Number


def is_simple(text: str) -> bool:
    """Whether an expression may be written twice: a name, a literal or one element."""
    return re.fullmatch(r"-?[\w.>-]*\w(\[[\w ]+\])?|RDPI_C\([-\w.+]+\)", text) is not None


def bare(text: str) -> str:
    """Return an expression without the parentheses that hold all of it."""
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depth = 0
    for place, sign in enumerate(text):
        depth += (sign == "(") - (sign == ")")
        if depth == 0 and place < len(text) - 1:
            return text
    return text[1:-1]


def kind_of(value: Scalar) -> Kind:
    """Return the type that a scalar has in C."""
    if isinstance(value, Number):
        return value.kind
    if isinstance(value.value, bool):
        return "bool"
    return "int" if isinstance(value.value, int) else "real"


def text_of(value: Scalar, kind: Kind) -> str:
    """Return a scalar as an expression of a type."""
    if isinstance(value, Known):
        number = value.value
        if not isinstance(number, bool | int | float):
            raise InputError(f"{number!r} is no number")
        if isinstance(value, Constant) and kind == "real":
            return value.name
        return literal(float(number)) if kind == "real" else str(int(number))
    if kind == value.kind or {kind, value.kind} <= {"int", "bool"}:
        return value.text
    if kind == "real":
        return (
            f"(rdpi_real){value.text}"
            if is_simple(value.text)
            else f"(rdpi_real)({bare(value.text)})"
        )
    raise InputError(f"a number with a fraction where a whole one has to stand: {value.text}")


def joined(*kinds: Kind) -> Kind:
    """Return the type that holds all of some types."""
    return "real" if "real" in kinds else "int" if "int" in kinds else "bool"


class Arithmetic:
    """Writes expressions; remembers which functions of the mathematics they call."""

    def __init__(self) -> None:
        self.mathematics: set[str] = set()

    def binary(self, name: str, left: Scalar, right: Scalar) -> Scalar:
        """Return the value of an operator, by the name of its node in Python's syntax tree."""
        sign, known = BINARY[name]
        if isinstance(left, Known) and isinstance(right, Known):
            return Known(known(left.value, right.value))
        if name == "Pow":
            return self._power(left, right)
        kind = joined(kind_of(left), kind_of(right))
        if name == "Div":
            return self._divided(left, right)
        if name in ("Mod", "FloorDiv", "LShift", "RShift"):
            return self._whole(name, left, right, kind)
        if isinstance(right, Known) and name in ("Add", "Sub") and abs(right.value) == math.inf:
            return Known(right.value if name == "Add" else -right.value)  # the other one is finite
        kind = "int" if kind == "bool" else kind
        return Number(f"({text_of(left, kind)} {sign} {text_of(right, kind)})", kind)

    def _divided(self, left: Scalar, right: Scalar) -> Scalar:
        above = text_of(left, "real")
        if isinstance(right, Known | Entry):
            below = float(right.value)
            if below not in (0.0, math.inf, -math.inf) and not math.isnan(below):
                if math.frexp(below)[0] in (0.5, -0.5):  # a power of two: the product is exact
                    return Number(f"({above} * {literal(1.0 / below)})")
                shown = right.name if isinstance(right, Constant) else literal(below)
                return Number(f"RDPI_OVER({bare(above)}, {shown})")
        return Number(f"({above} / {text_of(right, 'real')})")

    def _whole(self, name: str, left: Scalar, right: Scalar, kind: Kind) -> Scalar:
        if kind == "real":
            if name != "Mod":
                raise InputError(f"{BINARY[name][0]} of numbers with fractions")
            self.mathematics.add("FMOD")
            return Number(f"RDPI_FMOD({bare(text_of(left, kind))}, {bare(text_of(right, kind))})")
        if name not in ("Mod", "FloorDiv"):
            raise InputError(f"{BINARY[name][0]} of numbers known only as it runs")
        # what kernels count is never negative, so C's rounding is Python's
        sign = "%" if name == "Mod" else "/"
        return Number(f"({text_of(left, 'int')} {sign} {text_of(right, 'int')})", "int")

    def _power(self, left: Scalar, right: Scalar) -> Scalar:
        if isinstance(right, Known) and isinstance(right.value, int) and isinstance(left, Number):
            return Number(_repeated(text_of(left, "real"), right.value))
        self.mathematics.add("POW")
        return Number(f"RDPI_POW({bare(text_of(left, 'real'))}, {bare(text_of(right, 'real'))})")

    def compare(self, name: str, left: Scalar, right: Scalar) -> Scalar:
        """Return the value of a comparison."""
        sign, known = COMPARISONS[name]
        if isinstance(left, Known) and isinstance(right, Known):
            return Known(known(left.value, right.value))
        kind = joined(kind_of(left), kind_of(right))
        return Number(f"({text_of(left, kind)} {sign} {text_of(right, kind)})", "bool")

    def negative(self, value: Scalar) -> Scalar:
        """Return minus a number."""
        if isinstance(value, Known):
            return Known(-value.value)
        kind: Kind = "int" if value.kind == "bool" else value.kind
        return Number(f"(-{value.text})", kind)

    def negated(self, value: Scalar) -> Scalar:
        """Return whether a flag is not set."""
        if isinstance(value, Known):
            return Known(not value.value)
        return Number(f"(!{value.text})", "bool")

    def both(self, sign: str, left: Scalar, right: Scalar) -> Scalar:
        """Return two flags taken together by ``&&`` or ``||``."""
        for one, other in ((left, right), (right, left)):
            if isinstance(one, Known):
                decides = bool(one.value) == (sign == "||")
                return Known(bool(one.value)) if decides else other
        assert isinstance(left, Number)
        assert isinstance(right, Number)
        return Number(f"({left.text} {sign} {right.text})", "bool")

    def chosen(self, test: Scalar, one: Scalar, other: Scalar) -> Scalar:
        """Return the first where a flag is set, else the second."""
        if isinstance(test, Known):
            return one if test.value else other
        kind = joined(kind_of(one), kind_of(other))
        return Number(f"({bare(test.text)} ? {text_of(one, kind)} : {text_of(other, kind)})", kind)

    def extreme(self, name: str, left: Scalar, right: Scalar) -> Scalar:
        """Return the smaller (``min``) or the larger (``max``) of two numbers, of equal ones the first."""
        if isinstance(left, Known) and isinstance(right, Known):
            return Known((min if name == "min" else max)(left.value, right.value))
        never = math.inf if name == "min" else -math.inf
        for one, other in ((left, right), (right, left)):
            if isinstance(one, Known) and one.value == never:
                return other
        kind = joined(kind_of(left), kind_of(right))
        end = "" if kind == "real" else "_int"
        return Number(
            f"rdpi_{name}{end}({bare(text_of(left, kind))}, {bare(text_of(right, kind))})", kind
        )

    def absolute(self, value: Scalar) -> Scalar:
        """Return the magnitude of a number."""
        if isinstance(value, Known):
            return Known(abs(value.value))
        if value.kind != "real":
            return self.extreme("max", value, self.negative(value))
        return Number(f"rdpi_abs({bare(value.text)})")

    def function(self, name: str, *arguments: Scalar) -> Scalar:
        """Return a function of the mathematics."""
        if name == "copysign" and len(arguments) == 2:
            size, sign = arguments
            if isinstance(size, Known) and isinstance(sign, Known):
                return Known(math.copysign(size.value, sign.value))
            return Number(
                f"rdpi_copysign({', '.join(bare(text_of(a, 'real')) for a in arguments)})"
            )
        if name == "isnan" and len(arguments) == 1:
            if isinstance(arguments[0], Known):
                return Known(math.isnan(arguments[0].value))
            return Number(f"rdpi_is_nan({bare(text_of(arguments[0], 'real'))})", "bool")
        if name not in MATHEMATICS or len(arguments) != 1:
            raise InputError(f"{name} has no C")
        if isinstance(arguments[0], Known):
            return Known(MATHEMATICS[name](arguments[0].value))
        self.mathematics.add(name.upper())
        return Number(f"RDPI_{name.upper()}({bare(text_of(arguments[0], 'real'))})")

    def whole(self, value: Scalar) -> Scalar:
        """Return a number without its fraction, as ``int`` does."""
        if isinstance(value, Known | Entry):
            return Known(int(value.value))
        if value.kind != "real":
            return value
        text = value.text if is_simple(value.text) else f"({bare(value.text)})"
        return Number(f"(int32_t){text}", "int")


def _repeated(base: str, exponent: int) -> str:
    """Products of a base as numba makes them: by squaring."""
    if exponent < 0:
        return f"(RDPI_C(1.0) / {_repeated(base, -exponent)})"
    if exponent == 0:
        return literal(1.0)
    text, square, left = "", base, exponent
    while left:
        if left & 1:
            text = f"({text} * {square})" if text else square
        left >>= 1
        square = f"({square} * {square})"
    return text
