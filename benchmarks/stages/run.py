"""Runs of controllers on tasks: test seeds, scores of drawn plants, row by row into a store."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from baselines import (
    CONTROLLERS,
    ControllerFactory,
    find_factory,
    inverts_any_core,
    make_controller,
    policy_of,
)
from baselines.preview import PreviewInversion
from benchmarks.rows import TASKS, Outcome, TaskKey, complete
from benchmarks.stages.confinement import kept_memory
from benchmarks.stages.entries import BESIDE, told
from benchmarks.stages.isolation import ControllerFailed, ControllerProcess, own_code
from benchmarks.tracking.controllers import (
    code_fingerprint,
    is_learned,
    read_policy,
    task_fingerprint,
)
from benchmarks.tracking.episode import Recording, microseconds_per_sample, one_line, play, score
from rdpi_gym.envs.controller import Controller, certificate_of, warning_of
from rdpi_gym.envs.tasks import PUBLIC_SEED, Lanes, StageTask, named_task
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_utf8
from rdpi_gym.support.fingerprint import code_parts, fingerprint, used_files
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row

SUITE_VERSION = 1
"""Version of the tasks: rows of another are of other plants or another protocol."""
SATURATED_PERCENT = 1.0
"""Samples (%) of a reference at the end of the command's range from which on it counts as a failure."""
SLOWEST_US = 5000.0
"""Processor time of one decision (µs) from which on a controller is too slow: fifty samples of most tasks."""
WORST_PERCENT = 100.0
"""RMSE (%) that a plant without a finite score counts with, and the least of one that failed."""

DIVERGED, SATURATED, ERROR, SLOW = "diverged", "saturated", "error", "too slow"
PASSES = 10
"""Passes over the same reference of a controller that ``repeats``; the last is scored."""
PREVIEW, WHOLE, AGAIN = "preview", "whole reference", f"{PASSES} passes"
"""Information of controllers: those with the task's preview are ranked, the others only listed."""


@dataclass(frozen=True)
class Unit:
    """Work of one process at a time; its rows are written when it is done."""

    controller: str  # as :func:`baselines.make_controller` takes it, or the name of the bound
    task: str  # short name of a task
    # of the test draws, and what rows say of it
    seed: int
    draws: str
    plants: tuple[int, ...]  # numbers of the plants
    stamp: str  # hash of all that the rows depend on
    # what makes the controller, where its name does not say
    factory: ControllerFactory | None = None
    apart: bool = False  # whether it runs in a process of its own
    code: Path | None = None  # own code of one that does

    @property
    def keys(self) -> list[TaskKey]:
        """Names of its rows, in their order."""
        return [TASKS.key(_row(self, number)) for number in self.plants]


def run_unit(unit: Unit) -> list[Row]:
    """Score a controller on every plant; one that fails leaves rows that say so."""
    try:
        found = _run(unit)
    except ControllerFailed as error:
        found = {number: {"failure": f"{ERROR}: {error}"} for number in unit.plants}
    except Exception as error:  # a user's controller may raise anything; the others go on
        reason = f"{ERROR}: {one_line(f'{type(error).__name__}: {error}')}"
        found = {number: {"failure": reason} for number in unit.plants}
    return [_row(unit, number) | found[number] for number in unit.plants]


def _run(unit: Unit) -> dict[int, Row]:
    task = named_task(unit.task)
    rows: dict[int, Row] = {}
    for lanes in task.lanes("test", unit.plants, unit.seed):
        with _entrant(unit, lanes) as make:
            timed = 0.0 if unit.controller in BESIDE else _timed(make(), lanes)
            if timed > SLOWEST_US:
                reason = f"{SLOW}: {timed:.3g} µs of processor time a sample, at most {SLOWEST_US:g} are allowed"
                slow = {"failure": reason, "microseconds_per_sample": timed}
                rows |= {draw.number: slow for draw in lanes.draws}
                continue
            controller = make()
            taken = _passes(controller, lanes)
            common = {"microseconds_per_sample": timed, **_statements(controller)}
        rows |= {number: row | common for number, row in plant_scores(task, lanes, taken).items()}
    return rows


def _timed(controller: Controller, lanes: Lanes) -> float:
    """Time one decision (µs) on a training plant, from which nothing of the test plants follows."""
    task, number = lanes.task, lanes.draws[0].number % len(lanes.task.nominals)
    draw = task.draw("training", number)
    return microseconds_per_sample(controller, draw.truth, lanes.layout(), draw.references_um[:, 0])


def _passes(controller: Any, lanes: Lanes) -> Recording:
    """Run a controller, one that learns from pass to pass as often as it may; the last is returned."""
    task, reference = lanes.track(lanes.layout()), lanes.references_um
    taken = play(controller, task, reference, lanes.noises)
    if getattr(controller, "repeats", False):
        for _ in range(PASSES - 1):
            controller.learn(reference, taken.measured_um, taken.command_V)
            taken = play(controller, task, reference, lanes.noises)
    return taken


