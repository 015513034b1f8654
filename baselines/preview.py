"""Commands planned over the whole reference: ``preview-inversion``, and the same of true plants."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from baselines.base import Baseline, Limits, Observation, limit_block
from baselines.classical import (
    ClassicalLiteral,
    ClassicalLowPassed,
    ClassicalReferenceRate,
    ClassicalStatic,
)
from baselines.core_inverse import CoreInverse
from baselines.extended import ExtendedInverse
from baselines.feedforward import Feedforward, StaticGain, checked_reference, nyquist_gain
from baselines.inverses.linear import delay_weights, inverse_series, preview_weights
from baselines.inversion_free import (
    InversionFreeLiteral,
    InversionFreeLowPassed,
    InversionFreeReferenceRate,
)
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.delay import delay_block
from rdpi_gym.plant.effects.linear import linear_block
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

# Half of the window (samples): the narrowest on which a sharp mode is still met.
_HALF = 2


class LinearUndo:
    """Lags, resonance and delay of a belief, undone in an error that is known to its end.

    Nothing is smoothed, so that the product with the effects stays within the right half-plane at
    every frequency: only then does learning from it converge. That holds for a mode of damping
    0.005 up to a twentieth of the sampling frequency. A lag of about one sample leaves 0.2 % too
    much near Nyquist where the plant's rate is hardly low-passed: learning grows there by at most
    1.0021 an iteration.
    """

    def __init__(self, belief: PlantModel, ts_s: float) -> None:
        self._filters: list[tuple[Array, Array]] = []
        for effect in belief.effects:
            if type(effect).block is delay_block:
                self._filters.append(delay_weights(effect, ts_s))
            elif type(effect).block is linear_block:
                column = effect.coefficients(ts_s, belief.hysteresis)
                offsets = np.arange(-_HALF, _HALF + 1.0)
                weights = preview_weights(inverse_series(column, 2 * _HALF), offsets)
                self._filters.append((weights, offsets))

    def __call__(self, error: Array) -> Array:
        """Return the error before the effects, ``float64[T, B]``."""
        for weights, offsets in self._filters:
            # A corner at the end would be learned again and again: derivatives see a straight line
            # there. What a delay brings in from beyond the end has no effect and stays.
            known = _continued(error) if len(weights) > 2 * _HALF else error
            rows = (len(known) - len(error)) // 2 + np.arange(len(error))
            undone = np.zeros_like(error)
            for weight, offset in zip(weights, offsets, strict=True):
                undone += weight * known[np.clip(rows + int(offset), 0, len(known) - 1)]
            error = undone
        return error


def _continued(error: Array) -> Array:
    steps = np.arange(1.0, _HALF + 1.0)[:, None]
    neighbour = min(1, len(error) - 1)
    before = error[0] + steps[::-1] * (error[0] - error[neighbour])
    after = error[-1] + steps * (error[-1] - error[-1 - neighbour])
    return np.concatenate([before, error, after])


LEARNING_GAIN = 1.0
"""γ to begin with; halved wherever it ceases to help, down to 1/8."""
SMALLEST_GAIN = 0.125
SMOOTHING_HZ = 4000.0
"""Cut-off (Hz) of the zero-phase low-pass on what is learned."""
MOST_ITERATIONS = 200
PATIENCE, PROGRESS = 10, 0.02
"""A lane stagnates when so many iterations bring less than this part of its error."""


def learning_recursion(model: Core, ts_s: float) -> tuple[float, float]:
    """Return how L is sampled: the weight of the sample ahead, 0 or 1/2, and the pole.

    Notes
    -----
    1 / (1 - jω / z0) with jω as (1 - z⁻¹) / Ts backwards in time, L = 1 / (1 + κ (1 - z)), or
    trapezoidal, which has a zero where the literal plant's gain changes its sign, z = -1.
    """
    lag = 1.0 / (model.zero_rad_s * ts_s)
    ahead = 0.0 if nyquist_gain(model, ts_s) > 0.0 else 0.5
    return ahead, (lag - ahead) / (lag + 1.0 - ahead)


@njit(cache=True)
def learning_filter(error: Array, ahead: float, pole: float, smooth: float, learned: Array) -> None:
    """Low-pass an error both ways, so without phase, then run L backwards.

    Beyond its ends the error is taken to stay as it is there, so nothing wraps around.
    """
    samples, lanes = error.shape
    learned[0] = error[0]
    for t in range(1, samples):
        for b in range(lanes):
            learned[t, b] = error[t, b] + smooth * (learned[t - 1, b] - error[t, b])
    for t in range(samples - 2, -1, -1):
        for b in range(lanes):
            learned[t, b] += smooth * (learned[t + 1, b] - learned[t, b])
    later = learned[samples - 1].copy()
    for t in range(samples - 2, -1, -1):
        for b in range(lanes):
            mean = learned[t, b] + ahead * (later[b] - learned[t, b])
            later[b] = learned[t, b]
            learned[t, b] = mean + pole * (learned[t + 1, b] - mean)


def _learn(
    belief: PlantModel,
    ts_s: float,
    limits: Limits,
    reference_um: Array,
    start_V: Array,
    enough_um: float,
) -> tuple[Array, Array]:
    lanes = reference_um.shape[1]
    plant = Plant(belief, ts_s, lanes)
    ahead, pole = learning_recursion(belief.hysteresis, ts_s)
    undo = LinearUndo(belief, ts_s)
    smooth = math.exp(-2.0 * math.pi * SMOOTHING_HZ * ts_s)
    u, learned = start_V.copy(), np.zeros_like(start_V)
    command, error = start_V.copy(), np.zeros_like(start_V)
    best, mark = np.full(lanes, np.inf), np.full(lanes, np.inf)
    gain, since = np.full(lanes, LEARNING_GAIN), np.zeros(lanes, dtype=np.int64)
    done = np.zeros(lanes, dtype=bool)
    for _ in range(MOST_ITERATIONS):
        plant.reset(u0_V=start_V[0])
        e = reference_um - plant.simulate(u)
        rms = np.sqrt(np.mean(e[1:] ** 2, axis=0))  # sample 0 is given, no command changes it
        better = (rms < best) & ~done  # or a lane's result would depend on its neighbours
        best[better], command[:, better], error[:, better] = rms[better], u[:, better], e[:, better]
        moves = best < mark * (1.0 - PROGRESS)
        mark[moves] = best[moves]
        since = np.where(moves, 0, since + 1)
        stuck = since >= PATIENCE
        gain[stuck] *= 0.5
        since[stuck] = 0
        done |= (gain < SMALLEST_GAIN) | (best <= enough_um)
        if done.all():
            break
        u[:, stuck], e[:, stuck] = command[:, stuck], error[:, stuck]
        learning_filter(undo(e[1:]), ahead, pole, smooth, learned[1:])
        u += gain / belief.hysteresis.A * learned
        limit_block(u[1:], u[0].copy(), *limits)
    return command, best


FULL_PREVIEW = "full-preview-inversion"
"""Name of :class:`FullPreviewInversion` in tables."""

# Share of the scale below which an error is that of actions, which are float32.
_ENOUGH = 1e-7
# Fixed, so that a plan does not depend on which other controllers there are; where none of them
# is made for the core, the search stands beside them.
_STARTS: tuple[type[Feedforward], ...] = (
    StaticGain,
    InversionFreeLiteral,
    InversionFreeReferenceRate,
    InversionFreeLowPassed,
    ClassicalLiteral,
    ClassicalReferenceRate,
    ClassicalLowPassed,
    ClassicalStatic,
    ExtendedInverse,
)


NO_PLAN = "there is no plan; call plan(reference_um) with the whole reference, (samples, lanes), before an episode"
"""Refusal of an episode that nobody planned for."""


class Planned(Baseline):
    """Plays back commands that were found for the whole reference before the episode."""

    def __init__(self, belief: PlantModel, layout: ObservationLayout) -> None:
        super().__init__(belief, layout)
        self._plan: Array | None = None

    @abstractmethod
    def _commands(self, reference_um: Array) -> Array:
        """Return u(k) (V), float64[K, B], for references (µm) of that shape."""

    def plan(self, reference_um: ArrayLike) -> Array:
        """Find the commands of the episodes to come.

        Parameters
        ----------
        reference_um
            r(0) ... r(K-1) (µm), ``(K, B)``: one lane for each episode side by side. Lane b is
            played whenever episode b begins anew, until the next plan. One lane serves all.

        Returns
        -------
        float64[K, B]
            u(k) (V); u(0) is the command at rest. The last one is held beyond the end.

        Raises
        ------
        InputError
            The reference has another shape, less than two samples, or is not finite.
        """
        reference = checked_reference(reference_um)
        if len(reference) < 2:
            raise InputError("a reference of one sample to plan over; give two samples or more")
        self._plan = self._commands(reference)
        return self._plan.copy()

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest: the number of samples played, float64[1, B]."""
        return np.zeros((1, len(reference_um)))

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """Play u(k+1); see :meth:`baselines.base.Baseline.next_command`."""
        if self._plan is None:
            raise InputError(NO_PLAN)
        samples, planned = self._plan.shape
        lanes = state.shape[1]
        if planned not in (1, lanes):
            raise InputError(
                f"the plan has {planned} lanes for {lanes} episodes; plan one lane for each, or one for all"
            )
        state += 1.0
        now = np.minimum(state[0].astype(np.int64), samples - 1)
        command: Array = self._plan[now, np.arange(lanes) if planned > 1 else 0]
        return command


