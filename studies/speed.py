"""Speed of the vector environment, core kernels and trainings, each beside a yardstick.

    python -m studies.speed                 # every part
    python -m studies.speed vector core     # some of them

In every round each case is measured in turn with its yardstick in one process, so that a machine that
slows down slows both; medians of the rounds and of the rounds' ratios count.
"""

from __future__ import annotations

import dataclasses
import os
import platform
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from importlib.metadata import version
from itertools import cycle
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numba
import numpy as np
import pandas as pd
from gymnasium.utils.performance import benchmark_vector_step
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space

import rdpi_gym  # noqa: F401  # registers the environment
from baselines.learned.options import PHASES, TrainingOptions
from rdpi_gym.envs.tasks import TASKS, named_task
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.plant import CORES, P10, pack
from rdpi_gym.plant.cores.base import Core, empty_state
from rdpi_gym.plant.cores.play import rdpi_block
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.command import Options
from rdpi_gym.support.markdown import frame_table
from studies.runner import RESULTS, Files, Study, names_of

YARDSTICK, PIEZO = "CartPole-v1", "rdpi_gym/PiezoTracking-v0"
AS_TRAINED = "as in a training, in ten groups"
FIVE = ("actuator_lag", "creep", "resonance", "delay", "sensor_lag")
_FIVE_EFFECTS = dataclasses.replace(P10, effects=tuple(CATALOGUE[name]() for name in FIVE))
_TRAINED = TrainingOptions(Path(), action="increment")
# The plant with most effects of those that agents are trained on, and all that a training asks for.
_AS_TRAINED: dict[str, Any] = {
    "plant": _TRAINED.models[0], "max_episode_steps": _TRAINED.episode, **_TRAINED.environment()
}  # fmt: skip
THREADS = tuple(n for n in (1, 2) if n <= numba.config.NUMBA_NUM_THREADS)
"""Threads of the vector environments: one, and two where the process has as many cores."""
Environment = VectorEnv[Any, Any, Any]
Measure = Callable[[Any, float, int], float]
# Declared for whole seconds; any number of them works.
_benchmark: Measure = cast(Any, benchmark_vector_step)


def step_beforehand(env: Environment, duration_s: float, seed: int) -> float:
    """Measure steps per second as ``benchmark_vector_step`` does, with actions drawn beforehand."""
    env.action_space.seed(seed)
    actions = [env.action_space.sample() for _ in range(20)]
    env.reset(seed=seed)
    return env.num_envs * _calls_per_s(lambda k: env.step(actions[k % 20]), duration_s)


def step_plain_box(env: Environment, duration_s: float, seed: int) -> float:
    """Measure as ``benchmark_vector_step`` does, with actions from Gymnasium's ``Box.sample``."""
    space = env.action_space
    env.action_space = batch_space(env.single_action_space, env.num_envs)
    try:
        return _benchmark(env, duration_s, seed)
    finally:
        env.action_space = space


