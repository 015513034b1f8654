"""Nonlinear effects, creep, drifts and the unknown block undone sample by sample."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numba import njit

from baselines.classical import pack_inverse
from baselines.inverses.base import Inverse, Setting, turns
from rdpi_gym.plant.cores.play import given_rate_block, play
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.effects.base import forms_of
from rdpi_gym.plant.effects.unknown import Block, OfTheRate, Static, Unknown
from rdpi_gym.support.arrays import Array

# Corrections: each takes the error down by the largest slope of what the block adds, 0.02 to 0.3. Where
# it adds a rate without a lag, that slope is above one from sample to sample, and more would not settle.
# What a curve adds hangs on the sample alone: from the second on they are secant steps, in these bounds.
_ROUNDS, _RATE_ROUNDS = 6, 1
_LEAST_SLOPE, _LARGEST_SLOPE = 0.2, 5.0
_RATES = 2  # rows of the block's state that its rate is taken from


def _forms(*places: str) -> tuple[str, ...]:
    kinds = [kind for kind in forms_of(Unknown) if issubclass(kind, Block)]
    return tuple(kind.form for kind in kinds if kind.place in places)


class UnknownInverse(Inverse):
    """A block before or behind the hysteresis, whose own kernel runs once for each correction.

    Where it falls by more than it is given, no input is right, and the corrections do not settle.
    """

    effect = Unknown.name
    forms = _forms("before", "behind")
    _reads_guess = True

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._block, self._ts_s, self._rest = type(effect).block, setting.ts_s, setting.rest
        self._p = np.array(effect.coefficients(setting.ts_s, setting.hysteresis))[:, None]
        self._each = effect.state_rows(setting.ts_s)
        self._rounds = _RATE_ROUNDS if isinstance(effect, OfTheRate) else _ROUNDS
        self._by_secants = isinstance(effect, Static) and self._reads_guess
        self.rows = self._rounds * self._each

    def start(self, y: Array) -> tuple[Array, Array]:
        """Memories in equilibrium at the plant's rest; the rate is that from the reference's first sample."""
        state, here = self._fresh(len(y)), self._fresh(len(y))
        self.run(np.full((1, len(y)), self._rest), state)
        first = np.ascontiguousarray(y[None])
        self.run(first, here)
        for row in range(0, self._rounds * self._each, self._each):
            state[row : row + _RATES] = here[row : row + _RATES]
        return state, self.run(first, state.copy())[0]

    def _fresh(self, lanes: int) -> Array:
        """Return a memory before any sample."""
        return np.full((self.rows, lanes), np.nan)

    def run(self, y: Array, state: Array) -> Array:
        """Correct; see :meth:`Inverse.run`."""
        p = np.repeat(self._p, y.shape[1], axis=1)
        x, before = y, (y, y)
        for k in range(self._rounds):
            own, out = state[k * self._each : (k + 1) * self._each], np.empty_like(y)
            self._block(x, self._command(x, k, state), p, own, self._ts_s, out)
            slope = self._slope(x - before[0], out - before[1]) if k else 1.0
            before = x, out
            x = x + (y - out) / slope
        return x

    def _slope(self, step: Array, answer: Array) -> Array | float:
        """Slope of the block between two guesses, for a block without memory."""
        if not self._by_secants:
            return 1.0
        slope = np.divide(answer, step, out=np.ones_like(step), where=step != 0.0)
        return np.asarray(np.clip(slope, _LEAST_SLOPE, _LARGEST_SLOPE))

    def _command(self, x: Array, k: int, state: Array) -> Array:
        """Command that belongs to a guess; a block that stands apart from the plays reads none."""
        return x


class UnknownWithin(UnknownInverse):
    """A block that changes the weights of the plays, or the displacement, by the command.

    The command that belongs to a guess is that of the classical inverse of static plays.
    """

    forms = _forms("in", "beside")
    _reads_guess = False

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._inverse = pack_inverse([setting.hysteresis.static()], setting.ts_s)
        self._plays = setting.hysteresis.n + 2
        self.rows += self._rounds * self._plays

    def _fresh(self, lanes: int) -> Array:
        """Return the same, the plays of the inverse at rest."""
        state = super()._fresh(lanes)
        state[self._rounds * self._each :] = 0.0
        return state

    def _command(self, x: Array, k: int, state: Array) -> Array:
        first = self._rounds * self._each + k * self._plays
        u, p = np.empty_like(x), np.repeat(self._inverse, x.shape[1], axis=1)
        given_rate_block(x, np.zeros_like(x), p, state[first : first + self._plays], u)
        return u


class AsymmetryInverse(Inverse):
    """The quadratic solved; beyond its vertex the vertex, which comes nearest."""

    effect = "asymmetry"

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._square = effect.coefficients(setting.ts_s, setting.hysteresis)[0]

    def run(self, y: Array, state: Array) -> Array:
        """Solve; see :meth:`Inverse.run`."""
        root = np.sqrt(np.maximum(1.0 + 4.0 * self._square * y, 0.0))
        if self._square == 0.0:
            return y.copy()
        reached = np.where(root > 0.0, y, -0.25 / self._square)
        return np.asarray(2.0 * reached / (1.0 + root), dtype=np.float64)


# Halvings of the bracket: to the last digits of a double.
_HALVINGS = 60


@njit(cache=True)
def _bent(x: float, powers: Array) -> float:
    value = 0.0
    for k in range(len(powers) - 1, -1, -1):
        value = (value + powers[k]) * x
    return value + x


@njit(cache=True)
def polynomial_inverse_block(y: Array, powers: Array, low: float, high: float, x: Array) -> None:
    """Solve y = x + Σ p_k x^k, k = 2 ..., by bisection between its turns `low` < 0 < `high`.

    The nearer turn is what is left where no x reaches y; ``powers`` holds p_k (µm^(1-k)) after a zero.
    """
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            end = high if y[t, b] >= 0.0 else low
            far = y[t, b]
            while abs(far) < abs(end) and abs(_bent(far, powers)) < abs(y[t, b]):
                far *= 2.0
            if abs(far) >= abs(end):
                far = end
            near = 0.0
            if abs(_bent(far, powers)) <= abs(y[t, b]):
                near = far
            for _ in range(_HALVINGS):
                middle = 0.5 * (near + far)
                if abs(_bent(middle, powers)) < abs(y[t, b]):
                    near = middle
                else:
                    far = middle
            x[t, b] = 0.5 * (near + far)


class PolynomialInverse(Inverse):
    """The polynomial solved on the branch that rises through zero; beyond a turn that turn."""

    effect = "asymmetry"
    forms = ("cubic", "to the fifth degree")

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        per_um, *shares = effect.coefficients(setting.ts_s, setting.hysteresis)
        self._powers = np.array([0.0, *(c * per_um ** (k + 1) for k, c in enumerate(shares))])
        below, above = turns([k * c for k, c in enumerate(shares, start=2)])
        self._low, self._high = below / per_um, above / per_um

    def run(self, y: Array, state: Array) -> Array:
        """Solve; see :meth:`Inverse.run`."""
        x = np.empty_like(y)
        polynomial_inverse_block(y, self._powers, self._low, self._high, x)
        return x


# Voltages are kept within this share of the rails, where the inverse is finite.
_REACHED = 1.0 - 1e-9


class SaturationInverse(Inverse):
    """Harder commands where the amplifier softens."""

    effect = "saturation"
    forms = ("", "soft unlike rails")

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._limit_V = effect.values["limit_V"]
        self._centre_V = effect.values["centre_V"]

    def run(self, y: Array, state: Array) -> Array:
        """Invert the curve; see :meth:`Inverse.run`."""
        share = np.clip((y - self._centre_V) / self._limit_V, -_REACHED, _REACHED)
        return np.asarray(self._centre_V + self._limit_V * np.arctanh(share), dtype=np.float64)


class KneeInverse(Inverse):
    """Harder commands above the knee: v / (1 - |v|^p)^(1/p) of the share v of the rails."""

    effect = "saturation"
    forms = ("rails with a knee",)

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._up_V, self._down_V, self._centre_V, self._sharpness = effect.values.values()

    def run(self, y: Array, state: Array) -> Array:
        """Invert the curve; see :meth:`Inverse.run`."""
        limit_V = np.where(y > self._centre_V, self._up_V, self._down_V)
        share = np.clip((y - self._centre_V) / limit_V, -_REACHED, _REACHED)
        softening = (1.0 - np.abs(share) ** self._sharpness) ** (1.0 / self._sharpness)
        return np.asarray(self._centre_V + limit_V * share / softening, dtype=np.float64)


class HardRailsInverse(Inverse):
    """The wanted voltage itself, and where it is beyond a rail that rail, which comes nearest."""

    effect = "saturation"
    forms = ("hard upper rail", "hard lower rail", "hard rails")

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._low_V, self._high_V = effect.coefficients(setting.ts_s, setting.hysteresis)

    def run(self, y: Array, state: Array) -> Array:
        """Clip; see :meth:`Inverse.run`."""
        return np.asarray(np.clip(y, self._low_V, self._high_V), dtype=np.float64)


# A reversal is one by this share of the scale; less is rounding of the reference.
_REVERSAL = 1e-4


@njit(cache=True)
def jump_block(y: Array, half_width: float, reversal: float, state: Array, x: Array) -> None:
    """Rows of the state: side of the gap (-1, 0, 1), farthest output in that direction (µm)."""
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            side, ahead = state[0, b], y[t, b] - state[1, b]
            if side == 0.0:
                if abs(ahead) > reversal:
                    side = np.sign(ahead)
                    state[1, b] = y[t, b]
            elif side * ahead > 0.0:
                state[1, b] = y[t, b]
            elif side * ahead < -reversal:
                side = -side
                state[1, b] = y[t, b]
            state[0, b] = side
            x[t, b] = y[t, b] + side * half_width


class BacklashInverse(Inverse):
    """The inverse of a play: it steps from one side of the gap to the other."""

    effect = "backlash"
    rows = 2

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._half_width_um = effect.values["half_width_um"]
        self._reversal_um = _REVERSAL * setting.scale_um

    def start(self, y: Array) -> tuple[Array, Array]:
        """In the middle of the gap."""
        return np.stack([np.zeros(len(y)), y]), y.copy()

    def run(self, y: Array, state: Array) -> Array:
        """Jump; see :meth:`Inverse.run`."""
        x = np.empty_like(y)
        jump_block(y, self._half_width_um, self._reversal_um, state, x)
        return x


@njit(cache=True)
def bridged_inverse_block(
    y: Array, half_width: float, bridge: float, state: Array, x: Array
) -> None:
    """Solve y = c x + (1 - c) play(x): a play of c w beside a gain of 1 / c. State: its last output."""
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            inner = play(state[0, b], y[t, b] - bridge * half_width, y[t, b] + bridge * half_width)
            state[0, b] = inner
            x[t, b] = inner + (y[t, b] - inner) / bridge


class BridgedGapInverse(Inverse):
    """The inverse of a play beside a spring: steeper after every reversal, until the gap is crossed."""

    effect = "backlash"
    forms = ("bridged by a spring",)
    rows = 1

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._half_width_um, self._bridge = effect.coefficients(setting.ts_s, setting.hysteresis)

    def start(self, y: Array) -> tuple[Array, Array]:
        """In the middle of the gap."""
        return y[None].copy(), y.copy()

    def run(self, y: Array, state: Array) -> Array:
        """Invert; see :meth:`Inverse.run`."""
        x = np.empty_like(y)
        bridged_inverse_block(y, self._half_width_um, self._bridge, state, x)
        return x


@njit(cache=True)
def creep_inverse_block(y: Array, p: Array, state: Array, x: Array) -> None:
    """Solve y = x + gain Σ z_k; ``p`` is the effect's column, the state its rows."""
    elements = (len(p) - 1) // 3
    gain, direct = p[0], 1.0
    for k in range(elements):
        direct += gain * p[3 + 3 * k]
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            stretched = 0.0
            for k in range(elements):
                z = p[1 + 3 * k] * state[1 + k, b] + p[2 + 3 * k] * state[0, b]
                state[1 + k, b] = z
                stretched += z
            new = (y[t, b] - gain * stretched) / direct
            for k in range(elements):
                state[1 + k, b] += p[3 + 3 * k] * new
            state[0, b] = new
            x[t, b] = new


