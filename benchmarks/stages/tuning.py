"""`rdpi tune`: the settings of a controller, found on training draws of a task by Optuna."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from baselines import CONTROLLERS, make_controller
from baselines.loops import Certificate
from baselines.tuning import (
    Knob,
    Settings,
    Tuning,
    checked_settings,
    read_tunings,
    write_tunings,
)
from benchmarks.stages.ranking import interquartile_mean, ninetieth
from benchmarks.stages.run import WORST_PERCENT, plant_scores
from benchmarks.tracking.episode import play
from rdpi_gym.envs.controller import Controller, certificate_of, warning_of
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.tasks import Lanes, StageTask, named_task
from rdpi_gym.envs.tasks.task import Split
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.checks import is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress, silent
from rdpi_gym.support.store import open_study
from rdpi_gym.support.words import guess, quoted, some

if TYPE_CHECKING:
    from optuna import Study
    from optuna.trial import Trial

VALIDATION_PLANTS = 20
FINALISTS = 3
"""Best trials that validation plants choose from, the defaults beside them."""


@dataclass(frozen=True)
class Figures:
    """Errors of a controller over plants: RMSE in percent of the references' peak to peak."""

    # mean of the middle half of the plants, the 90th percentile, and the largest
    iqm_percent: float
    p90_percent: float
    worst_percent: float
    # plants on which it fails as a ranking counts it, and all
    failures: int
    plants: int
    plant_samples: int  # samples that were simulated

    @property
    def objective(self) -> float:
        """What is minimised: the mean of the three, so that no plant is given up for the others."""
        return (self.iqm_percent + self.p90_percent + self.worst_percent) / 3.0

    def __str__(self) -> str:
        failed = f"{self.failures} of {self.plants} plants fail"
        return f"{self.iqm_percent:.3g} % (90th percentile {self.p90_percent:.3g} %, {failed})"


@dataclass(frozen=True)
class Tuned:
    """Result of a search."""

    # their names
    controller: str
    task: str
    tuning: Tuning  # the settings, and how they were found
    trials: int  # settings that were tried
    # on validation draws, which chose among the best trials and the defaults: with the class's
    # defaults, and with what was chosen
    before: Figures
    after: Figures
    # what the controller says of itself with these settings
    certificate: str | None
    warning: str | None
    path: Path  # file of the settings

    def __str__(self) -> str:
        settings = ", ".join(f"{k} {v:.4g}" for k, v in self.tuning.settings.items())
        lines = [
            f"RMSE {self.after} on validation plants of {self.task}: {self.controller} after "
            f"{self.trials} trials; untuned {self.before}",
            f"settings: {settings}",
            f"found on {self.tuning.plant_samples / 1e6:.3g} million samples of training and validation plants; "
            f"{self.tuning.score_percent:.3g} % in training (mean of middle, 90th percentile and worst)",
            f"certificate: {self.certificate or 'none'}",
            *([f"warning: {self.warning}"] if self.warning else []),
            f"written: {self.path}",
        ]
        return "\n".join(lines)


def tune(
    name: str,
    task: str = "Stage",
    out: Path = Path("results/tune"),
    *,
    trials: int = 40,
    seed: int = 0,
    plants: int = 16,
    progress: Progress | None = None,
) -> Tuned:
    """Find settings of a controller on training draws of a task; the same call goes on with a search."""
    knobs = _knobs(name)
    target = named_task(task)
    for what, value in (("trials", trials), ("plants", plants)):
        if not is_whole(value, 1):
            raise InputError(f"{what} is {quoted(value)}; give a whole number of 1 or more")
    path = out / f"{name}.json"
    known = read_tunings(path, name, knobs) if path.exists() else {}
    study = _study(name, target, out, seed, plants, knobs)
    spent = _search(study, name, target, trials, seed, plants, progress or silent)
    settings, scored, before, after = _chosen(study, name, target, knobs)
    belief = target.belief()
    tuning = Tuning(
        settings,
        tuple(sorted(effect.name for effect in belief.effects)),
        f"rdpi tune {name} --task {target.name} --trials {trials} --plants {plants} --seed {seed}",
        seed,
        spent + (1 + FINALISTS) * before.plant_samples,
        scored,
    )
    write_tunings(path, name, known | {target.name: tuning})
    made = _made(name, settings, belief, target.layout())
    statements = certificate_of(made), warning_of(made)
    return Tuned(name, target.name, tuning, _done(study), before, after, *statements, path)


def _chosen(
    study: Study, name: str, task: StageTask, knobs: Sequence[Knob]
) -> tuple[Settings, float, Figures, Figures]:
    """Choose among the defaults and the best trials on validation plants, failures first.

    What did best on a few training plants may have been made for them. Settings whose loop is outside
    its stability limit on the belief are not chosen, however well they did.
    """
    tried = [trial for trial in study.get_trials(deepcopy=False) if trial.value is not None]
    ordered = sorted(tried, key=lambda trial: (trial.value or 0.0, trial.number))
    defaults = checked_settings(name, knobs, {})
    before = figures(name, defaults, task, "validation", VALIDATION_PLANTS)
    found: list[tuple[Settings, float, Figures]] = []
    for trial in ordered:
        settings = checked_settings(name, knobs, trial.params)
        is_default = settings == defaults
        if (len(found) < FINALISTS or is_default) and _is_stable(name, settings, task):
            after = before
            if not is_default:
                after = figures(name, settings, task, "validation", VALIDATION_PLANTS)
            found.append((settings, float(trial.value or 0.0), after))
    if not found:
        raise InputError(
            f"{name} has no stable loop on {task.name} with any of {len(tried)} settings; give more --trials"
        )
    settings, value, after = min(found, key=lambda each: (each[2].failures, each[2].objective))
    return settings, value, before, after