def step_apart(env: Environment, duration_s: float, seed: int, groups: int | None = None) -> float:
    """Measure with groups of lanes whose episodes begin in turn; None: at every step some."""
    env.action_space.seed(seed)
    env.reset(seed=seed)
    assert env.spec is not None
    steps = env.spec.kwargs["max_episode_steps"]
    apart = steps // min(groups or steps, steps)
    for k in range(steps):
        env.step(env.action_space.sample())
        mask = np.arange(env.num_envs) % (steps // apart) * apart == k
        if mask.any():
            env.reset(options={"reset_mask": mask})
    return env.num_envs * _calls_per_s(lambda _: env.step(env.action_space.sample()), duration_s)


def _calls_per_s(call: Callable[[int], object], duration_s: float) -> float:
    call(0)
    calls, start = 0, time.perf_counter()
    while True:
        call(calls)
        calls += 1
        seconds = time.perf_counter() - start
        if seconds > duration_s:
            return calls / seconds


CASES: dict[str, tuple[Measure, dict[str, Any]]] = {
    "defaults": (_benchmark, {}),
    "defaults, actions drawn beforehand": (step_beforehand, {}),
    "defaults, actions from a plain Box": (step_plain_box, {}),
    "randomised plants": (_benchmark, {"randomise": 0.1}),
    "randomised plants, episodes end at different times": (step_apart, {"randomise": 0.1}),
    "five effects": (_benchmark, {"plant": _FIVE_EFFECTS}),
    "five effects, plants and effects randomised": (
        _benchmark,
        {"plant": _FIVE_EFFECTS, "randomise": 0.1, "randomise_effects": 0.2},
    ),
    "noisy sensor, randomised plants": (_benchmark, {"plant": "P10-bench", "randomise": 0.1}),
    "triangles, from a table": (_benchmark, {"reference": "triangle"}),
    AS_TRAINED: (partial(step_apart, groups=PHASES), _AS_TRAINED),
    "as in a training, episodes end at different times": (step_apart, _AS_TRAINED),
    "correction of a baseline": (
        _benchmark,
        {"action": "correction", "baseline": "classical-low-passed"},
    ),
}
"""Measures and keywords of the vector environment."""
TASK_CASES: dict[str, tuple[Measure, dict[str, Any]]] = {
    task.id: (_benchmark, {"name": task.id}) for task in TASKS.values()
}
"""The same of the tasks, with their defaults."""


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


def vector(
    rounds: int,
    duration_s: float = 0.25,
    lanes: int = 4096,
    threads: Sequence[int] = THREADS,
    cases: Sequence[str] = tuple(CASES),
) -> pd.DataFrame:
    """Measure the vector environment with vector CartPole and with the bare kernel, one thread."""
    # Read when the first parallel kernel loads: each thread keeps to a core. Otherwise the system puts
    # both on one now and then, for a whole measurement.
    os.environ.setdefault("OMP_PROC_BIND", "true")

    def make(name: str = PIEZO, **keywords: Any) -> Any:
        mode = "vector_entry_point"
        return gym.make_vec(name, num_envs=lanes, vectorization_mode=mode, **keywords)

    known = CASES | TASK_CASES
    yardstick = make(YARDSTICK)
    envs = {(case, n): make(threads=n, **known[case][1]) for case in cases for n in threads}
    bare = bare_kernel(next(iter(envs.values())).unwrapped)
    for env in envs.values():
        _benchmark(env, 0, 0)  # compiled kernels are loaded before the clock runs
    found = np.empty((rounds, len(envs), 3))
    for seed in range(rounds):
        for place, ((case, _), env) in enumerate(envs.items()):
            measure = known[case][0]
            # A plain Box and staggered ends are ours alone: CartPole's space and episodes are fixed.
            theirs = step_beforehand if measure is step_beforehand else _benchmark
            found[seed, place] = (
                measure(env, duration_s, seed),
                theirs(yardstick, duration_s, seed),
                lanes * _calls_per_s(lambda _: bare(), duration_s / 4),
            )
    for env in (yardstick, *envs.values()):
        env.close()
    rows, load = [], os.getloadavg()[0]
    for place, (case, count) in enumerate(envs):
        ours, theirs_s, kernel = found[:, place].T
        plain = found[:, list(envs).index((cases[0], count)), 0]
        rows.append(
            {
                "case": case,
                "threads": count,
                "million_steps_per_s": np.median(ours) / 1e6,
                "cartpole": np.median(theirs_s) / 1e6,
                "bare_kernel": np.median(kernel) / 1e6,
                "times_cartpole": np.median(ours / theirs_s),
                "lowest": np.min(ours / theirs_s),
                "highest": np.max(ours / theirs_s),
                "share_of_bare": np.median(ours / kernel),
                "share_of_defaults": np.median(ours / plain),
                "load": load,
            }
        )
    return pd.DataFrame(rows)


def tasks(
    rounds: int,
    duration_s: float = 0.25,
    lanes: int = 4096,
    threads: Sequence[int] = THREADS,
    names: Sequence[str] = tuple(TASKS),
) -> pd.DataFrame:
    """Measure the vector environment of every task with vector CartPole, steps alone and whole episodes."""
    cases = [TASKS[name].id for name in names]
    table = vector(rounds, duration_s, lanes, threads, cases)
    resets = {(case, n): _reset_s(case, lanes, n, rounds) for case in cases for n in threads}
    keys = list(zip(table["case"], table["threads"], strict=True))
    table["reset_ms"] = [1e3 * resets[key] for key in keys]
    rate = 1e6 * table["million_steps_per_s"]
    samples = np.array([named_task(case).samples for case, _ in keys])
    episode_s = samples * lanes / rate + table["reset_ms"] / 1e3
    table["episodes_times_cartpole"] = samples * lanes / episode_s / rate * table["times_cartpole"]
    return table.drop(columns=["bare_kernel", "share_of_bare", "share_of_defaults"])


def _reset_s(case: str, lanes: int, threads: int, rounds: int) -> float:
    """Shortest time in which all lanes begin anew (s), after a first reset, which fills caches."""
    env = gym.make_vec(case, num_envs=lanes, threads=threads)
    times = []
    for seed in range(rounds + 1):
        begin = time.perf_counter()
        env.reset(seed=seed)
        times.append(time.perf_counter() - begin)
    return min(times[1:])


LANES, PERIODS = (16, 64, 256), (50, 200, 2000)
"""Lanes of the core kernels, and samples a period of their command."""
_CORE_SAMPLES, _TS_S, _AMPLITUDE_V, _LENGTH_V, _PLAYS = 400, 1e-3, 30.0, 10.0, 10
_SCALE = DataScale(
    centre_V=0.0, span_V=_AMPLITUDE_V, stroke_um=20.0, fastest_V_s=400.0, shortest_s=_TS_S,
    longest_s=4.0,
)  # fmt: skip
_SHAPES: Mapping[str, tuple[Mapping[str, float], ...]] = {
    "bouc_wen": tuple({"limit_V": _LENGTH_V, "sigma": 0.7, "exponent": n} for n in (1.0, 1.5, 3.0)),
    "asymmetric_bouc_wen": ({"limit_V": _LENGTH_V, "sigma": 0.7, "exponent": 1.5, "skew": 0.2},),
    "dahl": tuple({"limit_V": _LENGTH_V, "exponent": i} for i in (0.5, 1.0, 1.5)),
    "duhem": ({"length_V": _LENGTH_V},),
    "lugre": ({"coulomb_V": _LENGTH_V, "stribeck_V_s": 100.0},),
}


@cache
def core_cases() -> dict[str, Core]:
    """Return the cores by their name in the table.

    Those of plays or stops have ten, as P10 has; the others the numbers that a fit begins with, and
    a length of 10 V.
    """
    found: dict[str, Core] = {}
    for name, kind in CORES.items():
        core: Any = P10.hysteresis if name == P10.hysteresis.name else kind.starts(_SCALE)[0]
        if core.spaced and len(core.thresholds_V) > _PLAYS:
            thresholds, weights = core.thresholds_V[:_PLAYS], core.weights
            weights = weights[: len(weights) - len(core.thresholds_V) + _PLAYS]
            core = dataclasses.replace(core, thresholds_V=thresholds, weights=weights)
        for shape in _SHAPES.get(name, ({},)):
            exponent = f", exponent {shape['exponent']:g}" if "exponent" in shape else ""
            found[f"{name}{exponent}"] = core.with_shape(shape)
    return found


class _Kernel:
    """A core's kernel on the same commands, again and again; each call continues the last one."""

    def __init__(self, core: Core, u: Array) -> None:
        self._block = type(core).block
        self._u, self._v = u, np.gradient(u, axis=0) / _TS_S
        self._p = pack([core] * u.shape[1], _TS_S, [0.0] * u.shape[1])
        self._state, self._y = empty_state(core.n, u.shape[1]), np.empty_like(u)

    def sample_ns(self, samples: int) -> float:
        """Processor time of one sample and lane (ns) in calls of so many samples."""
        begin = time.process_time_ns()
        for t in range(0, len(self._u), samples):
            at = slice(t, t + samples)
            self._block(self._u[at], self._v[at], self._p, self._state, self._y[at])
        return max(time.process_time_ns() - begin, 1) / self._u.size


def core(
    rounds: int,
    lanes: Sequence[int] = LANES,
    periods: Sequence[int] = PERIODS,
    samples: int = _CORE_SAMPLES,
) -> pd.DataFrame:
    """Measure every core's kernel with the RDPI model's on sines, a phase of its own in each lane."""
    rows = []
    for period, count in ((p, n) for p in periods for n in lanes):
        phases = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
        time_rad = np.arange(samples)[:, None] * (2.0 * np.pi / period)
        u: Array = _AMPLITUDE_V * np.sin(time_rad + phases)
        kernels = {label: _Kernel(core, u) for label, core in core_cases().items()}
        rdpi = _Kernel(P10.hysteresis, u)

        def in_turn(kernel: _Kernel, rdpi: _Kernel = rdpi) -> list[float]:
            return [each.sample_ns(size) for size in (samples, 1) for each in (kernel, rdpi)]

        for kernel in kernels.values():
            in_turn(kernel)
        times = np.array([[in_turn(k) for k in kernels.values()] for _ in range(rounds)])
        for i, label in enumerate(kernels):
            block, its_block, steps, its_steps = times[:, i].T
            rows.append(
                {
                    "core": label,
                    "lanes": count,
                    "samples_a_period": period,
                    "block_ns": np.median(block),
                    "rdpi_block_ns": np.median(its_block),
                    "block_ratio": np.median(its_block / block),
                    "steps_ratio": np.median(its_steps / steps),
                }
            )
    return pd.DataFrame(rows)


TRAININGS = (("ppo", 1), ("native-ppo", 1), ("native-ppo", 2))
"""Algorithm, as on the command line, and threads."""


class _Uninterrupted:
    """Callback of a training without evaluations."""

    def before_rollout(self) -> dict[str, float]:
        return {}

    def rewarded(self, reward: float) -> None:
        pass

    end = before_rollout


def training(rounds: int, rollouts: int = 8) -> pd.DataFrame:
    """Measure the native PPO and Stable-Baselines3's: steps a second of the clock and the process."""
    found = [_training(*case, rollouts) for _ in range(rounds) for case in TRAININGS]
    table = pd.DataFrame(found)
    table["steps_per_s"] = table["steps"] / table["seconds"]
    table["steps_per_process_s"] = table["steps"] / table["process_s"]
    rates = ["steps_per_s", "steps_per_process_s"]
    groups = table.groupby(["learner", "threads", "lanes", "epochs", "steps"], sort=False)[rates]
    return groups.median().join(groups.max().add_prefix("best_")).reset_index()


def _training(algorithm: str, threads: int, rollouts: int) -> dict[str, Any]:
    """Train for some rollouts after a first one, which loads the kernels."""
    from stable_baselines3 import PPO

    from baselines.learned.native_learner import NativeLearner
    from baselines.learned.native_ppo import NativePPO
    from baselines.learned.options import Run
    from baselines.learned.stable_baselines import StableBaselinesLearner

    kind: Any = PPO if algorithm == "ppo" else NativePPO
    opened = Run.open(TrainingOptions(action="increment", threads=threads), algorithm, kind)
    settings, is_reference = opened.settings, algorithm == "ppo"
    learner: Any = StableBaselinesLearner(opened) if is_reference else NativeLearner(opened)
    samples = settings.lanes * settings.algorithm["n_steps"]
    learner.begin(0)
    learner.learn(samples, _Uninterrupted())
    before, clock, process = learner.timesteps, time.perf_counter(), time.process_time()
    learner.learn(rollouts * samples, _Uninterrupted())
    return {
        "learner": algorithm,
        "threads": threads,
        "lanes": settings.lanes,
        "epochs": settings.algorithm["n_epochs"],
        "steps": learner.timesteps - before,
        "seconds": time.perf_counter() - clock,
        "process_s": time.process_time() - process,
    }


def _slowest_task(table: pd.DataFrame) -> str:
    threads = int(table["threads"].max())
    rows = table[table["threads"] == threads].sort_values("times_cartpole")
    least = rows.iloc[0]
    faster = int((rows["times_cartpole"] >= 1.0).sum())
    return (
        f"On {threads} thread{'s' if threads > 1 else ''} {faster} of {len(rows)} tasks make at least the steps of CartPole, which has one; "
        f"{least['case']} makes {least['times_cartpole']:.2g} times as many."
    )


def _slowest_core(table: pd.DataFrame) -> str:
    row = table.sort_values("block_ratio").iloc[0]
    return (
        f"The slowest is {row['core']} at {row['lanes']} lanes and {row['samples_a_period']} samples a "
        f"period: {row['block_ratio']:.2g} of the RDPI model's samples a second in a block."
    )


def _native_ppo(table: pd.DataFrame) -> str:
    reference, one, two = table["steps_per_process_s"]
    return (
        f"The native PPO trains {one:,.0f} steps in a second of one core, Stable-Baselines3's PPO "
        f"{reference:,.0f}: {one / reference:.1f} times as many. On two threads it trains {two:,.0f} in a "
        "second of the process. On the clock it is as many times that as the process is given cores."
    )


@dataclasses.dataclass(frozen=True)
class Part:
    """A table of the study: its measurement, heading, first sentence and method."""

    measure: Callable[[int], pd.DataFrame]
    title: str
    answer: Callable[[pd.DataFrame], str]
    method: str


PARTS: Mapping[str, Part] = {
    "vector": Part(
        vector,
        f"{PIEZO} beside {YARDSTICK}, 4096 lanes",
        lambda table: f"With the defaults one thread makes {table['times_cartpole'].iloc[0]:.3g} times the steps of CartPole.",
        "Ours, CartPole's vector environment and the bare kernel (`rdpi_block`, ten plays, one sample a "
        "call, one thread) in turn in one process, 0.25 s each; medians, in million steps per second of one lane, "
        "and medians of the rounds' ratios (`lowest` and `highest` are those to CartPole). "
        "`benchmark_vector_step` is Gymnasium's own measure and draws random actions for each step. "
        "The environment's action space is equal to a `Box`, but spreads one random word over the "
        "lanes (SplitMix64) where `Box.sample` draws 64 bits a number and sorts coordinates by kind of "
        "bound; the rows with a plain Box draw by `Box.sample` instead, those with actions drawn "
        f"beforehand leave drawing out on both sides. The five effects are {', '.join(FIVE)}. A training has "
        "increments as actions, the noise of a sensor, plants and effects drawn for each episode of "
        f"{_TRAINED.episode} samples, and sines, triangles and multisines; the row is of its plant with a lag, creep "
        "and a mode, in as many groups of lanes as the native PPO's, whose episodes begin in turn. `load` is the number "
        "of processes that wanted the cores at its end, one of them this one: two threads, which wait for each other, "
        "say little beside others. Each thread is bound to a core (`OMP_PROC_BIND=true`).",
    ),
    "tasks": Part(
        tasks,
        f"Vector environments of the tasks beside {YARDSTICK}, 4096 lanes",
        _slowest_task,
        "The environment of each task with its defaults (references, noise, history, costs, plants drawn anew) and "
        "CartPole's vector environment in turn in one process, 0.25 s each, by Gymnasium's `benchmark_vector_step`: random "
        "actions over the whole range at every sample, so that half of the commands turn. Medians, in million steps per "
        "second of one lane, and medians of the rounds' ratios; `reset_ms` is the time in which all lanes begin an episode at "
        "once, `episodes_times_cartpole` the ratio with one such reset an episode. `load` is the number of processes that wanted "
        "the cores, one of them this one.",
    ),
    "core": Part(
        core,
        "Samples a second of the hysteresis cores, over those of the RDPI model",
        _slowest_core,
        f"Each core in turn with the RDPI model P10 of {_PLAYS} plays in one process, on sines of {_AMPLITUDE_V:g} V "
        f"with a phase of its own in each lane, {_CORE_SAMPLES} samples as one block and in calls of one sample. Lengths "
        f"of z are {_LENGTH_V:g} V, plays and stops {_PLAYS}, levels 15; nanoseconds of the processor for one "
        "sample and lane, medians; ratios above one are faster than the RDPI model.",
    ),
    "training": Part(
        training,
        "Trained steps per second",
        _native_ppo,
        "Each case in turn, each with the hyper-parameters that ship, on the four plants of a training side by side "
        "with increments of the command, without evaluations and checkpoints; medians and bests over the rounds. A "
        "trained step is a sample of one lane that was used in the updates, `epochs` times. `steps_per_process_s` is "
        "over the seconds of the process, all threads together.",
    ),
}  # fmt: skip


def as_markdown(name: str, table: pd.DataFrame, rounds: int) -> str:
    """Return a part's table with what was measured and how."""
    part = PARTS[name]
    versions = ", ".join(f"{each} {version(each)}" for each in ("gymnasium", "numpy", "numba"))
    return (
        f"# {part.title}\n\n{part.answer(table)}\n\n"
        f"Written by `python -m studies.speed {name}`, {rounds} rounds. {part.method}\n\n"
        f"{versions}, Python {platform.python_version()}, {platform.machine()}, {numba.config.NUMBA_NUM_THREADS} of {os.cpu_count()} cores.\n\n"
        f"{frame_table(table)}\n"
    )


def _files(chosen: Namespace) -> Files:
    files: dict[str, str | pd.DataFrame] = {}
    for name in names_of("part", chosen.parts, PARTS):
        table = PARTS[name].measure(chosen.rounds)
        file = f"{name}_speed"
        files[f"{file}.csv"] = table
        files[f"{file}.md"] = as_markdown(name, table, chosen.rounds)
    return files


def _more(options: Options) -> None:
    options.add_argument("parts", nargs="*", help=f"of {', '.join(PARTS)}; all by default")


main = Study(
    "speed", __doc__, _files, RESULTS, numbers=(("--rounds", 9, "of timing"),), more=_more,
    csv="%.4g",
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