class CreepInverse(Inverse):
    """The inverse of a proper filter with zeros inside the unit circle: exact and stable."""

    effect = "creep"

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._p = np.array(effect.coefficients(setting.ts_s, setting.hysteresis))
        self.rows = effect.state_rows(setting.ts_s)
        self._rest_um = setting.rest

    def start(self, y: Array) -> tuple[Array, Array]:
        """In equilibrium at the plant's rest, wherever the reference begins."""
        stretched = self._p[0] * (self.rows - 1) * self._rest_um
        return np.full((self.rows, len(y)), self._rest_um), y - stretched

    def run(self, y: Array, state: Array) -> Array:
        """Solve sample by sample; see :meth:`Inverse.run`."""
        x = np.empty_like(y)
        creep_inverse_block(y, self._p, state, x)
        return x


@njit(cache=True)
def elements_inverse_block(y: Array, p: Array, state: Array, x: Array) -> None:
    """Solve y = g x - Σ l_k, l_k what element k lacks; ``p`` is the effect's column."""
    elements = (len(p) - 1) // 2
    direct = p[0]
    for k in range(elements):
        direct -= p[2 + 2 * k]
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            wanted = y[t, b]
            for k in range(elements):
                lack = p[1 + 2 * k] * state[1 + k, b] - p[2 + 2 * k] * state[0, b]
                state[1 + k, b] = lack
                wanted += lack
            new = wanted / direct
            for k in range(elements):
                state[1 + k, b] += p[2 + 2 * k] * new
            state[0, b] = new
            x[t, b] = new


