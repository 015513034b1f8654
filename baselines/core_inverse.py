"""``core-inverse``: any hysteresis core inverted by search; and a belief's hysteresis and linear effects."""

from __future__ import annotations

import math

import numpy as np

from baselines.base import Observation
from baselines.classical import ClassicalReferenceRate
from baselines.feedforward import Feedforward
from baselines.inverses.linear import inverse_series
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import RDPI, PlantModel, pack
from rdpi_gym.plant.cores.play import rate_block
from rdpi_gym.plant.effects.linear import linear_block
from rdpi_gym.support.arrays import Array

# Halvings of the bracket, and how often it is laid anew: it shrinks to (1/512)^2 of the range.
_HALVINGS, _ROUNDS = 9, 2


class CoreInverse(Feedforward):
    """The command at which one step of the belief's core gives the reference, found by search.

    It runs the core's own kernel on copies of its memory, a fixed number of times, and halves the
    bracket in which the displacement passes the reference; in the last one it goes along the chord.
    Any core that rises with the newest command is inverted, up to the command's limits. Where the
    rate of the command itself would turn that round (a rate-dependent model at a short sampling
    time), the core is given the rate of the reference over its largest gain.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import Plant, named_plant
    >>> plant = named_plant("P5-static")
    >>> controller = CoreInverse(plant, ObservationLayout.for_plant(plant, ts_s=1e-3))
    >>> reference = 10.0 * np.sin(np.arange(100.0) / 10.0)[:, None]
    >>> y = Plant(plant, 1e-3).simulate(controller.command_block(reference))
    >>> bool(np.abs(y - reference).max() < 1e-9)
    True
    """

    name = "core-inverse"
    any_core = True
    needs_core = None

    def _packed(self) -> Array:
        return pack([self.belief.hysteresis], self.layout.ts_s, [0.0])

    def _rest_memory(self, plays_V: Array) -> Array:
        return plays_V

    def _fill(self, reference_um: Array, parameters: Array, state: Array, u: Array) -> None:
        target = reference_um - self.belief.offset_um
        own_rate = self.belief.hysteresis.rises_at(self.layout.ts_s)
        reference_rate = self._reference_rate(reference_um, state)
        for t in range(len(target)):
            rate = None if own_rate else reference_rate[t]
            low, high = self._reach(state[0])
            for _ in range(_ROUNDS):
                low, high = self._bracket(low, high, target[t], rate, parameters, state)
            before = self._stepped(low, rate, parameters, state[:-1].copy())
            after = self._stepped(high, rate, parameters, state[:-1].copy())
            rise = np.where(after > before, after - before, 1.0)
            u[t] = low + (high - low) * np.clip((target[t] - before) / rise, 0.0, 1.0)
            self._stepped(u[t], rate, parameters, state[:-1])

    def _bracket(
        self,
        low: Array,
        high: Array,
        target: Array,
        rate: Array | None,
        parameters: Array,
        state: Array,
    ) -> tuple[Array, Array]:
        """Neighbours among 513 even commands (V) from `low` to `high`: up to the first the target is not passed."""
        below, above = np.zeros_like(low), np.full_like(low, 1.0)
        for _ in range(_HALVINGS):
            middle = 0.5 * (below + above)
            tried = low + (high - low) * middle
            y = self._stepped(tried, rate, parameters, state[:-1].copy())
            below[:] = np.where(y <= target, middle, below)
            above[:] = np.where(y <= target, above, middle)
        return low + (high - low) * below, low + (high - low) * above

    def _reach(self, last_V: Array) -> tuple[Array, Array]:
        """Lowest and highest command (V) that may follow the last ones."""
        low, high, step = self.limits
        last = np.where(np.isnan(last_V), 0.5 * (low + high), last_V)
        far = np.where(np.isnan(last_V), np.inf, step)
        return np.maximum(low, last - far), np.minimum(high, last + far)

    def _stepped(self, u: Array, rate: Array | None, parameters: Array, state: Array) -> Array:
        """Displacement (µm) of lanes after one sample; their state is moved on."""
        command, y = u[None], np.empty((1, len(u)))
        v = np.empty_like(command)
        if rate is None:
            rate_block(command, parameters, state, self.layout.ts_s, v)
        else:
            v[0], state[0], state[1] = rate, u, rate
        self.belief.hysteresis.block(command, v, parameters, state, y)
        displacement: Array = y[0]
        return displacement


TERMS = 4
"""Powers of θ, from 0 on, of an inverse of linear effects."""


def hysteresis_inverse(belief: PlantModel, layout: ObservationLayout) -> Feedforward:
    """Return the inverse of a belief's hysteresis: the classical one of RDPI, else the bracketed search."""
    inverse: type[Feedforward] = (
        ClassicalReferenceRate if isinstance(belief.hysteresis, RDPI) else CoreInverse
    )
    return inverse(belief, layout)


def inverse_command(
    inverse: Feedforward,
    observation: Observation,
    wanted_um: Array,
    memory: Array,
) -> Array:
    """Return u(k+1) (V), ``(B,)``, with which the hysteresis gives what is wanted."""
    return inverse.next_command(observation, np.stack([wanted_um, wanted_um]), memory)


def linear_inverse(belief: PlantModel, ts_s: float) -> tuple[float, Array]:
    """Return the belief's delay in samples, and its linear effects' inverse in powers of θ."""
    delay, series = 0.0, np.array([1.0, *[0.0] * (TERMS - 1)])
    for effect in belief.effects:
        sampled = effect.sampled_at(ts_s)
        if sampled.name == "delay":
            delay += sampled.values["delay_s"] / ts_s
        elif type(sampled).block is linear_block:
            own = inverse_series(sampled.coefficients(ts_s, belief.hysteresis), TERMS - 1)
            series = np.convolve(series, own)[:TERMS]
    return delay, series


def look_ahead(samples: float, powers: int = TERMS) -> Array:
    """Return what looks ahead by so many samples, in powers of θ."""
    return np.array([samples**q / math.factorial(q) for q in range(powers)])
