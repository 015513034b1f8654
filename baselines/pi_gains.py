"""PI gains from the belief: the SIMC rule, lowered to what lags, a delay and a resonance leave."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from baselines.loops.path import effect_system, sliding_system
from baselines.loops.systems import Response
from baselines.stability import nyquist_gain
from rdpi_gym.plant import PlantModel, check_ts
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.effects.delay import delay_block
from rdpi_gym.plant.effects.linear import linear_block
from rdpi_gym.support.arrays import Array

# Largest |1 / (1 + L)|: gain margin 2, phase margin 29° at least.
_SENSITIVITY = 2.0
_FACTORS = np.geomspace(1e-5, 1.0, 231)
# What the proportional part may leave of |L| < 1 at half the sampling frequency.
_NYQUIST_GAIN = 0.4


class Gains(NamedTuple):
    """Gains of u = kp e + ki ∫ e dt: proportional (V/µm) and integral (V/(µm s)).

    Examples
    --------
    >>> Gains(0.1, 500.0).integral_V_um_s
    500.0
    """

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
    linear = [e for e in belief.effects if type(e).block in (delay_block, linear_block)]
    if not linear:
        return gains
    z = np.exp(1j * _frequencies(linear, ts_s))
    path = np.ones_like(z)
    for effect in linear:
        path = path * effect_system(effect, belief.hysteresis, ts_s).response(z)
    sliding = belief.hysteresis.A * sliding_system(belief.hysteresis, ts_s).response(z)
    plants = (path * sliding, path * belief.hysteresis.a0)
    both = _largest(gains, plants, ts_s, z)
    alone = _largest(Gains(0.0, gains.integral_V_um_s), plants, ts_s, z)
    if alone > both:
        return Gains(0.0, alone * gains.integral_V_um_s)
    return Gains(both * gains.proportional_V_um, both * gains.integral_V_um_s)


def _largest(gains: Gains, plants: tuple[Response, ...], ts_s: float, z: Response) -> float:
    controller = gains.proportional_V_um / z + gains.integral_V_um_s * ts_s / (z - 1.0)
    allowed = 0.0
    for factor in _FACTORS.tolist():
        if min(float(np.abs(1.0 + factor * controller * p).min()) for p in plants) < (
            1.0 / _SENSITIVITY
        ):
            break
        allowed = factor
    return allowed


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
