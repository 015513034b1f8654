"""Hyper-parameter sweep with Optuna, ``rdpi train --sweep``.

The journal holds finished trials alone. The next trial follows from them and from the seed, so an
interrupted sweep draws the same trial again, finds its training in its folder, and continues.
"""

from __future__ import annotations

import csv
import io
import json
import shutil
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from baselines.learned.folder import CONFIG, check_same, read_curve
from baselines.learned.options import DivergedError, TrainingOptions
from baselines.learned.search_space import SPACES, SearchSpace, read_space
from baselines.learned.settings import read_values
from rdpi_gym.support.checks import is_whole, shown
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, write_atomic, write_json
from rdpi_gym.support.progress import Progress, silent
from rdpi_gym.support.study import open_study

if TYPE_CHECKING:
    from optuna import Study


BEST = "best.yml"


@dataclass(frozen=True)
class Trial:
    """A training of a sweep, done."""

    number: int
    # From 0; its folder is ``trials/NUMBER``.
    tried: dict[str, Any]
    # Hyper-parameters that were chosen.
    reward: float | None
    rmse_um: float | None
    compensator_rmse_um: float | None
    # Of the policy that was kept, on held-out plants; None: the training diverged.
    seconds: float | None
    # It took.


@dataclass(frozen=True)
class Sweep:
    """A search of hyper-parameters, as far as it was asked for."""

    folder: Path
    # Holds ``best.yml``, ``trials.csv``, ``trials/NUMBER`` and the journal.
    trials: tuple[Trial, ...]
    # All of them.

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
        raise InputError(f"sweep is {shown(trials)}; give the number of trials, 1 or more")
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
