"""The decision: paired block bootstrap, corrected for the moves tried, and weights from the same draws.

The correction is that of Romano and Wolf (2005) in one step: the distribution of the largest
studentised gain over all moves of the comparison, their dependence kept, as every draw takes the
same blocks of all moves. The weights are pseudo-BMA+ (Yao, Vehtari, Simpson, Gelman 2018): in each
draw a softmax of the summed scores over the temperature, then the mean over draws. The prior of a
set of k of m effects is 1 / ((m + 1) C(m, k)) (Scott, Berger 2010): every size is as likely as any
other, and every set of one size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rdpi_gym.diagnosis.beam.constants import DRAWS, TAKES, TEMPERATURE
from rdpi_gym.support.arrays import Array


def draw_blocks(blocks: int, seed: int = 0) -> Array:
    """Return the share of each block in each draw of the bootstrap, ``(DRAWS, B)``."""
    rng = np.random.default_rng(seed)
    return rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), DRAWS) / blocks


def chances(gains: Array, bars: Array, draws: Array) -> Array:
    """Return for each move the chance that chance alone makes one of them as good, ``(M,)``.

    Parameters
    ----------
    gains
        What each move gains in each block (nats), ``(M, B)``.
    bars
        Mean gain that each has to exceed (nats), ``(M,)``.
    draws
        Of :func:`draw_blocks`.
    """
    mean = gains.mean(axis=1)
    apart = draws @ gains.T - mean
    spread = np.maximum(apart.std(axis=0), 1e-12)
    largest = (apart / spread).max(axis=1)
    return np.asarray([np.mean(largest >= each) for each in (mean - bars) / spread])


def log_prior(effects: int, offered: int) -> float:
    """Logarithm of the prior of one set of so many effects out of those offered."""
    inside = min(effects, offered)
    return -math.log(offered + 1) - math.log(math.comb(offered, inside))


def drawn_weights(scores: Array, priors: Sequence[float], draws: Array) -> Array:
    """Weights of sets in each draw, ``(DRAWS, K)``, from their scores in each block, ``(K, B)``."""
    blocks = scores.shape[1]
    log_weight = -blocks / TEMPERATURE * (draws @ scores.T) + np.asarray(priors)
    log_weight -= log_weight.max(axis=1, keepdims=True)
    weight = np.exp(log_weight)
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def classes(weights: Array, members: Sequence[frozenset[str]]) -> dict[str, tuple[str, ...]]:
    """Return for each name those that take its weight: their probabilities fall together with its rise."""
    names = sorted(set().union(*members))
    held = np.array([[name in each for name in names] for each in members], dtype=np.float64)
    drawn = weights @ held
    apart = drawn - drawn.mean(axis=0)
    spread = np.sqrt(np.maximum((apart**2).sum(axis=0), 1e-300))
    correlation = (apart.T @ apart) / np.outer(spread, spread)
    return {
        name: tuple(o for j, o in enumerate(names) if j != i and correlation[i, j] < TAKES)
        for i, name in enumerate(names)
    }
