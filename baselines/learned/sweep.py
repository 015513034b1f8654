"""Hyper-parameter sweep with Optuna, ``rdpi train --sweep``: its search space, trainings and table.

The journal holds finished trials alone. The next trial follows from them and from the seed, so an
interrupted sweep draws the same trial again, finds its training in its folder, and continues.
"""

from __future__ import annotations

import csv
import io
import json
import shutil
import zlib
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from baselines.learned.options import CONFIG, DivergedError, TrainingOptions, check_same, read_curve
from baselines.learned.settings import read_values, read_yaml
from rdpi_gym.support.checks import is_finite, is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, write_atomic, write_json
from rdpi_gym.support.progress import Progress, silent
from rdpi_gym.support.store import open_study
from rdpi_gym.support.words import quoted, short

if TYPE_CHECKING:
    from optuna import Study
    from optuna.distributions import BaseDistribution


SPACES = Path(__file__).parent / "search_spaces"
"""One file an algorithm."""
_DIGITS = 4
Values = Mapping[str, Any]


@dataclass(frozen=True)
class Range:
    """Numbers between two, ends included."""

    low: float
    high: float  # whole both, or not
    log: bool = False  # whether evenly in the logarithm

    @property
    def distribution(self) -> BaseDistribution:
        """Optuna's name for it."""
        from optuna.distributions import FloatDistribution, IntDistribution

        if isinstance(self.low, int) and isinstance(self.high, int):
            return IntDistribution(self.low, self.high, log=self.log)
        return FloatDistribution(self.low, self.high, log=self.log)

    def value(self, drawn: Any) -> Any:
        """Return a number as files have it, of four digits."""
        if isinstance(drawn, int):
            return drawn
        return min(max(float(f"{drawn:.{_DIGITS}g}"), self.low), self.high)

    def nearest(self, value: Any) -> Any:
        """Return the number that is nearest a value of a file; the lowest where that is none."""
        near = min(max(value, self.low), self.high) if is_finite(value) else self.low
        return round(near) if isinstance(self.low, int) and isinstance(self.high, int) else near


@dataclass(frozen=True)
class Choice:
    """One of several values of any kind."""

    values: tuple[str, ...]  # as JSON, which Optuna can keep

    @property
    def distribution(self) -> BaseDistribution:
        """Optuna's name for it."""
        from optuna.distributions import CategoricalDistribution

        return CategoricalDistribution(self.values)

    def value(self, drawn: Any) -> Any:
        """Return a value as files have it."""
        return json.loads(drawn)

    def nearest(self, value: Any) -> Any:
        """Return a value of a file; the first where it is not among them."""
        text = json.dumps(value)
        return text if text in self.values else self.values[0]


@dataclass(frozen=True)
class SearchSpace:
    """Hyper-parameters by name, and what each may be.

    Examples
    --------
    >>> space = SearchSpace({"learning_rate": Range(1e-4, 1e-2, log=True), "gamma": Choice(("0.9",))})
    >>> shipped = {"learning_rate": "lin_1e-3", "gamma": 0.95}
    >>> space.beginning(shipped)
    {'learning_rate': 0.001, 'gamma': '0.9'}
    >>> space.applied({"learning_rate": 0.00123456, "gamma": "0.9"}, shipped)
    {'learning_rate': 'lin_0.001235', 'gamma': 0.9}
    """

    axes: Mapping[str, Range | Choice]
    # A name with dots leads into mappings, as ``policy_kwargs.net_arch``.

    @property
    def distributions(self) -> dict[str, BaseDistribution]:
        """As Optuna takes them."""
        return {name: axis.distribution for name, axis in self.axes.items()}

    def beginning(self, values: Values) -> dict[str, Any]:
        """Return what is tried first: the values of a file, brought into the space."""
        return {name: axis.nearest(_stated(values, name)[1]) for name, axis in self.axes.items()}

    def readable(self, drawn: Values) -> dict[str, Any]:
        """Return what Optuna drew as files have it."""
        return {name: axis.value(drawn[name]) for name, axis in self.axes.items()}

    def applied(self, drawn: Values, values: Values) -> dict[str, Any]:
        """Return hyper-parameters with what was drawn in place of what a file states.

        A word before a number, as of a schedule, ``lin_1e-3``, stays.
        """
        changed = deepcopy(dict(values))
        for name, value in self.readable(drawn).items():
            word, _ = _stated(values, name)
            place = changed
            *folders, last = name.split(".")
            for folder in folders:
                inner = place.get(folder)
                place[folder] = inner if isinstance(inner, dict) else {}
                place = place[folder]
            place[last] = f"{word}_{value}" if word else value
        return changed


