"""Inverses of a belief: effects in a row, a short preview shared among them, and what is undone with the plays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from baselines.inverses.base import Inverse, Setting, inverse_of, turns, without_inverse
from rdpi_gym.plant import RDPI, Plant, PlantModel
from rdpi_gym.plant.cores.play import play
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.effects.congruency import (
    congruency_block,
    congruency_centred_block,
    congruency_polynomial_block,
)
from rdpi_gym.support.arrays import Array

# Halvings of the command range: to a billionth of a millionth of it.
_HALVINGS = 50


UNDONE = (congruency_block, congruency_centred_block, congruency_polynomial_block)
"""Kernels of the forms of congruency that are undone together with the plays."""


def growth(effect: Effect, ts_s: float, model: RDPI) -> Array:
    """Return g_k (1/V^k) of y = a_0 u + (Σ g_k u^k) Σ a_i ξ_i, k = 0, 1, ..."""
    _, first, *others = effect.coefficients(ts_s, model)
    if type(effect).block is congruency_block:
        return np.array([1.0, 0.0, first])
    if type(effect).block is congruency_centred_block:
        (middle,) = others
        return np.array([1.0 + first * middle**2, -2.0 * first * middle, first])
    return np.array([1.0, *(c * first**k for k, c in enumerate(others, start=1))])


def rising_range(
    model: RDPI, powers: Array, command_range_V: tuple[float, float]
) -> tuple[float, float]:
    """Return the part of a command range (V) about zero over which the displacement rises."""
    low, high = command_range_V
    largest, k = max(abs(low), abs(high)), np.arange(1, len(powers))
    for first, factors in ((model.a0, k), (model.a0 + model.S * powers[0], k + 1)):
        below, above = turns(model.S * factors * powers[1:] * largest**k / first)
        low, high = max(low, largest * below), min(high, largest * above)
    return low, high


@njit(cache=True)
def _excess(
    u: float, y: float, shift: float, powers: Array, p: Array, state: Array, b: int
) -> float:
    """Displacement (µm) that a command would cause, over the wanted one."""
    n = (p.shape[0] - 4) // 2
    plays = 0.0
    for i in range(n):
        r = p[n + 1 + i, b] + shift
        plays += p[1 + i, b] * play(state[2 + i, b], u - r, u + r)
    weight = 0.0
    for k in range(len(powers) - 1, -1, -1):
        weight = weight * u + powers[k]
    excess: float = p[0, b] * u + weight * plays - y
    return excess


@njit(cache=True)
def congruent_inverse_block(
    y: Array, v: Array, powers: Array, p: Array, state: Array, low: float, high: float, u: Array
) -> None:
    """Solve y = a_0 u + (Σ g_k u^k) Σ a_i ξ_i for each sample by bisection over the range."""
    n = (p.shape[0] - 4) // 2
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            shift = p[2 * n + 1, b] * abs(v[t, b])
            below, above = low, high
            if _excess(low, y[t, b], shift, powers, p, state, b) >= 0.0:
                above = low
            elif _excess(high, y[t, b], shift, powers, p, state, b) <= 0.0:
                below = high
            else:
                for _ in range(_HALVINGS):
                    middle = 0.5 * (below + above)
                    if _excess(middle, y[t, b], shift, powers, p, state, b) < 0.0:
                        below = middle
                    else:
                        above = middle
            command = 0.5 * (below + above)
            for i in range(n):
                r = p[n + 1 + i, b] + shift
                state[2 + i, b] = play(state[2 + i, b], command - r, command + r)
            u[t, b] = command


@dataclass(frozen=True)
class Inverses:
    """Invertible effects of a belief, in the order of inversion."""

    output: tuple[Inverse, ...]  # stages behind the plays, the outermost first
    command: tuple[Inverse, ...]  # and before them, the innermost first
    congruency: Effect | None  # dealt with together with the plays,
    rate: tuple[Effect, ...]  # as these are
    passed_over: tuple[str, ...]  # effects that are not inverted, by name and form
    short: tuple[str, ...]  # effects that would make use of more preview
    wanted_ahead: int  # samples after the next one that all of them make use of
    rest_V: float  # voltage (V) that the plays see while the plant rests

    @property
    def ahead(self) -> int:
        """Samples after the next one that the stages look at."""
        return sum(stage.ahead for stage in (*self.output, *self.command))

    @property
    def changes_nothing(self) -> bool:
        """Whether only the classical inverse remains."""
        return not (self.output or self.command or self.congruency or self.rate)


def inverses_of(
    belief: PlantModel, ts_s: float, scale_um: float, rest_V: float, shown_ahead: int
) -> Inverses:
    """Return the inverses of a belief that rests at a command (V), where so many samples are shown ahead."""
    kinds = {e.name: kind for e in belief.effects if (kind := inverse_of(e)) is not None}
    wanted = {
        e.name: kinds[e.name].wanted_ahead(e, ts_s) for e in belief.effects if e.name in kinds
    }
    urgent = sorted(wanted, key=lambda name: -kinds[name].urgency)
    granted = _share({name: wanted[name] for name in urgent}, shown_ahead)
    stages: dict[str, list[Inverse]] = {"input": [], "output": []}
    for effect in reversed(belief.effects):
        if effect.name in kinds:
            rest = _rest_before(belief, effect, ts_s, rest_V)
            setting = Setting(ts_s, belief.hysteresis, scale_um, rest)
            place = "input" if effect.slot == "input" else "output"
            stage = kinds[effect.name](effect, setting, granted[effect.name])
            stages[place].append(stage)
    followed = tuple(e for e in belief.effects if e.slot == "rate" and not e.state_rows(ts_s))
    congruency = next((e for e in belief.effects if type(e).block in UNDONE), None)
    dealt_with = {*kinds, *(e.name for e in (*followed, congruency) if e is not None)}
    return Inverses(
        output=tuple(stages["output"]),
        command=tuple(stages["input"]),
        congruency=congruency,
        rate=followed,
        passed_over=tuple(
            without_inverse(e)
            for e in belief.effects
            if e.name not in dealt_with and e.slot != "memory"
        ),
        short=tuple(name for name in urgent if granted[name] < wanted[name]),
        wanted_ahead=sum(wanted.values()),
        rest_V=_rest_input([e for e in belief.effects if e.slot == "input"], ts_s, rest_V),
    )


def _share(wanted: dict[str, int], available: int) -> dict[str, int]:
    granted = {}
    for name, samples in wanted.items():  # the most urgent first
        granted[name] = min(samples, available)
        available -= granted[name]
    return granted


def _rest_before(belief: PlantModel, effect: Effect, ts_s: float, rest_V: float) -> float:
    """Input of an effect while the plant rests at a command (V)."""
    before = belief.effects[: belief.effects.index(effect)]
    if effect.slot == "input":
        return _rest_input(before, ts_s, rest_V)
    plant = Plant(replace(belief, effects=before, offset_um=0.0), ts_s)
    plant.reset(u0_V=rest_V)
    return float(plant.simulate(np.array([rest_V]))[0])


def _rest_input(effects: Sequence[Effect], ts_s: float, rest_V: float) -> float:
    for effect in effects:
        rest_V = float(effect.run([rest_V], ts_s)[0])
    return rest_V


def followed(law: Effect, rate_V_s: Array, ts_s: float) -> Array:
    """Return the rate (V/s) that sets the thresholds by a law without memory, ``float64[T, B]``."""
    column = np.array(law.coefficients(ts_s, RDPI((1.0,), (), 0.0)))
    parameters = np.repeat(column[:, None], rate_V_s.shape[1], axis=1)
    out = np.empty_like(rate_V_s)
    no_state = np.empty((0, rate_V_s.shape[1]))
    type(law).block(rate_V_s, rate_V_s, parameters, no_state, ts_s, out)
    return out


def start_stages(stages: Sequence[Inverse], y: Array) -> tuple[list[Array], Array]:
    """Return the memories of stages where an output has been held, and what leaves the last one."""
    states = []
    for stage in stages:
        state, y = stage.start(y)
        states.append(state)
    return states, y


def run_stages(
    stages: Sequence[tuple[Inverse, slice]], y: Array, state: Array, begins: bool
) -> Array:
    """Run stages one after the other."""
    for stage, rows in stages:
        y = stage.run(y, state[rows])
        if begins:
            y = y[stage.ahead :]
    return y
