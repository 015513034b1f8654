"""Fixed point: compensators without transcendental functions on 32-bit integers, for cores without a floating-point unit.

Displacements and commands are fractions of a scale in units of 2^-31 ("codes"). A coefficient is a
whole number of up to 31 bits and a power of two that stands in the text as a literal; products and sums
are of 64 bits, rounded to the nearest, and nothing that 32-bit inputs can bring about overflows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baselines.base import Baseline
from baselines.classical import (
    ClassicalInverse,
    ClassicalLiteral,
    ClassicalLowPassed,
    ClassicalReferenceRate,
    ClassicalStatic,
    pack_inverse,
)
from baselines.feedforward import StaticGain
from baselines.inversion_free import (
    InversionFree,
    InversionFreeLiteral,
    InversionFreeLowPassed,
    InversionFreeReferenceRate,
    StaticInverseMultiplicative,
)
from baselines.pi import PI
from rdpi_gym.firmware.program import Memory, Table
from rdpi_gym.firmware.writing.templating import helpers
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

Integer: TypeAlias = Literal["int32_t", "uint32_t", "int64_t"]

_ONE = 2**31
_LARGEST = _ONE - 1
# Bits of a sum of coefficients, after the integer's fraction of an accumulator, and of a rate.
_BITS, _INTEGRAL_BITS, _RATE_BITS = 30, 24, 16
# The integral ends at 64 times the scale of commands.
_INTEGRAL_END_BITS = 61
# Displacements may be so much farther from their centre than references, and than what is reached.
_HEADROOM, _BEYOND_REACH = 2.0, 1.5
_WEIGHED = "total += (int64_t)p->weights[i] * m->plays[i];"
_FEEDFORWARDS: frozenset[type[Baseline]] = frozenset(
    {
        StaticGain, InversionFreeLiteral, InversionFreeReferenceRate, InversionFreeLowPassed,
        StaticInverseMultiplicative, ClassicalReferenceRate, ClassicalStatic, ClassicalLiteral,
        ClassicalLowPassed,
    }
)  # fmt: skip


@dataclass(frozen=True)
class FixedPoint:
    """One sample of a controller as C on integers, with ``rdpi_real`` an ``int32_t``.

    The body stands in the same function as that of a
    :class:`~rdpi_gym.firmware.program.Program`; its ``reference_um``, ``ahead_um``, ``measured_um``
    and what it returns are codes: r = centre + displacement_scale · code / 2^31, and
    u = voltage_scale · code / 2^31. Every int32 is a valid input.
    """

    # twice the references' amplitude at least, and 1.5 times the reach
    displacement_scale_um: float
    centre_um: float
    voltage_scale_V: float  # about 0 V: the farther end of the range is code ±(2^31 - 1)
    low: int  # code of the lower end of the command range
    high: int  # code of its upper end
    rest: int  # code of the command at the begin of an episode
    reach: int  # code of the references' amplitude
    tables: Sequence[Table]  # in the order of their structs
    memory: Sequence[Memory]
    functions: str  # static functions that `step` calls, callees first; they need <stdint.h> alone
    step: str
    notes: Sequence[str] = field(default_factory=tuple)

    def displacement_codes(self, displacement_um: ArrayLike) -> NDArray[np.int32]:
        """Return the codes of displacements (µm), of the same shape; beyond the scale its ends."""
        fraction = (np.asarray(displacement_um) - self.centre_um) / self.displacement_scale_um
        return _codes(fraction)

    def commands_V(self, codes: ArrayLike) -> Array:
        """Return commands (V) from their codes, of the same shape."""
        return np.asarray(self.voltage_scale_V * (np.asarray(codes, dtype=np.float64) / _ONE))


def fixed_point_body(controller: Baseline) -> FixedPoint:
    """Return a controller on integers."""
    loop = controller if type(controller) is PI else None
    forward = controller if loop is None else loop.feedforward
    if forward is not None and type(forward) not in _FEEDFORWARDS:
        raise InputError(
            f"no fixed point for {controller.name}: there is one for none, inversion-free-*, "
            "static-inverse-multiplicative, classical-*, and for pi alone or on one of them"
        )
    writer = _Writer(controller)
    try:
        if isinstance(forward, StaticGain):
            writer.gain(forward)
        elif isinstance(forward, InversionFree):
            writer.inversion_free(forward)
        elif isinstance(forward, ClassicalInverse):
            writer.classical(forward)
        if loop is not None:
            writer.feedback(loop)
    except _TooLarge as error:
        raise InputError(f"no fixed point for {controller.name}: {error}") from error
    if forward is not None and (warning := forward.warning()) is not None:
        writer.notes.append(f"{warning}; there rounding grows from sample to sample")
    return writer.finished()


class _TooLarge(ValueError):
    """A coefficient is too large for its format; the text says which."""


@dataclass(frozen=True)
class _Rate:
    """Thresholds that move: statements that find their `shift`, and that keep what the next one needs."""

    find: Sequence[str] = ()
    keep: Sequence[str] = ()


class _Writer:
    """Writes one controller; `total` is the command on its way, first as a sum, then as a code."""

    def __init__(self, controller: Baseline) -> None:
        layout, self.limits = controller.layout, controller.limits
        self.ts_s, self.centre_um, self.reach_um = layout.ts_s, layout.centre_um, layout.scale_um
        farthest_V = max(abs(self.limits.low_V), abs(self.limits.high_V))
        belief = controller.belief
        reached_um = farthest_V * belief.hysteresis.A + abs(belief.offset_um - self.centre_um)
        self.microns = max(_HEADROOM * layout.scale_um, _BEYOND_REACH * reached_um)
        self.volts = farthest_V * _ONE / _LARGEST
        self.tables: list[Table] = []
        self.memory: list[Memory] = []
        self.notes: list[str] = []
        self.lines = [f"int64_t total = {self.code(self.limits.rest_V)};"]

    def finished(self) -> FixedPoint:
        """Return what was written."""
        text = "\n".join(self.lines)
        return FixedPoint(
            displacement_scale_um=self.microns,
            centre_um=self.centre_um,
            voltage_scale_V=self.volts,
            low=self.code(self.limits.low_V),
            high=self.code(self.limits.high_V),
            rest=self.code(self.limits.rest_V),
            reach=min(round(self.reach_um / self.microns * _ONE), _LARGEST),
            tables=tuple(self.tables),
            memory=tuple(self.memory),
            functions="\n".join(helpers("fixed_helpers.c", text)),
            step=f"{text}\nreturn (rdpi_real)total;\n",
            notes=tuple(self.notes),
        )

    # Each of the three writes the command that answers r(k+1), within the limits.

    def gain(self, forward: StaticGain) -> None:
        """Write ``none``."""
        slope = 1.0 / forward.gain_um_V
        self.sum(slope, [], slope * (self.centre_um - forward.belief.offset_um))
        self.limit("forward_command", remember=False)

    def inversion_free(self, forward: InversionFree) -> None:
        """Write Eq. 6: the command from the plays of the last sample, which then slide along it."""
        model, own = forward.model, isinstance(forward, InversionFreeLiteral)
        a0, per_sample = model.weights[0], model.delta2_s / self.ts_s
        self.plays(model.thresholds_V, forward.start(np.zeros(1))[2:-1, 0], self.volts)
        weights = [-weight / a0 * self.volts for weight in model.weights[1:]]
        self.sum(1.0 / a0, weights, (self.centre_um - forward.belief.offset_um) / a0)
        self.lines += _over_plays(_WEIGHED)
        if own:
            rate = self.own_rate(per_sample, model.rate_pole(self.ts_s))
            self.limit("forward_command", remember=True, between=rate.keep)
            self.lines += rate.find
        else:
            rate = self.reference_rate(per_sample / model.A * self.microns / self.volts)
            self.limit("forward_command", remember=False)
            self.lines += [*rate.find, *rate.keep]
        self.lines += _over_plays(_slide("(int32_t)total", bool(rate.find)))

    def classical(self, forward: ClassicalInverse) -> None:
        """Write the inverse: plays that slide along the reference, then their sum."""
        model, own = forward.model, isinstance(forward, ClassicalLiteral)
        slope, *rest = np.split(pack_inverse([model], self.ts_s)[:-3, 0], [1, 1 + model.n])
        weights_V_um, thresholds_um = rest
        away_um = self.centre_um - forward.belief.offset_um
        plays_um = forward.start(np.zeros(1))[2:-1, 0] - away_um
        # Plays at rest belong to 0 µm, which may be farther from the centre than the references go.
        self.microns = max(self.microns, 1.001 * float(np.abs(plays_um).max(initial=0.0)))
        self.plays(thresholds_um, plays_um, self.microns)
        shift = model.weights[0] * model.delta2_s / self.ts_s
        if own:
            rate = self.own_rate(shift * self.volts / self.microns, model.rate_pole(self.ts_s))
        else:
            rate = self.reference_rate(shift / model.A)
        at_centre = float(slope[0] + weights_V_um.sum()) * away_um
        self.sum(float(slope[0]), (weights_V_um * self.microns).tolist(), at_centre)
        self.lines += [
            *rate.find,
            *([] if own else rate.keep),
            *_over_plays(_slide("ahead_um[0]", bool(rate.find)), _WEIGHED),
        ]
        self.limit("forward_command", remember=own, between=rate.keep if own else ())

    def feedback(self, loop: PI) -> None:
        """Write what the error adds to the command."""
        per_code = self.microns / self.volts
        proportional = loop.gains.proportional_V_um * per_code
        integral = loop.gains.integral_V_um_s * self.ts_s * per_code
        (factor,), shift = _coefficients([integral], "the integral gain", _INTEGRAL_BITS + 1)
        self.table("integral_gain", [factor])
        self.remember("integral", [0], "int64_t")
        grows = f"rdpi_rounded(error * p->integral_gain[0], {shift - _INTEGRAL_BITS}u)"
        end = 2**_INTEGRAL_END_BITS
        self.lines += [
            "const int64_t error = (int64_t)reference_um - measured_um;",
            f"const int64_t collected = rdpi_limited(m->integral[0] + {grows}, -INT64_C({end}), INT64_C({end}));",
            f"total += rdpi_rounded(collected, {_INTEGRAL_BITS}u);",
        ]
        if proportional:
            (factor,), shift = _coefficients([proportional], "the proportional gain", 1)
            self.table("proportional_gain", [factor])
            self.lines.append(f"total += rdpi_rounded(error * p->proportional_gain[0], {shift}u);")
        self.lines.append("const int64_t wanted = total;")
        self.limit("command", remember=False)
        self.lines += [
            "/* Where the error drives further into the limit, nothing is collected. */",
            "if (((wanted <= total) || (error <= 0)) && ((wanted >= total) || (error >= 0))) {",
            "    m->integral[0] = collected;",
            "}",
        ]

    # What they are made of.

    def code(self, command_V: float) -> int:
        """Return the code of a command."""
        return int(_codes(command_V / self.volts))

    def table(self, name: str, values: Sequence[int], kind: Integer = "int32_t") -> None:
        """Add a table."""
        self.tables.append(Table(name, np.array(values, dtype=np.int64), kind))

    def remember(
        self, name: str, rest: ArrayLike, kind: Integer = "int32_t", by_reference: float = 0.0
    ) -> None:
        """Add a field of memory."""
        codes = np.array(rest, dtype=np.int64)
        self.memory.append(Memory(name, codes, np.full(codes.shape, by_reference), kind))

    def sum(self, slope_V_um: float, weights_V: Sequence[float], at_centre_V: float) -> None:
        """Begin `total` as command at the centre + slope · reference, on the scale of the weights."""
        values = [slope_V_um * self.microns, *weights_V, at_centre_V]
        (gain, *weights, _), shift = _coefficients(
            [value / self.volts for value in values], "the sum of the weights", 1
        )
        self.table("gain", [gain])
        if weights:
            self.table("weights", weights)
        self.table(
            "at_centre", [round(math.ldexp(at_centre_V / self.volts, shift + 31))], "int64_t"
        )
        self.lines[0] = "int64_t total = p->at_centre[0] + (int64_t)p->gain[0] * ahead_um[0];"
        self.shift = shift

    def limit(self, last: str, remember: bool, between: Sequence[str] = ()) -> None:
        """Make a code of the sum, limit it, and remember it where the next one needs it.

        `between` is done when the new command stands in `total` and the last one in the memory.
        """
        if last == "forward_command":
            self.lines.append(f"total = rdpi_rounded(total, {self.shift}u);")
        low, high = self.code(self.limits.low_V), self.code(self.limits.high_V)
        self.lines.append(f"total = rdpi_limited(total, {low}, {high});")
        stepped = math.isfinite(self.limits.step_V)
        if stepped:
            step = min(math.ceil(self.limits.step_V / self.volts * _ONE), 2 * _ONE)
            low_high = f"(int64_t)m->{last}[0] - {step}, (int64_t)m->{last}[0] + {step}"
            self.lines.append(f"total = rdpi_limited(total, {low_high});")
        self.lines += between
        if stepped or remember:
            self.remember(last, [self.code(self.limits.rest_V)])
            self.lines.append(f"m->{last}[0] = (int32_t)total;")

    def plays(self, thresholds: ArrayLike, rest: ArrayLike, scale: float) -> None:
        """Add the plays; a threshold of twice the scale never moves one, however much larger."""
        whole = np.rint(np.asarray(thresholds) / scale * _ONE)
        self.table(
            "thresholds", np.minimum(whole, 2.0 * _ONE - 1.0).astype(int).tolist(), "uint32_t"
        )
        self.remember("plays", _codes(np.asarray(rest) / scale))

    def reference_rate(self, slope: float) -> _Rate:
        """Let the thresholds grow with the reference's change, by `slope` codes for each."""
        if slope == 0.0:
            return _Rate()
        (factor,), shift = _coefficients([slope], "what the rate adds to the thresholds", 1)
        self.table("rate_gain", [factor])
        self.remember("reference", [0], by_reference=1.0)
        change = "((int64_t)ahead_um[0] - m->reference[0]) * p->rate_gain[0]"
        return _Rate(
            [f"const uint32_t shift = rdpi_size({change}, {shift}u);"],
            ["m->reference[0] = ahead_um[0];"],
        )

    def own_rate(self, slope: float, pole: float) -> _Rate:
        """Let the thresholds grow with the command's change, low-passed by a pole."""
        if slope == 0.0:
            return _Rate()
        (factor,), shift = _coefficients([slope], "what the rate adds to the thresholds", 20)
        self.table("rate_gain", [factor])
        self.remember("rate", [0], "int64_t")
        bits = shift - _RATE_BITS
        change = f"rdpi_rounded((total - m->forward_command[0]) * p->rate_gain[0], {bits}u)"
        if pole == 0.0:
            keep = f"m->rate[0] = {change};"
        else:
            (part,), shift = _coefficients([1.0 - pole], "the pole of the rate", 30)
            self.table("rate_part", [part])
            keep = f"m->rate[0] += rdpi_part({change} - m->rate[0], p->rate_part[0], {shift}u);"
        return _Rate([f"const uint32_t shift = rdpi_size(m->rate[0], {_RATE_BITS}u);"], [keep])


