"""``none``: a static gain, so no compensation of hysteresis."""

from __future__ import annotations

import math

import numpy as np

from baselines.feedforward import Feedforward
from baselines.lanes import limit_block
from rdpi_gym.plant import pack
from rdpi_gym.support.arrays import Array

# Commands that are tried at once, and how often: the bracket shrinks to 1e-15 of itself.
_TRIED, _ROUNDS = 65, 9
# How often the first bracket is doubled: beyond, the core saturates.
_DOUBLINGS = 12


class StaticGain(Feedforward):
    """u(k) = (r(k) - offset) / gain: what every compensator has to beat.

    The gain is the belief's static secant gain: slope of the chord from rest to the point of the
    virgin curve (from rest, so slowly that no rate matters) at the largest displacement that the
    layout's references have, centre ± scale. It is the amplitude over the voltage that reaches it;
    where the core saturates below that, the chord ends at the command range.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P5")
    >>> controller = StaticGain(plant, ObservationLayout.for_plant(plant, ts_s=1e-4))
    >>> round(controller.gain_um_V, 4)
    1.0201
    """

    name = "none"
    needs_core = None

    @property
    def gain_um_V(self) -> float:
        """The gain (µm/V)."""
        return 1.0 / float(self._parameters[0, 0])

    def _secant_um_V(self) -> float:
        centre = self.layout.centre_um - self.belief.offset_um
        reach = abs(centre) + self.layout.scale_um
        way = math.copysign(1.0, centre)
        low, high = 0.0, reach / self.belief.hysteresis.A
        for _ in range(_DOUBLINGS):
            if way * self._virgin_um(np.array([way * high]))[0] >= reach:
                break
            low, high = high, 2.0 * high
        else:
            end = max(map(abs, self.layout.command_range_V))
            return float(self._virgin_um(np.array([way * end]))[0] / (way * end))
        for _ in range(_ROUNDS):
            tried = np.linspace(low, high, _TRIED)
            reached = int(np.argmax(way * self._virgin_um(way * tried) >= reach))
            low, high = float(tried[max(reached - 1, 0)]), float(tried[max(reached, 1)])
        return reach / high

    def _virgin_um(self, commands_V: Array) -> Array:
        """Displacements (µm) without offset after slow walks from rest to commands (V)."""
        core, count = self.belief.hysteresis, len(commands_V)
        p = np.repeat(pack([core], self.layout.ts_s, [0.0]), count, axis=1)
        state = np.zeros((2 + core.n, count))
        state[2:] = core.settled(())[:, None]
        y = np.empty((1, count))
        core.block(commands_V[None], np.zeros((1, count)), p, state, y)
        displacement: Array = y[0]
        return displacement

    def _packed(self) -> Array:
        return np.array([[1.0 / self._secant_um_V()]])

    def _rest_memory(self, plays_V: Array) -> Array:
        return np.zeros(0)

    def _fill(self, reference_um: Array, parameters: Array, state: Array, u: Array) -> None:
        np.multiply(reference_um - self.belief.offset_um, parameters[0], out=u)
        limit_block(u, state[0], *self.limits)
