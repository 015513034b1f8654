"""Runs of controllers on tasks: test seeds, and units that are not finished, row by row into a store."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from baselines import CONTROLLERS, HORIZON_BOUND, ControllerFactory, find_factory, inverts_any_core
from baselines.preview import PreviewInversion
from benchmarks.rows import TASKS, complete
from benchmarks.stages.unit import SUITE_VERSION, make_units, run_unit
from benchmarks.tracking.controllers import is_learned, read_policy
from benchmarks.tracking.fingerprint import code_fingerprint, task_fingerprint
from rdpi_gym.envs.tasks import PUBLIC_SEED, named_task
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_utf8
from rdpi_gym.support.fingerprint import code_parts, fingerprint, used_files
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row

_LARGEST = 2**10  # bytes of a seed file
FEWEST_DIGITS, MOST_DIGITS = 20, 40
"""Digits of a private seed: a shorter one could be guessed from the hash that tables show."""


@dataclass(frozen=True)
class TestSeed:
    """The seed of test draws, and what tables say of it.

    Parameters
    ----------
    seed
        A whole number of 0 or above.
    is_public
        Whether it is the one that is committed; another is named by a hash alone.

    Examples
    --------
    >>> TestSeed().label
    'public seed 2026'
    >>> TestSeed(12345678901234567890, is_public=False).label
    'private seed 6ed645ef'
    """

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


_OWN = ("benchmarks.stages.unit",)


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


@dataclass(frozen=True)
class Outcome:
    """Result of a run."""

    rows: list[Row]  # those that were asked for, the bound's among them
    computed: int  # number of rows that were not finished before
    notes: tuple[str, ...]  # what a reader should know, one sentence each


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
    kept: bool = True,
) -> Outcome:
    """Compute what is missing, and return every row that was asked for; an interrupted run goes on.

    Rows of a folder that is not kept carry no hash of what they depend on.
    """
    drawn = TestSeed() if seed is None else seed
    names = [named_task(task).name for task in tasks]
    made = dict(factories or {})
    asked = list(dict.fromkeys((*controllers, *made, *([HORIZON_BOUND] if bound else []))))
    for name in asked:
        if is_learned(name):
            read_policy(name)
        elif name not in (*CONTROLLERS, *made, HORIZON_BOUND):
            find_factory(name)
    if plants < 1 or not names or not set(asked) - {HORIZON_BOUND}:
        raise InputError("nothing to score; give at least one controller, one task and one plant")
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; give a folder for --out")
    units = [
        unit
        for task in dict.fromkeys(names)
        for name in asked
        for unit in make_units(
            name, task, drawn.seed, drawn.label, range(plants),
            _stamp(name, task, made) if kept else "", made.get(name),
        )
    ]  # fmt: skip
    store, notes = TASKS.open(out), list[str]()
    stamps = {k: unit.stamp for unit in units for k in unit.keys}
    computed = complete(
        store, units, run_unit, lambda unit: unit.keys,
        lambda row: stamps.get(TASKS.key(row), row["stamp"]) != row["stamp"],
        name=TASKS.key, note=notes.append,
        stale="Rows of changed code or controllers were set aside in {.name}.",
        jobs=jobs, progress=progress, ray_address=ray_address,
    )  # fmt: skip
    return Outcome([store.rows[k] for unit in units for k in unit.keys], computed, tuple(notes))


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
