"""Feedforward: the command from the reference alone, over blocks or a sample at a time, and its stability.

While every play slides, ξ_i = u - r_i - δ2 v (rising), so a compensator closes a linear recursion in z
through its own memory, with q = δ2 / Ts, g = S / a_0, κ = S δ2 / (A Ts) and p the pole of the low-pass
on the rate (0 where it is literal). Sticking plays drop out of S and only lower g and κ.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import ClassVar

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from baselines.base import Baseline, Observation, Rows, limit_block
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import RDPI, Plant, PlantModel, pack
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

DEFAULT_CUTOFF_HZ = 500.0
"""Low-pass (Hz) on an own rate where that is well within the limit."""
CUTOFF_FRACTION = 0.6
"""Largest part of the limiting cut-off that is used; it leaves a gain margin of 1 / 0.6."""


def spectral_radius(polynomial: Array) -> float:
    """Largest magnitude of a polynomial's roots; 0 where it has none."""
    return float(np.abs(np.roots(polynomial)).max(initial=0.0))


def nyquist_gain(model: Core, ts_s: float) -> float:
    """Gain (µm/V) of the all-sliding plant at z = -1: of RDPI A - 2 (S δ2 / Ts) (1 - p) / (1 + p).

    It is above zero where the sampled plant has minimum phase: its zero is then within the unit
    circle, be it for a long Ts or for a rate that is low-passed below A / (2π S δ2).
    """
    p = model.rate_pole(ts_s)
    return model.A + 2.0 * model.rate_gain_um_s_V / ts_s * (1.0 - p) / (1.0 + p)


def inversion_free_polynomial(model: RDPI, ts_s: float) -> Array:
    """Return the loop of Eq. 6 on its own rate, z² + (g - p - w) z + w - g p with w = g q (1 - p)."""
    p = model.rate_pole(ts_s)
    w = model.g * model.delta2_s / ts_s * (1.0 - p)
    return np.array([1.0, model.g - p - w, w - model.g * p])


def classical_polynomial(model: RDPI, ts_s: float) -> Array:
    """Return the loop of the classical inverse on its own rate, z² - (p + w) z + w, w = κ (1 - p)."""
    p = model.rate_pole(ts_s)
    w = model.S * model.delta2_s / (model.A * ts_s) * (1.0 - p)
    return np.array([1.0, -(p + w), w])


def limiting_cutoff_hz(model: RDPI) -> float:
    """Cut-off A / (2π S δ2) (Hz) below which an own rate may be low-passed as Ts → 0."""
    return model.zero_rad_s / (2.0 * math.pi)


def default_cutoff_hz(model: RDPI) -> float:
    """Low-pass (Hz) of the low-passed compensators: 500, or 0.6 of the limit where that is lower."""
    return min(DEFAULT_CUTOFF_HZ, CUTOFF_FRACTION * limiting_cutoff_hz(model))


def checked_reference(reference_um: ArrayLike) -> Array:
    """Return a reference (µm) as a contiguous float64[T, B]."""
    block = np.ascontiguousarray(reference_um, dtype=np.float64)
    if block.ndim != 2 or block.size == 0:
        raise InputError(
            f"a reference of shape {block.shape}; give (samples, lanes), at least one of each"
        )
    if not np.isfinite(block).all():
        sample, lane = np.argwhere(~np.isfinite(block))[0]
        raise InputError(
            f"sample {sample} of lane {lane} of the reference is {block[sample, lane]}; references are finite displacements (µm)"
        )
    return block


