"""Steps per second of the vector environment beside Gymnasium's vector CartPole, in one process.

    python -m studies.vector_speed

In every round each case is measured in turn with CartPole and with the bare kernel (``rdpi_block``
on as many lanes, one sample a call, one thread), so that a machine that slows down slows all three,
and the medians of the rounds' ratios count. ``benchmark_vector_step`` is Gymnasium's own measure;
it draws random actions for each step. What bounds a step follows (:mod:`studies.vector_speed`).
"""

from __future__ import annotations

import os
import platform
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from itertools import cycle
from pathlib import Path
from statistics import median
from typing import Any, cast

import gymnasium as gym
import numba
import numpy as np
import pandas as pd
from gymnasium.utils.performance import benchmark_vector_step
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numba import njit, prange

import rdpi_gym  # noqa: F401  # registers the environment
from baselines.learned.options import PHASES, TrainingOptions
from rdpi_gym.envs.layout import DEFAULT_FIELDS
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.plant import empty_state, named_plant, pack
from rdpi_gym.plant.cores.play import rdpi_block
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.command_line import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from studies.runner import Files, Study

# Calls of one measurement: a millisecond or two, so that other work rarely falls into all of them.
_CALLS = 20


def bytes_a_lane(plays: int, preview: int) -> dict[str, int]:
    """Count the bytes that a step of the bare plant reads and writes for one lane."""
    observation = 4 * (preview + len(DEFAULT_FIELDS))
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


# Declared for whole seconds; any number of them works.
_benchmark: Callable[[Any, float, int], float] = cast(Any, benchmark_vector_step)
RESULTS = Path(__file__).parent / "results"
SPEED, ROOFLINE = "vector_speed", "vector_roofline"
YARDSTICK = "CartPole-v1"
PIEZO = "rdpi_gym/PiezoTracking-v0"
LANES = 4096
THREADS = (1, 2)
AS_TRAINED = "as in a training, in ten groups"
FIVE = ("actuator_lag", "creep", "resonance", "delay", "sensor_lag")
_TRAINED = TrainingOptions(Path(), action="increment")
# The plant with most effects of those that agents are trained on, and all that a training asks for.
_AS_TRAINED: dict[str, Any] = {
    "plant": _TRAINED.models[0], "max_episode_steps": _TRAINED.episode, **_TRAINED.environment()
}  # fmt: skip
_FIVE_EFFECTS = replace(named_plant("P10"), effects=tuple(CATALOGUE[name]() for name in FIVE))


def step_beforehand(env: VectorEnv[Any, Any, Any], duration_s: float, seed: int) -> float:
    """Measure steps per second as ``benchmark_vector_step`` does, with actions drawn beforehand."""
    env.action_space.seed(seed)
    actions = [env.action_space.sample() for _ in range(20)]
    env.reset(seed=seed)
    return _steps_per_s(env, duration_s, lambda k: actions[k % len(actions)])


def step_plain_box(env: VectorEnv[Any, Any, Any], duration_s: float, seed: int) -> float:
    """Measure as ``benchmark_vector_step`` does, with actions from Gymnasium's ``Box.sample``."""
    space = env.action_space
    env.action_space = batch_space(env.single_action_space, env.num_envs)
    try:
        return _benchmark(env, duration_s, seed)
    finally:
        env.action_space = space


def step_staggered(env: VectorEnv[Any, Any, Any], duration_s: float, seed: int) -> float:
    """Measure with episodes that end in other lanes at every step; CartPole's always do."""
    return _step_apart(env, duration_s, seed, None)


def step_in_groups(env: VectorEnv[Any, Any, Any], duration_s: float, seed: int) -> float:
    """Measure with lanes in as many groups as the native PPO has, whose episodes begin in turn."""
    return _step_apart(env, duration_s, seed, PHASES)