@contextmanager
def _entrant(unit: Unit, lanes: Lanes) -> Iterator[Callable[[], Controller]]:
    """Give what makes the controller anew: it is told the belief; only what has no rank knows more."""
    belief, layout = told(lanes.belief), lanes.layout()
    if unit.controller in BESIDE:
        yield partial(BESIDE[unit.controller].make, lanes)
    elif unit.apart:
        with kept_memory(), ControllerProcess(unit.controller, unit.code) as process:
            yield partial(process.make, belief, layout)
    else:
        yield partial(make_controller, unit.factory or unit.controller, belief, layout)


def _statements(controller: Any) -> Row:
    """Return what a controller states of itself."""
    sees = WHOLE if hasattr(controller, "plan") else PREVIEW
    return {
        "warning": warning_of(controller),
        "certificate": certificate_of(controller),
        "sees": AGAIN if getattr(controller, "repeats", False) else sees,
        "tuning_samples": int(getattr(controller, "plant_samples", 0)),
        **({"confined": controller.is_confined} if hasattr(controller, "is_confined") else {}),
    }


def plant_scores(task: StageTask, lanes: Lanes, taken: Recording) -> dict[int, Row]:
    """Return what is measured of each plant: means over its references, and why it failed."""
    numbers = np.array(lanes.numbers)
    every = [_lane(task, lanes, taken, b) for b in range(len(numbers))]
    rows: dict[int, Row] = {}
    for draw in lanes.draws:
        own = [every[b] for b in np.flatnonzero(numbers == draw.number)]
        reasons = [
            f"{reason} on {name}"
            for (_, reason), name in zip(own, draw.names, strict=True)
            if reason
        ]
        scored = [one for one, _ in own if one is not None]
        if len(scored) < len(own):
            rows[draw.number] = {"failure": "; ".join(reasons)}
            continue
        percent = [one.rmse_percent for one in scored]
        um = float(np.mean([one.rmse_um for one in scored]))
        rows[draw.number] = {
            "rmse_percent": float(np.mean(percent)),
            "worst_percent": max(percent),
            "each_percent": [float(f"{value:.6g}") for value in percent],
            "rmse_um": um,
            "rmse_noise": um / task.noise_um,
            "command_variation_V_s": float(np.mean([one.command_variation_V_s for one in scored])),
            "failure": "; ".join(reasons),
        }
    return rows


def _lane(task: StageTask, lanes: Lanes, taken: Recording, b: int) -> tuple[Any, str]:
    """Return the score of one lane, None without any, and in a word why it failed."""
    action = taken.action[:, b]
    if not np.isfinite(action).all():
        return (
            None,
            f"{ERROR}: action at sample {int(np.argmin(np.isfinite(action)))} is not finite",
        )
    r = lanes.references_um[:, b]
    with np.errstate(over="ignore", invalid="ignore"):
        scored = score(
            r, taken.displacement_um[:, b], taken.command_V[:, b], action,
            first=task.first, ts_s=task.ts_s,
        )  # fmt: skip
    if not np.isfinite(scored.rmse_um):
        return None, DIVERGED
    if scored.rmse_um > np.std(r[task.first :]) or scored.rmse_percent > WORST_PERCENT:
        return scored, DIVERGED
    if scored.saturated_percent > SATURATED_PERCENT:
        return scored, SATURATED
    return scored, ""


def _row(unit: Unit, number: int) -> Row:
    return {
        "controller": unit.controller,
        "task": unit.task,
        "draws": unit.draws,
        "plant": number,
        "suite": SUITE_VERSION,
        "stamp": unit.stamp,
    }


PLANTS = 50
"""Plants of a unit at most: what is done twice where a run is interrupted."""


_LARGEST = 2**10  # bytes of a seed file
FEWEST_DIGITS, MOST_DIGITS = 20, 40
"""Digits of a private seed: a shorter one could be guessed from the hash that tables show."""


@dataclass(frozen=True)
class TestSeed:
    """The seed of test draws; one that is not public is named by a hash alone."""

    __test__ = False  # to pytest it looks like a class of tests

    seed: int = PUBLIC_SEED
    is_public: bool = True

    @property
    def label(self) -> str:
        """Name in rows and tables."""
        if self.is_public:
            return f"public seed {self.seed}"
        return f"private seed {hashlib.sha256(str(self.seed).encode()).hexdigest()[:8]}"


def read_seed(path: Path | None) -> TestSeed:
    """Read the seed of test draws from a file that holds one whole number; None: the public one."""
    if path is None:
        return TestSeed()
    text = read_utf8(path, _LARGEST).strip()
    if not (text.isascii() and text.isdigit() and FEWEST_DIGITS <= len(text) <= MOST_DIGITS):
        raise InputError(
            f"the seed file {path} does not hold one whole number of {FEWEST_DIGITS} to {MOST_DIGITS} digits; "
            "write a random one, as tables show a hash that a short one could be guessed from"
        )
    return TestSeed(int(text), is_public=False)