class ElementsInverse(CreepInverse):
    """The same for elements of unlike gains, in every further form of creep."""

    forms = (
        "one time constant",
        "two time constants",
        "between two times",
        "three time constants",
        "spectrum",
    )

    def start(self, y: Array) -> tuple[Array, Array]:
        """In equilibrium at the plant's rest, wherever the reference begins."""
        state = np.zeros((self.rows, len(y)))
        state[0] = self._rest_um
        return state, y - (self._p[0] - 1.0) * self._rest_um

    def run(self, y: Array, state: Array) -> Array:
        """Solve sample by sample; see :meth:`Inverse.run`."""
        x = np.empty_like(y)
        elements_inverse_block(y, self._p, state, x)
        return x


class GainDriftInverse(Inverse):
    """Division by the gain, in any form: what the effect makes of one micrometre at that time.

    Row of the memory: number of the next sample.
    """

    effect = "gain_drift"
    forms: ClassVar[tuple[str, ...]] = ("", "to a limit", "piecewise linear", "smooth curve")
    rows = 1

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._block = type(effect).block
        self._column = np.array(effect.coefficients(setting.ts_s, setting.hysteresis))
        self._ts_s = setting.ts_s

    def start(self, y: Array) -> tuple[Array, Array]:
        """The sample that was held is number 0; nothing has drifted by then."""
        return np.ones((1, len(y))), y.copy()

    def run(self, y: Array, state: Array) -> Array:
        """Undo what has drifted; see :meth:`Inverse.run`."""
        undone: Array = y / self._of(np.ones_like(y), state)
        return undone

    def _of(self, x: Array, state: Array) -> Array:
        """Return what the effect makes of a displacement (µm) at the samples that come now."""
        p = np.repeat(self._column[:, None], x.shape[1], axis=1)
        out = np.empty_like(x)
        self._block(x, x, p, state, self._ts_s, out)
        return out


class ThermalDriftInverse(GainDriftInverse):
    """Subtraction of what the warming adds, in any form: what the effect makes of no displacement."""

    effect = "thermal_drift"
    forms = ("", "two time constants", "piecewise linear", "smooth curve")

    def run(self, y: Array, state: Array) -> Array:
        """Undo what has drifted; see :meth:`Inverse.run`."""
        undone: Array = y - self._of(np.zeros_like(y), state)
        return undone