class Feedforward(Baseline):
    """A compensator; its memory has the kernels' rows, u(k-1), v(k-1), n play states, then r(k-1).

    A subclass says by :meth:`compensator_model` which RDPI model it is built on, packs it, states
    what the plays remember at rest, and fills blocks.

    Attributes
    ----------
    any_core : bool
        Whether it inverts any core, by search.
    """

    any_core: ClassVar[bool] = False
    needs_core: ClassVar[type[Core] | None] = RDPI

    def __init__(self, belief: PlantModel, layout: ObservationLayout) -> None:
        super().__init__(belief, layout)
        self.model = self.compensator_model(belief.hysteresis)
        self._parameters = self._packed()
        plant = Plant(belief, layout.ts_s)
        plant.reset(u0_V=self.limits.rest_V)
        rest = self._rest_memory(plant.memory[:, 0])
        self._rest = np.concatenate([[self.limits.rest_V, 0.0], rest, [0.0]])
        n = len(rest)
        self.packed = Rows(weights=n + 1, thresholds=n, delta2_s=1, rate_pole=1, offset_um=1)
        self.rows = Rows(last_command_V=1, last_rate_V_s=1, plays=n, last_reference_um=1)

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the RDPI model that the compensator is built on, from the belief's."""
        return hysteresis

    @abstractmethod
    def _packed(self) -> Array:
        """Return the kernel's parameters of one lane, float64[2n + 4, 1]."""

    @abstractmethod
    def _rest_memory(self, plays_V: Array) -> Array:
        """Return the compensator's play states where the plant's are ξ_i (V), float64[n]."""

    @abstractmethod
    def _fill(self, reference_um: Array, parameters: Array, state: Array, u: Array) -> None:
        """Fill u, float64[T, B], with commands within the limits; move the kernel's rows on."""

    def loop_polynomial(self) -> Array:
        """Return the characteristic polynomial of the loop while all plays slide, in z.

        Highest power first; a constant where nothing is fed back.
        """
        return np.ones(1)

    def stable_where(self) -> str:
        """Say where :meth:`loop_polynomial` has its roots within the unit circle."""
        return "everywhere"

    @property
    def is_stable(self) -> bool:
        """Whether the loop through its own memory decays at this Ts with this belief."""
        return spectral_radius(self.loop_polynomial()) < 1.0

    def certificate(self) -> str | None:
        """Return what is certain of the loop through its own memory; None where it does not decay."""
        polynomial = self.loop_polynomial()
        if len(polynomial) == 1:
            return "no loop: nothing is fed back"
        radius = spectral_radius(polynomial)
        return f"Jury: poles of its own loop within {radius:.4g}" if radius < 1.0 else None

    def warning(self) -> str | None:
        """Return one line where the loop does not decay at this Ts with this belief, else None."""
        if self.is_stable:
            return None
        radius = spectral_radius(self.loop_polynomial())
        return (
            f"outside its stability limit: pole magnitude {radius:.3g} at Ts = {self.layout.ts_s:g} s "
            f"with belief {self.belief.name}; stable {self.stable_where()}"
        )

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest; see :meth:`baselines.base.Baseline.start`."""
        state = np.empty((len(self._rest), len(reference_um)))
        state[:-1] = self._rest[:-1, None]
        state[-1] = reference_um
        return state

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """Answer r(k+1); see :meth:`baselines.base.Baseline.next_command`."""
        command: Array = self._advance(reference_um[1:], state)[0]
        return command

    def command_block(self, reference_um: ArrayLike, state: Array | None = None) -> Array:
        """Return the commands that answer a reference, row by row.

        Parameters
        ----------
        reference_um
            r(k) (µm), ``(T, B)``.
        state
            Memory to go on from, as :meth:`start` returns it, moved on in place; None: at rest at
            the command nearest 0 V, where r(0) has been held. Splitting a block changes nothing.

        Returns
        -------
        float64[T, B]
            u(k) (V), within the limits.

        Raises
        ------
        InputError
            The reference has another shape or is not finite.

        Examples
        --------
        >>> from baselines import make_controller
        >>> from rdpi_gym.plant import Plant, named_plant
        >>> plant = named_plant("P5-static")
        >>> layout = ObservationLayout.for_plant(plant, ts_s=1e-3)
        >>> reference = 10.0 * np.sin(np.arange(100.0) / 10.0)[:, None]
        >>> u = make_controller("classical-static", plant, layout).command_block(reference)
        >>> bool(np.abs(Plant(plant, 1e-3).simulate(u) - reference).max() < 1e-12)
        True
        """
        block = checked_reference(reference_um)
        return self._advance(block, self.start(block[0]) if state is None else state)

    def _advance(self, reference_um: Array, state: Array) -> Array:
        lanes = reference_um.shape[1]
        if self._parameters.shape[1] != lanes:
            self._parameters = np.repeat(self._parameters[:, :1], lanes, axis=1)
        u = np.empty_like(reference_um)
        self._fill(reference_um, self._parameters, state, u)
        state[-1] = reference_um[-1]
        return u

    def _reference_rate(self, reference_um: Array, state: Array) -> Array:
        """Rate of the reference over A (V/s), by backward difference."""
        v = np.empty_like(reference_um)
        _differences(reference_um, state[-1], self.layout.ts_s * self.model.A, v)
        return v


@njit(cache=True)
def _differences(x: Array, before: Array, interval: float, rate: Array) -> None:
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            rate[t, b] = (x[t, b] - (x[t - 1, b] if t else before[b])) / interval


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
