"""``pi`` and ``pi-<feedforward>``: feedback of the measured error, alone or on a feedforward."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.base import Baseline
from baselines.feedforward import Feedforward
from baselines.limits import limited
from baselines.loops.certificates import Certificate, certify, harmful_mode_hz, loop_warning
from baselines.loops.path import belief_path, grid
from baselines.loops.systems import LinearSystem, Response, gain, integrator, unit_delay
from baselines.pi_gains import gains_within_margin, simc_gains
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def _feed_back(
    error: Array,
    state: Array,
    proportional: float,
    integral: float,
    low: float,
    high: float,
    step: float,
    u: Array,
) -> None:
    for b in range(error.shape[0]):
        collected = state[1, b] + integral * error[b]
        wanted = u[b] + proportional * error[b] + collected
        u[b] = limited(wanted, state[0, b], low, high, step)
        # Anti-windup: where the error drives further into the limit, nothing is collected.
        if (wanted - u[b]) * error[b] <= 0.0:
            state[1, b] = collected
        state[0, b] = u[b]


class PI(Baseline):
    """u(k+1) = feedforward + kp e(k) + ki Ts Σ e, e = r - measured, with anti-windup at the limits.

    Alone it starts from the command at rest. On a feedforward it works on the error that this
    leaves. The gains come from the belief: :func:`baselines.pi_gains.simc_gains`, lowered by
    :func:`baselines.pi_gains.gains_within_margin` where it has lags, a delay or a resonance.

    Parameters
    ----------
    belief, layout
        As :class:`baselines.base.Baseline`.
    feedforward
        Class of the feedforward; None: feedback alone.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P5")
    >>> controller = PI(plant, ObservationLayout.for_plant(plant, ts_s=1e-4))
    >>> round(controller.gains.integral_V_um_s)
    1638
    """

    name = "pi"
    on_feedforwards = True

    def __init__(
        self,
        belief: PlantModel,
        layout: ObservationLayout,
        feedforward: type[Feedforward] | None = None,
    ) -> None:
        super().__init__(belief, layout)
        simc = simc_gains(belief.hysteresis, layout.ts_s)
        self.gains = gains_within_margin(simc, belief, layout.ts_s)
        self.feedforward = None if feedforward is None else feedforward(belief, layout)
        self._per_sample = (self.gains.proportional_V_um, self.gains.integral_V_um_s * layout.ts_s)

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest: last command, integral, then the feedforward's rows."""
        own = np.zeros((2, len(reference_um)))
        own[0] = self.limits.rest_V
        if self.feedforward is None:
            return own
        return np.concatenate([own, self.feedforward.start(reference_um)])

    def next_command(
        self, observation: NDArray[np.floating[Any]], reference_um: Array, state: Array
    ) -> Array:
        """Answer e(k) and r(k+1); see :meth:`baselines.base.Baseline.next_command`."""
        if self.feedforward is None:
            u = np.full(len(observation), self.limits.rest_V)
        else:
            u = self.feedforward.next_command(observation, reference_um, state[2:])
        error = reference_um[0] - self.layout.measured_um(observation)
        _feed_back(error, state, *self._per_sample, *self.limits, u)
        return u

    @property
    def needed_preview(self) -> int:
        """That of the feedforward."""
        return 1 if self.feedforward is None else self.feedforward.needed_preview

    @cached_property
    def _loops(self) -> tuple[tuple[LinearSystem, ...], Array, Response, bool]:
        """Open loops at the gain A, sticking and sliding, points to look at, whether there is a mode."""
        ts_s, core = self.layout.ts_s, self.belief.hysteresis
        path = belief_path(self.belief, ts_s)
        feedback = integrator(ts_s).times(self.gains.integral_V_um_s)
        feedback = (feedback + gain(self.gains.proportional_V_um)).times(core.A)
        loops = tuple(unit_delay() * feedback * each for each in path.extremes)
        return loops, *grid(path, ts_s), path.mode is not None

    @cached_property
    def certified(self) -> Certificate:
        """What is certain of the loop on its belief; see :mod:`baselines.loops.certificates`."""
        loops, _, z, _ = self._loops
        lowest = self.belief.hysteresis.a0 / self.belief.hysteresis.A
        return certify(loops, z, (lowest, 1.0), steady=(lowest, 1.0))

    def certificate(self) -> str | None:
        """Return what is certain of the loop on its belief in one line; None where nothing is."""
        return self.certified.line()

    def warning(self) -> str | None:
        """Return the feedforward's warning, else one on the loop.

        On a belief without a mode it says up to which frequency a mode of the true plant makes the
        loop unstable: the gains know of none.
        """
        said = None if self.feedforward is None else self.feedforward.warning()
        if said is not None:
            return said
        loops, angles, z, has_mode = self._loops
        responses = [] if has_mode else [loop.response(z) for loop in loops]
        highest = [harmful_mode_hz(each, angles, self.layout.ts_s) for each in responses]
        return loop_warning(
            self.certified, max(highest, default=None), self.belief, self.layout.ts_s
        )
