"""What bounds a step of the vector environment: bytes and operations a lane, measured ceilings.

Part of ``python -m studies.vector_speed``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from itertools import cycle
from statistics import median

import numpy as np
import pandas as pd
from gymnasium.vector.utils import batch_space
from numba import njit, prange

from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.plant import empty_state, pack
from rdpi_gym.plant.cores.play import rdpi_block
from rdpi_gym.support.arrays import Array

# Calls of one measurement: a millisecond or two, so that other work rarely falls into all of them.
_CALLS = 20


def bytes_a_lane(plays: int, preview: int) -> dict[str, int]:
    """Count the bytes that a step of the bare plant reads and writes for one lane."""
    observation = 4 * (preview + 3)
    return {
        "parameters read": 8 * (2 * plays + 4),
        "state read and written": 16 * (plays + 2),
        "command and clipped steps, read and written": 32,
        "reference's parameters read": 40,
        "reference written ahead and read": 16,
        "action read, written as float64 and read": 20,
        "newest of the observation written, all of it read, written for the caller": 12
        + 2 * observation,
        "info and its masks, reward, flags written": 55,
    }


def operations_a_lane(plays: int) -> dict[str, int]:
    """Count the arithmetic operations of a step of the bare plant for one lane.

    A sum, a product, a comparison, a minimum and a rounding are one operation each.
    """
    return {
        "play operators and their sum": 9 * plays,
        "rate and a_0 u": 9,
        "action to command": 11,
        "sine": 34,
        "reference, error, reward, observation": 18,
    }


@njit(cache=True)
def _copy(source: Array, target: Array) -> None:
    for i in range(len(source)):
        target[i] = source[i]


@njit(cache=True, parallel=True)
def _copy_parallel(source: Array, target: Array, threads: int) -> None:
    size = len(source)
    for thread in prange(threads):
        for i in range(thread * size // threads, (thread + 1) * size // threads):
            target[i] = source[i]


@njit(cache=True, fastmath={"contract"})
def _multiply_and_add(x: Array) -> None:
    # Thirty-two of each between a load and a store, for as many elements at once as units take.
    for i in range(len(x)):
        value = x[i]
        for _ in range(32):
            value = value * 0.999 + 0.001
        x[i] = value


def microseconds(call: Callable[[], object], repeats: int) -> float:
    """Return the median time of a call (µs) over `repeats` short measurements."""
    call()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        for _ in range(_CALLS):
            call()
        times.append((time.perf_counter() - start) / _CALLS)
    return 1e6 * median(times)


def bare_kernel(env: PiezoTrackingVectorEnv) -> Callable[[], None]:
    """Return a call that advances the bare plant of every lane by one sample, by ``rdpi_block``."""
    lanes, hysteresis, ts_s = env.num_envs, env.nominal.hysteresis, env.layout.ts_s
    parameters = pack([hysteresis] * lanes, ts_s, [0.0] * lanes)
    state, y = empty_state(hysteresis.n, lanes), np.empty((1, lanes))
    low, high = env.layout.command_range_V
    commands = cycle(np.random.default_rng(0).uniform(low, high, (4, 1, lanes)))

    def step() -> None:
        rdpi_block(next(commands), parameters, state, ts_s, y)

    return step


def roofline(lanes: int, repeats: int) -> pd.DataFrame:
    """Measure the ceilings, and what the default environment's step takes beside them."""
    envs = {n: PiezoTrackingVectorEnv(lanes, threads=n, randomise=0.1) for n in (1, 2)}
    layout, plays = envs[1].layout, envs[1].nominal.hysteresis.n
    moved = sum(bytes_a_lane(plays, layout.preview).values())
    operations = sum(operations_a_lane(plays).values())
    # A copy reads and writes: half of the bytes each.
    source = np.ones(max(moved * lanes // 16, 1))
    target, small = np.empty_like(source), np.ones(1024)
    copy_us = microseconds(partial(_copy, source, target), repeats)
    copy_two_us = microseconds(partial(_copy_parallel, source, target, 2), repeats)
    arithmetic_us = microseconds(partial(_multiply_and_add, small), repeats)
    gigaflops = 64e-3 * len(small) / arithmetic_us
    copied = 2e-3 * source.nbytes
    bound_us = operations * lanes / (1e3 * gigaflops)
    bare_us = microseconds(bare_kernel(envs[1]), repeats)
    rows: list[tuple[str, float, float, str]] = [
        ("bytes of a lane and step", moved, moved, "bytes"),
        ("operations of a lane and step", operations, operations, ""),
        ("ceiling: copy of as many bytes", copied / copy_us, copied / copy_two_us, "GB/s"),
        ("ceiling: products and sums", gigaflops, 2 * gigaflops, "Gflop/s"),
        ("step at the ceiling of the copy", copy_us, copy_two_us, "µs"),
        ("step at the ceiling of arithmetic", bound_us, bound_us / 2, "µs"),
        ("rdpi_block alone", bare_us, bare_us, "µs"),
    ]
    steps: dict[int, list[float]] = {}
    for threads, env in envs.items():
        env.reset(seed=0)
        actions = env.action_space.sample()
        numbers = actions[:, 0].astype(np.float64)
        steps[threads] = [
            microseconds(partial(env.task.advance, numbers), repeats),
            microseconds(partial(env.step, actions), repeats),
        ]
    for name, one, two in zip(
        ("compiled part of a step", "step()"), steps[1], steps[2], strict=True
    ):
        rows.append((name, one, two, "µs"))
    spaces = {
        "action_space.sample()": envs[1].action_space,
        "the same by Box.sample()": batch_space(envs[1].single_action_space, lanes),
    }
    for name, space in spaces.items():
        drawing_us = microseconds(space.sample, repeats)
        rows.append((name, drawing_us, drawing_us, "µs"))
    return pd.DataFrame(rows, columns=["quantity", "one_thread", "two_threads", "unit"])