def read_space(path: Path) -> SearchSpace:
    """Read a search space: a mapping of names to a list of values or to ``{low, high, log}``."""
    document = read_yaml(path)
    if not isinstance(document, dict) or not document:
        raise InputError(f"{path} is no search space; give names with a list, or with low and high")
    return SearchSpace({str(name): _axis(path, name, given) for name, given in document.items()})


def _axis(path: Path, name: Any, given: Any) -> Range | Choice:
    if isinstance(given, list) and given:
        return Choice(tuple(dict.fromkeys(json.dumps(value) for value in given)))
    if isinstance(given, dict) and {"low", "high"} <= set(given) <= {"low", "high", "log"}:
        low, high, log = given["low"], given["high"], given.get("log", False)
        numbers = all(is_finite(each) and not isinstance(each, bool) for each in (low, high))
        if numbers and isinstance(log, bool) and low < high and (low > 0 or not log):
            return Range(low, high, log)
    raise InputError(
        f"{path}: {short(str(name))} is {quoted(given)}; give a list of values, or low below high, "
        "above 0 with log: true"
    )


def _stated(values: Values, name: str) -> tuple[str, Any]:
    """Return the word before a value of a file, and the value: ``lin``, 0.001; None: not stated."""
    found: Any = values
    for part in name.split("."):
        found = found.get(part) if isinstance(found, Mapping) else None
    if isinstance(found, str):
        word, _, number = found.partition("_")
        try:
            return word, float(number)
        except ValueError:
            return "", found
    return "", found


BEST = "best.yml"


@dataclass(frozen=True)
class Trial:
    """A training of a sweep, done."""

    number: int  # from 0; its folder is ``trials/NUMBER``
    tried: dict[str, Any]  # Hyper-parameters that were chosen
    reward: float | None
    rmse_um: float | None
    compensator_rmse_um: float | None
    # Of the policy that was kept, on held-out plants; None: the training diverged.
    seconds: float | None  # it took


@dataclass(frozen=True)
class Sweep:
    """A search of hyper-parameters, as far as it was asked for."""

    folder: Path  # holds ``best.yml``, ``trials.csv``, ``trials/NUMBER`` and the journal
    trials: tuple[Trial, ...]  # all of them

    @property
    def best(self) -> Trial:
        """The one with the highest reward."""
        return max((t for t in self.trials if t.reward is not None), key=lambda t: t.reward or 0.0)

    @property
    def hyperparameters(self) -> Path:
        """Its hyper-parameters, a file for ``rdpi train --hyperparameters``."""
        return self.folder / BEST

    def __str__(self) -> str:
        best, first = self.best, self.trials[0]
        diverged = sum(trial.reward is None for trial in self.trials)
        begun = "diverged" if first.rmse_um is None else f"{first.rmse_um:.3g} um"
        tried = ", ".join(f"{name} {text_of(value)}" for name, value in best.tried.items())
        return "\n".join(
            [
                f"RMSE {best.rmse_um:.3g} um on held-out plants: trial {best.number} of "
                f"{len(self.trials)}, {diverged} of which diverged; the first, with the file's values, "
                f"{begun}; the compensator {best.compensator_rmse_um:.3g} um",
                f"tried: {tried}",
                f"written: {self.hyperparameters}",
            ]
        )


def text_of(value: Any) -> str:
    """Return a hyper-parameter as tables have it."""
    return value if isinstance(value, str) else json.dumps(value)


FORMAT, VERSION = "rdpi-sweep", 1
DESCRIPTION, JOURNAL, TABLE = "sweep.json", "sweep.journal", "trials.csv"
_SETTINGS = "hyperparameters.yml"
_TOLD = ("rmse_um", "compensator_rmse_um")
_BEFORE_MODEL = 5  # trials after which Optuna's model of them chooses, and no longer chance

Train = Callable[[Any, Progress | None], Path]


