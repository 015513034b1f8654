"""A plant with effects and its derivatives, one lane each, over one record.

Every derivative is a finite difference between lanes of the stages that the plant itself runs, so
an effect of any kind is fitted by the kernel that simulates it. Lanes share what they have in
common: a change behind the plays does not run the plays again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.arrays import Array
from rdpi_gym.measurement import Record
from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.plant.packing import empty_state, pack
from rdpi_gym.plant.plant import settled_memory
from rdpi_gym.plant.play import given_rate_block, play_columns, rate_block
from rdpi_gym.plant.rdpi import RDPI
from rdpi_gym.plant.stages import Stage

# Samples that run through the stages at a time: their lanes stay in the cache.
_CHUNK = 2048


@dataclass(frozen=True)
class Variant:
    """One lane: the plant with one number changed.

    Parameters
    ----------
    hysteresis
        RDPI parameters.
    effects
        In the chain's order.
    """

    hysteresis: RDPI
    effects: tuple[Effect, ...]


def _in_front(effect: Effect) -> bool:
    return effect.slot in ("input", "rate", "memory")


def _front(variants: Sequence[Variant], record: Record) -> tuple[Array, Array, Array, Array]:
    """Commands, rates and RDPI sums ``[T, F]`` of variants, and their initial play states."""
    lanes = len(variants)
    u = np.repeat(record.u_V[:, None], lanes, axis=1)
    hysteresis = [variant.hysteresis for variant in variants]
    parameters = pack(hysteresis, record.ts_s, [0.0] * lanes)
    state = empty_state(hysteresis[0].n, lanes)
    state[0] = np.nan
    effects = list(zip(*(variant.effects for variant in variants), strict=True))
    for column in effects:
        if column[0].slot == "input":
            u = Stage(column, hysteresis, record.ts_s).run(u, u)
    v = np.empty_like(u)
    rate_block(u, parameters, state, record.ts_s, v)
    for column in effects:
        if column[0].slot == "rate":
            v = Stage(column, hysteresis, record.ts_s).run(v, u)
        elif column[0].slot == "memory":
            for lane, effect in enumerate(column):
                extremum = effect.values["extremum_V"]
                state[2:, lane] = settled_memory(hysteresis[lane].thresholds_V, [extremum])
    initial = state[2:].copy()
    y = np.empty_like(u)
    given_rate_block(u, v, parameters, state, y)
    return u, v, y, initial


def simulate_effects(variants: Sequence[Variant], record: Record) -> Array:
    """Simulate variants of a plant over a record.

    Parameters
    ----------
    variants
        B plants with the same kinds of effects.
    record
        Its command and sampling time.

    Returns
    -------
    float64[T, B]
        Displacement (µm) without offset.
    """
    u, _, y, _ = _front(variants, record)
    for column in zip(*(variant.effects for variant in variants), strict=True):
        if not _in_front(column[0]):
            stage = Stage(column, [v.hysteresis for v in variants], record.ts_s)
            stage.start(record.t_s[0])
            y = stage.run(y, u)
    return y


def jacobian_blocks(
    base: Variant, changed: Sequence[Variant], steps: Array, weight_step: float, record: Record
) -> Iterator[tuple[slice, Array, Array]]:
    """Displacement and its derivatives, block by block of a record.

    Parameters
    ----------
    base
        The plant.
    changed
        The plant with δ2 or one parameter of an effect changed.
    steps : float64[K]
        By how much.
    weight_step
        Change of a weight (µm/V).
    record
        Its command and sampling time.

    Yields
    ------
    slice
        Samples of the block.
    float64[t]
        Displacement (µm), without offset.
    float64[t, n + 1 + K]
        Derivatives by a_0 ... a_n and by the changed numbers.
    """
    ahead = [v for v in changed if _changes_front(base, v)]
    behind = [v for v in changed if not _changes_front(base, v)]
    u, v, y, initial = _front([base, *ahead], record)
    n = base.hysteresis.n
    columns = np.empty((n, len(record.u_V)))
    rest = np.array(base.hysteresis.thresholds_V)
    front_u, front_v = np.ascontiguousarray(u[:, 0]), np.ascontiguousarray(v[:, 0])
    play_columns(
        front_u, front_v, rest, base.hysteresis.delta2_s, initial[:, 0].copy(), columns
    )  # fmt: skip
    lanes = [base, *_a0_changed(base, weight_step), *[base] * n, *ahead, *behind]
    stages = [
        Stage(column, [lane.hysteresis for lane in lanes], record.ts_s)
        for column in zip(*(lane.effects for lane in lanes), strict=True)
        if not _in_front(column[0])
    ]
    for stage in stages:
        stage.start(record.t_s[0])
    order = np.array([changed.index(v) for v in (*ahead, *behind)], dtype=np.intp)
    scale = np.concatenate([np.full(n + 1, weight_step), steps[order]])
    target = np.concatenate([np.arange(n + 1), n + 1 + order])
    for start in range(0, len(record.u_V), _CHUNK):
        part = slice(start, start + _CHUNK)
        x = np.empty((len(y[part]), len(lanes)))
        x[:] = y[part, :1]
        x[:, 1] += weight_step * u[part, 0]
        x[:, 2 : n + 2] += weight_step * columns[:, part].T
        x[:, n + 2 : n + 2 + len(ahead)] = y[part, 1:]
        commands = np.repeat(u[part, :1], len(lanes), axis=1)
        commands[:, n + 2 : n + 2 + len(ahead)] = u[part, 1:]
        for stage in stages:
            x = stage.run(x, commands)
        derivatives = np.empty((len(x), len(scale)))
        derivatives[:, target] = (x[:, 1:] - x[:, :1]) / scale
        yield part, x[:, 0], derivatives


def _changes_front(base: Variant, variant: Variant) -> bool:
    if variant.hysteresis != base.hysteresis:
        return True
    pairs = zip(base.effects, variant.effects, strict=True)
    return any(_in_front(a) and a != b for a, b in pairs)


def _a0_changed(base: Variant, step: float) -> list[Variant]:
    h = base.hysteresis
    weights = (h.a0 + step, *h.weights[1:])
    changed = RDPI(weights, h.thresholds_V, h.delta2_s, h.rate_bandwidth_hz)
    return [Variant(changed, base.effects)]