def certified(name: str, task: str) -> str:
    """Return what is known of a controller on a task's belief before it drives anything, one line."""
    target = named_task(task)
    made = make_controller(name, target.belief(), target.layout())
    warned = warning_of(made)
    line = f"{name} on {target.name}, certificate: {certificate_of(made) or 'none'}"
    return f"{line}; warning: {warned}" if warned else line


def figures(
    name: str,
    settings: Settings,
    task: StageTask,
    split: Split,
    plants: int,
    seed: int | None = None,
) -> Figures:
    """Score a controller with settings on draws of a task."""
    found: list[float] = []
    samples = 0
    for lanes in task.lanes(split, plants, seed):
        controller = _made(name, settings, lanes.belief, lanes.layout())
        found += _plant_errors(controller, lanes)
        samples += task.samples * len(lanes.numbers)
    errors = np.array(found)
    return Figures(
        float(interquartile_mean(errors)),
        float(ninetieth(errors)),
        float(errors.max()),
        int(np.sum(errors >= WORST_PERCENT)),
        len(errors),
        samples,
    )


def _made(
    name: str, settings: Settings, belief: PlantModel, layout: ObservationLayout
) -> Controller:
    return CONTROLLERS[name](belief, layout, settings=settings)  # type: ignore[call-arg]


def _is_stable(name: str, settings: Settings, task: StageTask) -> bool:
    """Whether the loop is within its stability limit on every belief, where the controller knows of one."""
    every = range(len(task.nominals))
    made = (_made(name, settings, task.belief(each), task.layout(each)) for each in every)
    certified: list[Certificate | None] = [getattr(each, "certified", None) for each in made]
    return all(each is None or each.stable for each in certified)


def _plant_errors(controller: Any, lanes: Lanes) -> list[float]:
    """RMSE (%) of each plant as a ranking counts it."""
    taken = play(controller, lanes.track(lanes.layout()), lanes.references_um, lanes.noises)
    rows = plant_scores(lanes.task, lanes, taken).values()
    return [
        WORST_PERCENT if row["failure"] else min(float(row["rmse_percent"]), WORST_PERCENT)
        for row in rows
    ]


def _knobs(name: str) -> Sequence[Knob]:
    knobs: Sequence[Knob] = getattr(CONTROLLERS.get(name), "knobs", ())
    if not knobs:
        tunable = [each for each, make in CONTROLLERS.items() if getattr(make, "knobs", ())]
        close = guess(name, tunable)
        raise InputError(
            f"{quoted(name)} has no knobs to turn; {close and close + ' '}those that have are {some(tunable, 20)}"
        )
    return knobs


def _study(
    name: str, task: StageTask, out: Path, seed: int, plants: int, knobs: Sequence[Knob]
) -> Study:
    # what a trial depends on is in the study's name: another search never goes on with it
    drawn = (task.nominals, task.beliefs, task.references, task.samples, tuple(knobs))
    stamp = zlib.crc32(repr(drawn).encode())
    return open_study(
        out / f"{name}.journal", f"{name} {task.name} seed {seed} plants {plants} {stamp:08x}"
    )


def _done(study: Study) -> int:
    return sum(trial.state.is_finished() for trial in study.get_trials(deepcopy=False))


def _search(
    study: Study,
    name: str,
    task: StageTask,
    trials: int,
    seed: int,
    plants: int,
    progress: Progress,
) -> int:
    """Try settings until there are enough, and return the plant samples that all of them took."""
    from optuna.samplers import TPESampler
    from optuna.trial import TrialState

    knobs = _knobs(name)
    begins = _first_settings(knobs)
    for done in range(_done(study), trials):
        progress("trying settings", done, trials)
        # a sampler a trial: a search that was interrupted goes on as if it had not been
        study.sampler = TPESampler(seed=zlib.crc32(f"{seed} {done}".encode()), n_startup_trials=4)
        if done < len(begins):
            study.enqueue_trial(begins[done])
        trial = study.ask()
        settings = _suggested(trial, knobs)
        try:
            usable = _is_stable(name, settings, task)
            found = figures(name, settings, task, "training", plants, seed) if usable else None
        except InputError:  # no controller with these settings
            found = None
        if found is None:
            study.tell(trial, state=TrialState.FAIL)
            continue
        trial.set_user_attr("plant_samples", found.plant_samples)
        study.tell(trial, found.objective)
    progress("trying settings", trials, trials)
    finished = study.get_trials(deepcopy=False)
    if not any(trial.state is TrialState.COMPLETE for trial in finished):
        raise InputError(
            f"{name} cannot be made on {task.name} with any of {trials} settings, or has no stable loop; "
            "give more --trials"
        )
    return sum(int(trial.user_attrs.get("plant_samples", 0)) for trial in finished)


def _first_settings(knobs: Sequence[Knob]) -> list[dict[str, float]]:
    """Return the defaults, then each knob alone moved a fifth of its range down and up."""
    defaults = {knob.name: knob.default for knob in knobs}
    moved = [defaults | {knob.name: knob.at(part)} for knob in knobs for part in (-0.2, 0.2)]
    return [defaults, *moved]


def _suggested(trial: Trial, knobs: Sequence[Knob]) -> Mapping[str, float]:
    return {
        knob.name: trial.suggest_float(knob.name, knob.low, knob.high, log=knob.logarithmic)
        for knob in knobs
    }