def sweep(
    options: TrainingOptions,
    algorithm: str,
    train: Train,
    trials: int,
    space: Path | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Train with hyper-parameters that Optuna chooses; the same call goes on with a sweep."""
    if not is_whole(trials, 1):
        raise InputError(f"sweep is {quoted(trials)}; give the number of trials, 1 or more")
    found = read_space(space or SPACES / f"{algorithm}.yml")
    values = read_values(options.file(algorithm))
    out, show = options.out, progress or silent
    document = {
        "format": FORMAT, "version": VERSION, "algorithm": algorithm,
        "options": options.document(), "hyperparameters": values,
        "space": {name: repr(axis) for name, axis in found.axes.items()},
    }  # fmt: skip
    _check_folder(out, document)
    study = open_study(out / JOURNAL, algorithm, "maximize")
    for number in range(len(study.trials), trials):
        drawn = _drawn(study, found, values, options.seed)
        folder = out / "trials" / f"{number:03d}"
        settings = write_atomic(folder / _SETTINGS, _yaml(found.applied(drawn, values)))
        asked = replace(options, out=folder, hyperparameters=settings)
        kept: Path | None = folder
        try:
            train(asked, _within(show, f"trial {number + 1} of {trials}"))
        except DivergedError:
            kept = None
        except InputError:
            if not (folder / CONFIG).exists():  # refused, before anything was trained
                shutil.rmtree(folder, ignore_errors=True)
            raise
        write_json(out / DESCRIPTION, document)
        _tell(study, found, drawn, kept)
        _write(study, found, values, out)
    done = Sweep(out, _told(study, found))
    if all(trial.reward is None for trial in done.trials):
        raise InputError(
            f"all {len(done.trials)} trainings diverged; give lower learning rates in --search-space"
        )
    return done


def _check_folder(out: Path, document: dict[str, Any]) -> None:
    """Check that a folder is new, or holds a sweep with the same options."""
    if (out / DESCRIPTION).exists():
        check_same(read_json(out / DESCRIPTION, FORMAT, VERSION), document, out, "sweep")
    elif (out / CONFIG).exists():
        raise InputError(f"{out} holds a training and no sweep; give another folder for --out")


def _drawn(study: Study, space: SearchSpace, values: dict[str, Any], seed: int) -> dict[str, Any]:
    """Return what the next training tries: it follows from the finished ones and the seed alone."""
    import optuna

    done = study.get_trials(deepcopy=False)
    if not done:
        return space.beginning(values)
    sampler = optuna.samplers.TPESampler(
        seed=zlib.crc32(f"{seed} {len(done)}".encode()), n_startup_trials=_BEFORE_MODEL
    )
    asking = optuna.create_study(direction="maximize", sampler=sampler)
    asking.add_trials(done)
    return asking.ask(space.distributions).params


def _tell(study: Study, space: SearchSpace, drawn: dict[str, Any], folder: Path | None) -> None:
    """Add a finished training to the journal, in one line of it; None: it diverged."""
    from optuna.trial import TrialState, create_trial

    if folder is None:
        state, reward, said = TrialState.FAIL, None, dict[str, Any]()
    else:
        rows = read_curve(folder)
        best = max(rows, key=lambda row: row["reward"])
        state, reward = TrialState.COMPLETE, best["reward"]
        said = {name: best[name] for name in _TOLD} | {"seconds": rows[-1]["seconds"]}
    study.add_trial(
        create_trial(
            params=drawn, distributions=space.distributions, state=state, value=reward,
            user_attrs=said,
        )
    )  # fmt: skip


def _told(study: Study, space: SearchSpace) -> tuple[Trial, ...]:
    every = study.get_trials(deepcopy=False)
    names = (*_TOLD, "seconds")
    return tuple(
        Trial(
            number,
            space.readable(trial.params),
            trial.value,
            *(trial.user_attrs.get(name) for name in names),
        )
        for number, trial in enumerate(every)
    )


def _write(study: Study, space: SearchSpace, values: dict[str, Any], out: Path) -> None:
    """Write the table, and the best hyper-parameters so far."""
    trials = _told(study, space)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["trial", "state", "reward", *_TOLD, "seconds", *space.axes])
    for trial in trials:
        state = "diverged" if trial.reward is None else "finished"
        found = (trial.reward, trial.rmse_um, trial.compensator_rmse_um, trial.seconds)
        tried = (text_of(value) for value in trial.tried.values())
        writer.writerow([trial.number, state, *found, *tried])
    write_atomic(out / TABLE, text.getvalue())
    if any(trial.reward is not None for trial in trials):
        write_atomic(out / BEST, _yaml(space.applied(study.best_params, values)))


def _within(show: Progress, stage: str) -> Progress:
    def tell(_: str, done: int, total: int, /) -> None:
        show(stage, done, total)

    return tell


def _yaml(values: dict[str, Any]) -> str:
    import yaml

    text: str = yaml.safe_dump({"default": values}, sort_keys=False)
    return text