_OWN = ("benchmarks.stages.run",)


def field() -> list[str]:
    """Return the controllers of this package that enter by default.

    All but the inversion of the belief over the whole reference, which plans for longer than all others
    take together, and those that invert any core, which are the doubles of others: what is believed of
    every task is the RDPI model.
    """
    return [
        name
        for name, make in CONTROLLERS.items()
        if not inverts_any_core(name)
        and not (isinstance(make, type) and issubclass(make, PreviewInversion))
    ]


def run_tasks(
    controllers: Sequence[str],
    tasks: Sequence[str],
    plants: int,
    out: Path,
    *,
    seed: TestSeed | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
    ray_address: str | None = None,
    factories: Mapping[str, ControllerFactory] | None = None,
    bound: bool = True,
    stamped: bool = True,
    submitted: Mapping[str, Path | None] | None = None,
) -> Outcome:
    """Compute what is missing, and return every row that was asked for; an interrupted run goes on.

    Without `bound` no entry beside the ranking is scored that is not asked for; without `stamped` rows
    carry no hash of what they depend on. Controllers of strangers are `submitted`, each with its own
    code if it has any; they, and with a private seed all, run in processes of their own.
    """
    drawn = TestSeed() if seed is None else seed
    names = [named_task(task).name for task in tasks]
    made = dict(factories or {})
    codes = dict(submitted or {})
    asked = list(dict.fromkeys((*controllers, *codes, *made)))
    for name in asked:
        _check(name, made, codes, drawn)
    apart = {name for name in asked if name in codes or not drawn.is_public} - set(BESIDE)
    if plants < 1 or not names or not asked:
        raise InputError("nothing to score; give at least one controller, one task and one plant")
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; give a folder for --out")
    units = [
        Unit(
            name, task, drawn.seed, drawn.label, tuple(range(plants)[first : first + PLANTS]),
            _stamp(name, task, made) if stamped else "", made.get(name), name in apart,
            codes.get(name),
        )
        for task in dict.fromkeys(names)
        for name in (*asked, *(_beside(task, asked) if bound else ()))
        for first in range(0, plants, PLANTS)
    ]  # fmt: skip
    store, notes = TASKS.open(out), list[str]()
    stamps = {k: unit.stamp for unit in units for k in unit.keys}
    with ExitStack() as stack:
        if apart:
            stack.enter_context(kept_memory())
        computed = complete(
            store, units, run_unit, lambda unit: unit.keys,
            lambda row: stamps.get(TASKS.key(row), row["stamp"]) != row["stamp"],
            name=TASKS.key, note=notes.append,
            stale="Rows of changed code or controllers were set aside in {.name}.",
            jobs=jobs, progress=progress, ray_address=ray_address,
        )  # fmt: skip
    rows = [store.rows[k] for unit in units for k in unit.keys]
    if any(row.get("confined") is False for row in rows):
        notes.append(_UNCONFINED)
    return Outcome(rows, computed, tuple(notes))


_UNCONFINED = (
    "The kernel did not confine the controllers' processes: their code could read the files of whoever "
    "ran them."
)


def _beside(task: str, asked: Sequence[str]) -> list[str]:
    """Return the entries beside the ranking of a task that are not asked for already."""
    one = named_task(task)
    return [name for name, entry in BESIDE.items() if name not in asked and entry.enters(one)]


def _check(
    name: str,
    made: Mapping[str, ControllerFactory],
    codes: dict[str, Path | None],
    drawn: TestSeed,
) -> None:
    """Refuse a controller that is not there; find the code of one that runs apart, and run none of it."""
    if name in made and not drawn.is_public:
        raise InputError(
            f"{name} is a callable of this process, where the private seed is; give it as module:attribute"
        )
    if name in codes or name in (*CONTROLLERS, *made, *BESIDE):
        return
    if is_learned(name):
        read_policy(name)
    elif drawn.is_public or ":" not in name:
        find_factory(name)
    if not drawn.is_public:
        folder = Path(policy_of(name) or "")
        codes[name] = (folder if folder.is_dir() else None) if is_learned(name) else own_code(name)


def _stamp(controller: str, task: str, made: Mapping[str, ControllerFactory]) -> str:
    """Return a hash of all that the rows of a controller on a task depend on."""
    if controller in made:  # no one can say whether it is still the same: always run anew
        return os.urandom(8).hex()
    one = named_task(task)
    plants = [
        json.dumps(each.to_dict(), sort_keys=True).encode()
        for each in (*one.nominals, *one.beliefs)
    ]
    parts = [
        _code(controller).encode(),
        task_fingerprint(controller, one.nominal()).encode(),
        *plants,
    ]
    return fingerprint(parts)


@cache
def _code(controller: str) -> str:
    """Return a hash of the code that the rows of a controller depend on."""
    parts = [str(SUITE_VERSION).encode(), code_fingerprint(controller).encode()]
    return fingerprint([*parts, *code_parts(used_files(_OWN, Path(__file__).parents[1]))])
