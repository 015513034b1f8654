"""The belief's path between the plays' displacement and the sensor, as linear systems."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from baselines.loops.systems import LinearSystem, Response, gain, weighted
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.effects.delay import delay_block
from rdpi_gym.plant.effects.linear import linear_block
from rdpi_gym.support.arrays import Array


@dataclass(frozen=True)
class Mode:
    """The slowest lightly damped mode of a belief.

    Examples
    --------
    >>> round(Mode(739.0, 0.02).omega0_rad_s)
    4643
    """

    f0_hz: float  # undamped natural frequency (Hz)
    damping: float  # damping ratio ζ

    @property
    def omega0_rad_s(self) -> float:
        """2π f0 (rad/s)."""
        return 2.0 * math.pi * self.f0_hz


@dataclass(frozen=True)
class BeliefPath:
    """The linear part of a belief at a sampling time.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from rdpi_gym.plant import P10
    >>> from rdpi_gym.plant.effects import load_effect
    >>> late = replace(P10, effects=(load_effect("delay")(delay_s=2.5e-4),))
    >>> path = belief_path(late, 1e-4)
    >>> path.mode, round(path.delay_s, 9), path.dynamics.order
    (None, 0.00025, 3)
    """

    dynamics: LinearSystem  # lags, modes and delay in a row, gain 1 at rest
    # The inverted hysteresis for small changes while all plays slide and thresholds move with the
    # rate, over its gain A: 1 where they do not.
    sliding: LinearSystem
    mode: Mode | None  # the slowest one, None where the belief has none
    delay_s: float  # of slow signals (s)

    @property
    def extremes(self) -> tuple[LinearSystem, LinearSystem]:
        """The path with all plays sticking and with all sliding; others lie between."""
        return self.dynamics, self.dynamics * self.sliding


def belief_path(belief: PlantModel, ts_s: float) -> BeliefPath:
    """Return what a belief says of the path; effects that are not linear, and creep, are left out."""
    linear = [e for e in belief.effects if is_linear(e)]
    dynamics = linear_part(linear, belief.hysteresis, ts_s)
    # the response turns by ω times the delay where ω is small
    slow = np.exp(1j * np.array([1e-4]))
    turned = -float(np.angle(dynamics.response(slow))[0]) / 1e-4
    modes = [
        Mode(effect.values[f0], effect.values[damping])
        for effect in linear
        for f0, damping in (("f0_hz", "damping"), ("second_hz", "second_damping"))
        if f0 in effect.values
    ]
    mode = min(modes, key=lambda each: each.f0_hz, default=None)
    return BeliefPath(dynamics, sliding_system(belief.hysteresis, ts_s), mode, turned * ts_s)


def is_linear(effect: Effect) -> bool:
    """Whether an effect is a linear system of few states, or a delay."""
    return type(effect).block in (delay_block, linear_block)


def linear_part(effects: Sequence[Effect], core: Core, ts_s: float) -> LinearSystem:
    """Return the linear ones of effects in a row, as a system."""
    system = gain(1.0)
    for effect in filter(is_linear, effects):
        system = effect_system(effect, core, ts_s) * system
    return system


def effect_system(effect: Effect, core: Core, ts_s: float) -> LinearSystem:
    """Return a linear effect, or a delay, as a system."""
    column = np.array(effect.coefficients(ts_s, core))
    if type(effect).block is delay_block:
        whole, part = int(column[0]), float(column[1])
        return weighted([*([0.0] * whole), 1.0 - part, *([part] if part else [])])
    m = round(math.sqrt(len(column) + 3.0)) - 2
    f = column[: m * m].reshape(m, m)
    g0, g1, c = (column[m * m + k * m : m * m + (k + 1) * m] for k in range(3))
    # x(k+1) = F x + G0 u(k) + G1 u(k+1) with the state x - G1 u
    return LinearSystem(f, f @ g1 + g0, c, float(c @ g1 + column[m * m + 3 * m]))


def sliding_system(core: Core, ts_s: float) -> LinearSystem:
    """Return all plays sliding over A: 1 - κ (1 - z⁻¹) (1 - p) / (1 - p z⁻¹)."""
    p = core.rate_pole(ts_s)
    lead = core.rate_gain_um_s_V / (ts_s * core.A) * (1.0 - p)
    return LinearSystem(np.array([[p]]), np.ones(1), np.array([lead * (p - 1.0)]), 1.0 + lead)


def grid(path: BeliefPath, ts_s: float, points: int = 600) -> tuple[Array, Response]:
    """Return angles (rad a sample) up to half the sampling frequency, close about the mode, and z."""
    angles = np.geomspace(1e-5, math.pi, points)
    if path.mode is not None:
        width = 1.0 + path.mode.damping * np.linspace(-20.0, 20.0, 201)
        angles = np.concatenate([angles, path.mode.omega0_rad_s * ts_s * width])
    angles = np.sort(angles[(angles > 0.0) & (angles <= math.pi)])
    return angles, np.exp(1j * angles)
