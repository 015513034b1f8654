"""``pi`` and ``pi-<feedforward>``: feedback of the measured error, alone or on a feedforward."""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit

from baselines.base import Baseline, Observation, Rows, limited
from baselines.feedforward import Feedforward, nyquist_gain
from baselines.loops import (
    Certificate,
    LinearSystem,
    Response,
    belief_path,
    certify,
    gain,
    grid,
    harmful_mode_hz,
    integrator,
    is_linear,
    largest_factor,
    linear_part,
    loop_warning,
    sliding_system,
    unit_delay,
)
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel, check_ts
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array

_FACTORS = np.geomspace(1e-5, 1.0, 231)
# What the proportional part may leave of |L| < 1 at half the sampling frequency.
_NYQUIST_GAIN = 0.4


class Gains(NamedTuple):
    """Gains of u = kp e + ki ∫ e dt: proportional (V/µm) and integral (V/(µm s))."""

    proportional_V_um: float
    integral_V_um_s: float


def simc_gains(model: Core, ts_s: float) -> Gains:
    """Tune a PI controller to the plant between its slopes a_0 and A.

    Notes
    -----
    While all plays slide, the plant is A (1 - s / z0) behind one sample of delay: no lag, and by
    SIMC's half rule an effective delay θ = Ts + 1 / z0, to which a right-half-plane zero adds its
    time constant. With the tight closed-loop time constant θ that SIMC recommends, the integral gain
    is 1 / (2 A θ) (Skogestad, J. Process Control 13, 2003), and the integral time θ / 3 of the
    improved rule for delay-dominant plants (Grimholt, Skogestad, IFAC PID'12, 2012) gives the
    proportional gain. That rule knows nothing of a zero whose gain grows with frequency, so the
    proportional part is cut back to what |L(z = -1)| of 0.4 leaves, for the sliding and the sticking
    plant (slope a_0) both; the integral part alone reaches 0.5 at most. Phase margin 60° or more.
    """
    check_ts(ts_s)
    delay_s = ts_s + 1.0 / model.zero_rad_s
    integral = 1.0 / (2.0 * model.A * delay_s)
    largest = max(model.a0, abs(nyquist_gain(model, ts_s)))
    room = _NYQUIST_GAIN / largest - 0.5 * integral * ts_s
    return Gains(max(0.0, min(integral * delay_s / 3.0, room)), integral)


def gains_within_margin(gains: Gains, belief: PlantModel, ts_s: float) -> Gains:
    """Lower PI gains until the loop with the belief's linear effects has its margin.

    It sees what the belief has: a mode of the true plant that the belief lacks is met with gains
    for a plant without one, and :meth:`baselines.pi.PI.warning` says up to which frequency such a
    mode makes the loop unstable.
    """
    linear = [e for e in belief.effects if is_linear(e)]
    if not linear:
        return gains
    z = np.exp(1j * _frequencies(linear, ts_s))
    path = linear_part(linear, belief.hysteresis, ts_s).response(z)
    sliding = belief.hysteresis.A * sliding_system(belief.hysteresis, ts_s).response(z)
    plants = (path * sliding, path * belief.hysteresis.a0)
    integral = gains.integral_V_um_s * ts_s / (z - 1.0)
    both, alone = (
        largest_factor([controller * plant for plant in plants], factors=_FACTORS)
        for controller in (gains.proportional_V_um / z + integral, integral)
    )
    if alone > both:
        return Gains(0.0, alone * gains.integral_V_um_s)
    return Gains(both * gains.proportional_V_um, both * gains.integral_V_um_s)


def _frequencies(effects: list[Effect], ts_s: float) -> Array:
    """Angles (rad a sample) up to half the sampling frequency, close together about each mode."""
    angles = [np.geomspace(1e-6, math.pi, 2000)]
    for effect in effects:
        values = effect.values
        for f_hz, damping in (("f0_hz", "damping"), ("second_hz", "second_damping")):
            if f_hz in values:
                width = values[damping] * np.linspace(-20.0, 20.0, 401)
                angles.append(2.0 * math.pi * values[f_hz] * ts_s * (1.0 + width))
    every = np.sort(np.concatenate(angles))
    return every[(every > 0.0) & (every <= math.pi)]


@njit(cache=True)
def _feed_back(
    error: Array,
    state: Array,
    proportional_V_um: float,
    integral_V_um: float,
    low: float,
    high: float,
    step: float,
    u: Array,
) -> None:
    for b in range(error.shape[0]):
        collected = state[1, b] + integral_V_um * error[b]
        wanted = u[b] + proportional_V_um * error[b] + collected
        u[b] = limited(wanted, state[0, b], low, high, step)
        # Anti-windup: where the error drives further into the limit, nothing is collected.
        if (wanted - u[b]) * error[b] <= 0.0:
            state[1, b] = collected
        state[0, b] = u[b]


class PI(Baseline):
    """u(k+1) = feedforward + kp e(k) + ki Ts Σ e, e = r - measured, with anti-windup at the limits.

    Alone it starts from the command at rest. On a feedforward it works on the error that this
    leaves. The gains come from the belief: :func:`baselines.pi.simc_gains`, lowered by
    :func:`baselines.pi.gains_within_margin` where it has lags, a delay or a resonance.

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
        inside = 0 if self.feedforward is None else self.feedforward.rows.total
        self.rows = Rows(last_command_V=1, integral_V=1, feedforward=inside)
        self._per_sample = (self.gains.proportional_V_um, self.gains.integral_V_um_s * layout.ts_s)

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest: last command, integral, then the feedforward's rows."""
        own = np.zeros((2, len(reference_um)))
        own[0] = self.limits.rest_V
        if self.feedforward is None:
            return own
        return np.concatenate([own, self.feedforward.start(reference_um)])

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
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
        """Certificate of the loop on its belief; see :mod:`baselines.loops`."""
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
