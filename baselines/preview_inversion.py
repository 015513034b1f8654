"""Iterative inversion of a model over a reference that is known ahead: u += γ L e.

While all plays slide, the sampled plant is P = A (1 - κ (1 - z⁻¹) (1 - p) / (1 - p z⁻¹)), with
κ = S δ2 / (A Ts) and p the pole of the low-pass on the rate; while all stick it is a_0. L inverts
its zero by a stable recursion backwards in time. There are two ways to sample that recursion, and
each makes |1 - γ L P| ≤ 1 and |1 - γ L a_0| ≤ 1 at every frequency, for any γ up to 2, where the
other does not: the backward one where P has minimum phase, the trapezoidal one where it has not.
Lags, resonance and delay of the model are undone in the error before L, or their phase would turn
learning into its opposite; effects that change the gain alone are met by the iteration.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from baselines.inverses.delay import LinearUndo
from baselines.limits import Limits, limit_block
from baselines.stability import nyquist_gain
from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array

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


def invert_ahead(
    belief: PlantModel,
    ts_s: float,
    limits: Limits,
    reference_um: Array,
    starts_V: Sequence[Array],
    enough_um: float,
) -> Array:
    """Return the commands that bring a model at rest along a reference, as well as was found."""
    best = np.full(reference_um.shape[1], np.inf)
    command = np.empty_like(reference_um)
    for start in starts_V:
        found, rms = _learn(belief, ts_s, limits, reference_um, start, enough_um)
        better = rms < best
        command[:, better], best[better] = found[:, better], rms[better]
    return command


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
