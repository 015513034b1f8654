"""`rdpi train --sweep`: hyper-parameters found by trainings that Optuna chooses.

The journal holds finished trials alone. What the next one tries follows from them and from the seed, so
a sweep that was interrupted asks for the same again, finds the training in its folder, and goes on.
"""

from __future__ import annotations

import csv
import io
import shutil
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from baselines.learned.folder import CONFIG, check_same, read_curve
from baselines.learned.learner import DivergedError
from baselines.learned.options import TrainingOptions
from baselines.learned.search_space import SPACES, SearchSpace, read_space
from baselines.learned.settings import read_values
from baselines.learned.swept import BEST, Sweep, Trial, text_of
from rdpi_gym.support.checks import is_whole, shown
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, write_atomic, write_json
from rdpi_gym.support.progress import Progress, silent
from rdpi_gym.support.study import open_study

if TYPE_CHECKING:
    from optuna import Study

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
    """See that a folder is new, or holds a sweep with the same options."""
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
    text: str = yaml.safe_dump({"default": values}, sort_keys=False)
    return text