def _codes(fractions: ArrayLike) -> NDArray[np.int32]:
    whole = np.rint(np.asarray(fractions, dtype=np.float64) * _ONE)
    return np.asarray(np.clip(whole, -_ONE, _LARGEST), dtype=np.int32)


def _coefficients(values: Sequence[float], what: str, least_shift: int) -> tuple[list[int], int]:
    """Return whole numbers that are values · 2^shift, of `_BITS` bits together."""
    size = sum(abs(value) for value in values)
    shift = 62 if size == 0.0 else min(math.floor(_BITS - math.log2(size)), 62)
    if shift < least_shift:
        raise _TooLarge(
            f"{what} is {size:.3g} of the scales; at most {math.ldexp(1.0, _BITS - least_shift):.3g} fits"
        )
    return [round(math.ldexp(value, shift)) for value in values], shift


def _over_plays(*statements: str) -> list[str]:
    head = "for (uint32_t i = 0u; i < sizeof m->plays / sizeof m->plays[0]; ++i) {"
    return [head, *(f"    {line}" for line in statements), "}"]


def _slide(along: str, moving: bool) -> str:
    shift = "shift" if moving else "0u"
    return f"m->plays[i] = rdpi_slid(m->plays[i], {along}, p->thresholds[i], {shift});"