class PreviewInversion(Planned):
    """Inverts its belief iteratively over the whole reference.

    See :mod:`baselines.preview`: once from the static inverse and once from the best
    feedforward that is within its stability limit, and the better is kept for each lane: so on its
    belief it is never worse than one of those. It may look ahead, as the plant's right-half-plane
    zero asks; a causal compensator cannot. What it learns is low-passed at 4 kHz, so it does not
    dither. Where the plant is another than its belief, it has no feedback to make up for that.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P5")
    >>> controller = PreviewInversion(plant, ObservationLayout.for_plant(plant, ts_s=5e-5))
    >>> r = 10.0 * np.sin(2 * np.pi * 50.0 * 5e-5 * np.arange(800))[:, None]
    >>> u = controller.plan(r)
    >>> bool(np.abs(Plant(plant, 5e-5).simulate(u) - r).max() < 0.02)
    True

    Notes
    -----
    Where the belief's rate is band-limited below A / (2π S δ2), or Ts is above 2 S δ2 / A, the
    all-sliding plant has a causal inverse too, and only the number of iterations and the
    smoothness stand between the plan and no error at all.
    """

    name = "preview-inversion"

    def _commands(self, reference_um: Array) -> Array:
        return _inverted(self.belief, self.layout, self.limits, reference_um)


