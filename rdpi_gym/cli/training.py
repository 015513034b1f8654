"""`rdpi train`, `rdpi tune`, `rdpi collect`: policies, settings of controllers, data for learning."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import OutOption, SeedOption, words
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.options import Option
from rdpi_gym.support.progress import Lines, progress_bar


class Algorithm(StrEnum):
    """Learning algorithms."""

    ppo = "ppo"
    sac = "sac"
    td3 = "td3"
    native_ppo = "native-ppo"
    imitation = "imitation"


def _names(text: str) -> tuple[str, ...]:
    return tuple(words(text) or ())


def _frequencies(text: str) -> tuple[float, float]:
    try:
        low, high = map(float, text.split(","))
    except ValueError:
        raise InputError(
            f"--frequency {text!r} is not two numbers; give the lowest and the highest (Hz), for example 20,100"
        ) from None
    return low, high


@dataclass(frozen=True)
class TrainingWords:
    """Options of a training by their keywords, and of a sweep of them.

    Parameters
    ----------
    timesteps
        Steps of all plants together; else the YAML's.
    lanes
        Plants side by side; else the YAML's.
    hyperparameters
        As rl-baselines3-zoo reads them.
    every
        Between evaluations and checkpoints.
    action
        correction (default), command or increment.
    baseline
        Compensator to correct or compare with.
    task
        Of imitation: whose plants; else Stage. Several share one student.
    hidden
        Of imitation: width of the recurrent layer.
    passes
        Of imitation: through what a round met.
    jobs
        Of imitation: processes that drive.
    plants
        Else P10 with and without further effects.
    belief
        The baseline's; else no effects.
    reference
        One is drawn each time.
    frequency_hz
        Lowest and highest.
    ts_s
        Sampling time.
    command_cost
        Price of command changes.
    threads
        Of the learner; native-ppo gains from one a core.
    device
        Of native-ppo: it runs on a CPU.
    tensorboard
        Write TensorBoard's logs too.
    sweep
        Find hyper-parameters by N trainings.
    search_space
        Of a sweep; else the algorithm's.
    """

    timesteps: int | None = Option("--timesteps", type=int).optional
    lanes: int | None = Option("--lanes", type=int).optional
    hyperparameters: Path | None = Option("--hyperparameters", "YAML", Path).optional
    every: int | None = Option("--every", "STEPS", int).optional
    action: str | None = Option("--action").optional
    baseline: str | None = Option("--baseline", "NAME").optional
    task: str | None = Option("--task", "NAME,...").optional
    hidden: int | None = Option("--hidden", type=int).optional
    passes: int | None = Option("--passes", type=int).optional
    jobs: int | None = Option("--jobs", type=int).optional
    plants: tuple[str, ...] | None = Option("--plants", "NAME|FILE,...", read=_names).optional
    belief: str | None = Option("--belief", "NAME|FILE").optional
    reference: tuple[str, ...] | None = Option("--references", "NAME,...", read=_names).optional
    frequency_hz: tuple[float, float] | None = Option(
        "--frequency", "HZ,HZ", read=_frequencies
    ).optional
    ts_s: float | None = Option("--ts", "SECONDS", float).optional
    command_cost: float | None = Option("--command-cost", type=float).optional
    threads: int | None = Option("--threads", type=int).optional
    device: str | None = Option("--device", "cpu").optional
    tensorboard: bool = field(default=False, metadata=Option("--tensorboard", type=bool).metadata)
    sweep: int | None = Option("--sweep", "N", int).optional
    search_space: Path | None = Option("--search-space", "YAML", Path).optional


def train(
    algorithm: Annotated[
        Algorithm, typer.Argument(metavar="ppo|sac|td3|native-ppo|imitation", show_default=False)
    ],
    asked: TrainingWords,
    out: OutOption = Path("results/train"),
    seed: SeedOption = 0,
) -> None:
    """Train a policy that tracks on plants with effects its belief lacks.

    The same command continues an interrupted run, exactly. The policy is then a controller:
    `rdpi bench --controller learned:DIR/policy`.
    """
    given = vars(asked) | {"tensorboard": asked.tensorboard or None}
    options: dict[str, Any] = {name: each for name, each in given.items() if each is not None}
    trials, space = options.pop("sweep", None), options.pop("search_space", None)
    taken = rg.training_options(algorithm.value)
    for each in fields(asked):
        if each.name in options and each.name not in taken:
            flag = each.metadata["option"].flag
            raise InputError(f"{flag} is no option of {algorithm.value}; leave it out")
    if space is not None and trials is None:
        raise InputError("--search-space belongs to a sweep; give --sweep and the number of trials")
    with progress_bar(Lines()) as show:
        options |= {"seed": seed, "progress": show}
        if trials is not None:
            found = rg.sweep(algorithm.value, out, trials=trials, space=space, **options)
        else:
            training = rg.train(algorithm.value, out, **options)
    if trials is not None:
        print(found)
        return
    print(training)
    print(f"policy: {training.policy}")


def tune(
    controller: str,
    task: str = "Stage",
    out: OutOption = Path("results/tune"),
    trials: int = 40,
    plants: int = 16,
    seed: SeedOption = 0,
) -> None:
    """Find the settings of a controller on training draws of a task, and score them on others.

    What its loop is certain of is printed first. The same command continues an interrupted search.

    Parameters
    ----------
    controller : CONTROLLER
    task : NAME,...
        Tasks, one after the other.
    trials
        Settings that are tried.
    plants
        Training plants, each with every reference.
    """
    asked = words(task) or [task]
    for each in asked:
        print(rg.certificate(controller, each), flush=True)
    for each in asked:
        with progress_bar() as show:
            found = rg.tune(
                controller, each, out, trials=trials, seed=seed, plants=plants, progress=show
            )
        print(found, flush=True)


class Action(StrEnum):
    """Meanings of an action."""

    command = "command"
    increment = "increment"


def collect(
    task: str = "Stage",
    controllers: str = "true-plant-horizon,pi-preview,adaptive-feedforward,random",
    episodes: int = 40,
    out: OutOption = Path("results/dataset"),
    steps: int | None = None,
    seed: SeedOption = 0,
    action: Action = Action.command,
) -> None:
    """Write episodes of a task's training draws, driven by controllers, for offline learning.

    Minari loads them; true-plant-horizon knows the true plant, random knows nothing.

    Parameters
    ----------
    task : NAME
        Short name or id of a task.
    controllers : NAME,...
        Each drives an equal share of the episodes.
    episodes
        How many in all.
    steps
        Of an episode; else the task's, 2500.
    action : command|increment
        What an action is.
    """
    with progress_bar() as show:
        collection = rg.collect(
            task, words(controllers) or [], episodes, out,
            steps=steps, seed=seed, action=action.value, progress=show,
        )  # fmt: skip
    print(collection)