def _step_apart(
    env: VectorEnv[Any, Any, Any], duration_s: float, seed: int, groups: int | None
) -> float:
    env.action_space.seed(seed)
    env.reset(seed=seed)
    if env.spec is not None and env.spec.id == PIEZO:
        steps = env.spec.kwargs["max_episode_steps"]
        apart = steps // min(groups or steps, steps)
        for k in range(steps):
            env.step(env.action_space.sample())
            mask = np.arange(env.num_envs) % (steps // apart) * apart == k
            if mask.any():
                env.reset(options={"reset_mask": mask})
    return _steps_per_s(env, duration_s, lambda _: env.action_space.sample())


def _steps_per_s(
    env: VectorEnv[Any, Any, Any], duration_s: float, action: Callable[[int], Any]
) -> float:
    return env.num_envs * _calls_per_s(lambda k: env.step(action(k)), duration_s)


def _calls_per_s(call: Callable[[int], object], duration_s: float) -> float:
    call(0)
    calls, start = 0, time.perf_counter()
    while True:
        call(calls)
        calls += 1
        seconds = time.perf_counter() - start
        if seconds > duration_s:
            return calls / seconds


Measure = Callable[[Any, float, int], float]
CASES: dict[str, tuple[Measure, dict[str, Any]]] = {
    "defaults": (_benchmark, {}),
    "defaults, actions drawn beforehand": (step_beforehand, {}),
    "defaults, actions from a plain Box": (step_plain_box, {}),
    "randomised plants": (_benchmark, {"randomise": 0.1}),
    "randomised plants, episodes end at different times": (step_staggered, {"randomise": 0.1}),
    "five effects": (_benchmark, {"plant": _FIVE_EFFECTS}),
    "five effects, plants and effects randomised": (
        _benchmark,
        {"plant": _FIVE_EFFECTS, "randomise": 0.1, "randomise_effects": 0.2},
    ),
    "noisy sensor, randomised plants": (_benchmark, {"plant": "P10-bench", "randomise": 0.1}),
    "triangles, from a table": (_benchmark, {"reference": "triangle"}),
    AS_TRAINED: (step_in_groups, _AS_TRAINED),
    "as in a training, episodes end at different times": (step_staggered, _AS_TRAINED),
    "correction of a baseline": (
        _benchmark,
        {"action": "correction", "baseline": "classical-low-passed"},
    ),
}
"""What is measured: how, CartPole too, and the environment's keywords."""


def measure(
    rounds: int,
    duration_s: float,
    lanes: int = LANES,
    threads: Sequence[int] = THREADS,
    cases: Sequence[str] = tuple(CASES),
) -> pd.DataFrame:
    """Measure every case in turn with the yardstick and the bare kernel."""
    yardstick = gym.make_vec(YARDSTICK, num_envs=lanes, vectorization_mode="vector_entry_point")
    envs = {
        (case, count): gym.make_vec(
            PIEZO,
            num_envs=lanes,
            vectorization_mode="vector_entry_point",
            threads=count,
            **CASES[case][1],
        )
        for case in cases
        for count in threads
    }
    bare = bare_kernel(cast(Any, next(iter(envs.values())).unwrapped))
    for env in envs.values():
        _benchmark(env, 0, 0)  # compiled kernels are loaded before the clock runs
    found = np.array(
        [
            _in_turn(CASES[case][0], env, yardstick, bare, duration_s, seed)
            for seed in range(rounds)
            for (case, _), env in envs.items()
        ]
    ).reshape(rounds, len(envs), 3)
    for env in (yardstick, *envs.values()):
        env.close()
    rows, load = [], os.getloadavg()[0]
    for place, (case, count) in enumerate(envs):
        ours, theirs, kernel = found[:, place].T
        plain = found[:, list(envs).index((cases[0], count)), 0]
        rows.append(
            {
                "case": case,
                "threads": count,
                "million_steps_per_s": np.median(ours) / 1e6,
                "cartpole": np.median(theirs) / 1e6,
                "bare_kernel": np.median(kernel) / 1e6,
                "times_cartpole": np.median(ours / theirs),
                "lowest": np.min(ours / theirs),
                "highest": np.max(ours / theirs),
                "share_of_bare": np.median(ours / kernel),
                "share_of_defaults": np.median(ours / plain),
                "load": load,
            }
        )
    return pd.DataFrame(rows)


def _in_turn(
    steps_per_s: Measure, env: Any, yardstick: Any, bare: Callable[[], None], duration_s: float,
    seed: int,
) -> tuple[float, float, float]:  # fmt: skip
    # A plain Box and staggered ends are ours alone: CartPole's space and episodes are what they are.
    theirs = step_beforehand if steps_per_s is step_beforehand else _benchmark
    return (
        steps_per_s(env, duration_s, seed),
        theirs(yardstick, duration_s, seed),
        _calls_per_s(lambda _: bare(), duration_s / 4) * env.num_envs,
    )


def as_markdown(
    speed: pd.DataFrame, bounds: pd.DataFrame, lanes: int, rounds: int, duration_s: float
) -> str:
    """Return the tables with what was measured and how."""
    return (
        f"# {PIEZO} beside {YARDSTICK}, {lanes} lanes\n\n"
        f"Written by `python -m studies.vector_speed`: {rounds} rounds of {duration_s:g} s, ours, "
        "CartPole's vector environment and the bare kernel (`rdpi_block`, ten plays, one sample a "
        "call, one thread) in turn in one process; medians, in million steps per second of one lane, "
        "and medians of the rounds' ratios (`lowest` and `highest` are those to CartPole). "
        "`benchmark_vector_step` is Gymnasium's own measure and draws random actions for each step. "
        "The environment's action space is equal to a `Box`, but spreads one random word over the "
        "lanes (SplitMix64) where `Box.sample` draws 64 bits a number and sorts coordinates by kind of "
        "bound; the rows with a plain Box draw by `Box.sample` instead, those with actions drawn "
        "beforehand leave drawing out on both sides. The five effects are "
        f"{', '.join(FIVE)}. A training has increments as actions, the noise of a sensor, plants and effects "
        f"drawn for each episode of {_TRAINED.episode} samples, and sines, triangles and multisines; the row "
        "is of its plant with a lag, creep and a mode, in as many groups of lanes as the native PPO's, whose "
        "episodes begin in turn. Rows that `--only` has measured anew are of a run of their own, beside the "
        "defaults of that run. `load` is the number of processes that wanted the cores at its end, one of "
        "them this one, empty where it was not noted: two threads, which wait for each other, say little "
        "beside others.\n\n"
        f"Gymnasium {version('gymnasium')}, NumPy {version('numpy')}, numba {version('numba')} "
        f"(threading layer {_threading_layer()}), Python {platform.python_version()}, "
        f"{platform.machine()}, {os.cpu_count()} cores; each thread bound to a core "
        "(`OMP_PROC_BIND=true`).\n\n"
        f"{frame_table(speed)}\n\n"
        "## What bounds a step\n\n"
        "Default task with plants of their own (`randomise=0.1`), medians of short measurements. Bytes "
        "and operations are counted from what the kernels read, write and compute; a copy of as many "
        "bytes and a loop of products and sums in registers are the measured ceilings.\n\n"
        f"{frame_table(bounds)}\n"
    )


def _threading_layer() -> str:
    try:
        return str(numba.threading_layer())
    except ValueError:
        return "not loaded"


def _measure_all(chosen: Namespace) -> Files:
    # Read when the first parallel kernel loads: each thread keeps to a core. Otherwise the system puts
    # both on one now and then, for a whole measurement.
    os.environ.setdefault("OMP_PROC_BIND", "true")
    if chosen.only is None:
        speed = measure(chosen.rounds, chosen.duration, chosen.lanes, chosen.threads, list(CASES))
        bounds = roofline(chosen.lanes, repeats=10 * chosen.rounds)
    else:
        bounds = _read(chosen.out / f"{ROOFLINE}.csv")
        speed = _measured_again(chosen)
    text = as_markdown(speed, bounds, chosen.lanes, chosen.rounds, chosen.duration)
    return {f"{SPEED}.csv": speed, f"{ROOFLINE}.csv": bounds, f"{SPEED}.md": text}


def _measured_again(chosen: Namespace) -> pd.DataFrame:
    """Return the committed rows, some of them measured anew beside the defaults."""
    plain, *others = CASES
    again = [case for case in others if chosen.only in case]
    if not again:
        raise InputError(f"no case has {chosen.only!r} in its name; they are {'; '.join(others)}")
    kept = _read(chosen.out / f"{SPEED}.csv")
    cases = [plain, *again]
    table = measure(chosen.rounds, chosen.duration, chosen.lanes, chosen.threads, cases)
    stays = ~(kept["case"].isin(again) & kept["threads"].isin(chosen.threads))
    rows = pd.concat([kept[stays], table[table["case"].isin(again)]])
    order = {case: i for i, case in enumerate(CASES)}
    place = rows["case"].map(order) * 1000 + rows["threads"]
    return rows.iloc[np.argsort(place, kind="stable")]


def _read(path: Path) -> pd.DataFrame:
    if not path.exists():
        raise InputError(f"{path} is missing; measure all cases first")
    return pd.read_csv(path)


def _more(options: Options) -> None:
    options.add_argument("--duration", type=float, default=0.25, help="of each measurement (s)")
    options.add_argument(
        "--only", metavar="WORD", help="measure cases with it in their name; other rows stay"
    )
    options.add_argument(
        "--threads", type=int, nargs="+", default=list(THREADS), metavar="N", help="of the lanes"
    )


main = Study(
    "vector_speed", __doc__, _measure_all, RESULTS,
    numbers=(("--rounds", 9, "of timing"), ("--lanes", LANES, "plants side by side")),
    more=_more, csv="%.4g",
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