class FullPreviewInversion(Planned):
    """Inverts what it is given of every lane, the true plant, over the whole reference.

    It is the bound of those who know the plant and all that is to come: nobody who sees a preview
    can do as much, see :class:`baselines.model_predictive.TrueHorizon`. What is left of the error is what the
    sampling time, the command's range and the numerical inversion leave; no noise enters, since
    nothing is measured. It holds what no controller may hold, so it is no controller: it has no
    name, :func:`~baselines.make_controller` does not make it, and only a benchmark that gives it the
    plants can.

    Parameters
    ----------
    truths
        The plant of each lane, or one for all.
    layout
        As :class:`baselines.base.Baseline`.

    Examples
    --------
    >>> from rdpi_gym.plant import P5
    >>> truths = [P5, P5.with_hysteresis(P5.hysteresis.static())]
    >>> bound = FullPreviewInversion(truths, ObservationLayout.for_plant(P5, ts_s=5e-5))
    >>> r = 10.0 * np.sin(2 * np.pi * 50.0 * 5e-5 * np.arange(800))[:, None]
    >>> u = bound.plan(np.hstack([r, r]))
    >>> bool(np.abs(Plant(truths, 5e-5, lanes=2).simulate(u) - r).max() < 0.02)
    True
    """

    def __init__(self, truths: Sequence[PlantModel], layout: ObservationLayout) -> None:
        super().__init__(truths[0], layout)
        self._truths = tuple(truths)

    def _commands(self, reference_um: Array) -> Array:
        lanes = reference_um.shape[1]
        if len(self._truths) not in (1, lanes):
            raise InputError(
                f"{len(self._truths)} true plants for {lanes} lanes; give one for each, or one for all"
            )
        truths = self._truths * (lanes // len(self._truths))
        command = np.empty_like(reference_um)
        for truth in dict.fromkeys(truths):
            own = np.array([other == truth for other in truths])
            found = _inverted(
                truth, self.layout, self.limits, np.ascontiguousarray(reference_um[:, own])
            )
            command[:, own] = found
        return command


def _inverted(
    model: PlantModel, layout: ObservationLayout, limits: Limits, reference_um: Array
) -> Array:
    """Return the commands that bring a model at rest along a reference, as well as was found."""
    best = np.full(reference_um.shape[1], np.inf)
    command, enough_um = np.empty_like(reference_um), _ENOUGH * layout.scale_um
    for start in _starting_commands(model, layout, limits, reference_um):
        found, rms = _learn(model, layout.ts_s, limits, reference_um, start, enough_um)
        better = rms < best
        command[:, better], best[better] = found[:, better], rms[better]
    return command


def _starting_commands(
    model: PlantModel, layout: ObservationLayout, limits: Limits, reference_um: Array
) -> list[Array]:
    lanes = reference_um.shape[1]
    plant = Plant(model, layout.ts_s, lanes)
    best = np.empty_like(reference_um)
    static: list[Array] = []
    smallest = np.full(lanes, np.inf)
    for feedforward in _starts(model):
        compensator = feedforward(model, layout)
        if not compensator.is_stable:
            continue
        if compensator.needed_preview > layout.preview:  # the whole reference is known
            seeing = replace(layout, preview=compensator.needed_preview)
            compensator = feedforward(model, seeing)
        u = np.full_like(reference_um, limits.rest_V)
        u[1:] = compensator.command_block(reference_um[1:], compensator.start(reference_um[0]))
        plant.reset(u0_V=limits.rest_V)
        rms = np.sqrt(np.mean((reference_um - plant.simulate(u))[1:] ** 2, axis=0))
        best = np.where(rms < smallest, u, best)
        smallest = np.minimum(rms, smallest)
        if isinstance(compensator, ClassicalStatic):
            static = [u]
    return [*static, best]


def _starts(model: PlantModel) -> list[type[Feedforward]]:
    core = model.hysteresis
    suiting = [f for f in _STARTS if f.needs_core is None or isinstance(core, f.needs_core)]
    made_for_it = any(f.needs_core is not None for f in suiting)
    return suiting if made_for_it else [*suiting, CoreInverse]
