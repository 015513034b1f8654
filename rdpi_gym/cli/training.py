"""`rdpi train`, `rdpi tune`, `rdpi collect`: policies, settings of controllers, data for learning."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import OutOption, SeedOption, words
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import progress_bar


class Algorithm(StrEnum):
    """Learning algorithms."""

    ppo = "ppo"
    sac = "sac"
    td3 = "td3"
    native_ppo = "native-ppo"
    imitation = "imitation"


def train(
    algorithm: Annotated[
        Algorithm, typer.Argument(metavar="ppo|sac|td3|native-ppo|imitation", show_default=False)
    ],
    out: OutOption = Path("results/train"),
    seed: SeedOption = 0,
    timesteps: Annotated[
        int | None,
        typer.Option("--timesteps", help="Steps of all plants together; else the YAML's."),
    ] = None,
    lanes: Annotated[
        int | None, typer.Option("--lanes", help="Plants side by side; else the YAML's.")
    ] = None,
    hyperparameters: Annotated[
        Path | None,
        typer.Option("--hyperparameters", metavar="YAML", help="As rl-baselines3-zoo reads them."),
    ] = None,
    every: Annotated[
        int | None,
        typer.Option("--every", metavar="STEPS", help="Between evaluations and checkpoints."),
    ] = None,
    action: Annotated[
        str | None,
        typer.Option("--action", help="correction (default), command or increment."),
    ] = None,
    baseline: Annotated[
        str | None,
        typer.Option("--baseline", metavar="NAME", help="Compensator to correct or compare with."),
    ] = None,
    task: Annotated[
        str | None,
        typer.Option("--task", metavar="NAME", help="Of imitation: whose plants; else Stage."),
    ] = None,
    plants: Annotated[
        str | None,
        typer.Option(
            "--plants", metavar="NAME|FILE,...", help="Else P10 with and without further effects."
        ),
    ] = None,
    belief: Annotated[
        str | None,
        typer.Option("--belief", metavar="NAME|FILE", help="The baseline's; else no effects."),
    ] = None,
    references: Annotated[
        str | None, typer.Option("--references", metavar="NAME,...", help="One is drawn each time.")
    ] = None,
    frequency: Annotated[
        str | None, typer.Option("--frequency", metavar="HZ,HZ", help="Lowest and highest.")
    ] = None,
    ts: Annotated[
        float | None, typer.Option("--ts", metavar="SECONDS", help="Sampling time.")
    ] = None,
    command_cost: Annotated[
        float | None, typer.Option("--command-cost", help="Price of command changes.")
    ] = None,
    threads: Annotated[
        int | None,
        typer.Option("--threads", help="Of the learner; native-ppo gains from one a core."),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option("--device", metavar="cpu", help="Of native-ppo: it runs on a CPU."),
    ] = None,
    tensorboard: Annotated[
        bool, typer.Option("--tensorboard", help="Write TensorBoard's logs too.")
    ] = False,
    sweep: Annotated[
        int | None,
        typer.Option("--sweep", metavar="N", help="Find hyper-parameters by N trainings."),
    ] = None,
    search_space: Annotated[
        Path | None,
        typer.Option("--search-space", metavar="YAML", help="Of a sweep; else the algorithm's."),
    ] = None,
) -> None:
    """Train a policy that tracks on plants with effects its belief lacks.

    The same command continues an interrupted run, exactly. The policy is then a controller:
    `rdpi bench --controller learned:DIR/policy`.
    """
    given: dict[str, Any] = {
        "timesteps": timesteps,
        "lanes": lanes,
        "hyperparameters": hyperparameters,
        "every": every,
        "action": action,
        "baseline": baseline,
        "task": task,
        "plants": None if plants is None else tuple(words(plants) or ()),
        "belief": belief,
        "reference": None if references is None else tuple(words(references) or ()),
        "frequency_hz": None if frequency is None else _frequencies(frequency),
        "ts_s": ts,
        "command_cost": command_cost,
        "threads": threads,
        "device": device,
        "tensorboard": tensorboard or None,
    }
    options = {name: value for name, value in given.items() if value is not None}
    taken = rg.training_options(algorithm.value)
    for name in options:
        if name not in taken:
            flag = _FLAGS.get(name, name.replace("_", "-"))
            raise InputError(f"--{flag} is no option of {algorithm.value}; leave it out")
    if search_space is not None and sweep is None:
        raise InputError("--search-space belongs to a sweep; give --sweep and the number of trials")
    if sweep is not None:
        with progress_bar() as show:
            found = rg.sweep(
                algorithm.value, out, trials=sweep, space=search_space, seed=seed,
                progress=show, **options,
            )  # fmt: skip
        print(found)
        return
    with progress_bar() as show:
        training = rg.train(algorithm.value, out, seed=seed, progress=show, **options)
    print(training)
    print(f"policy: {training.policy}")


_FLAGS = {"reference": "references", "frequency_hz": "frequency", "ts_s": "ts"}
"""Flags that are called otherwise than their option."""


def _frequencies(text: str) -> tuple[float, float]:
    try:
        low, high = map(float, text.split(","))
    except ValueError:
        raise InputError(
            f"--frequency {text!r} is not two numbers; give the lowest and the highest (Hz), for example 20,100"
        ) from None
    return low, high


def tune(
    controller: Annotated[str, typer.Argument(metavar="CONTROLLER", show_default=False)],
    task: Annotated[
        str, typer.Option("--task", metavar="NAME,...", help="Tasks, one after the other.")
    ] = "Stage",
    out: OutOption = Path("results/tune"),
    trials: Annotated[int, typer.Option("--trials", help="Settings that are tried.")] = 40,
    plants: Annotated[
        int, typer.Option("--plants", help="Training plants, each with every reference.")
    ] = 16,
    seed: SeedOption = 0,
) -> None:
    """Find the settings of a controller on training draws of a task, and score them on others.

    What its loop is certain of is printed first. The same command continues an interrupted search.
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
    task: Annotated[
        str, typer.Option("--task", metavar="NAME", help="Short name or id of a task.")
    ] = "Stage",
    controllers: Annotated[
        str,
        typer.Option(
            "--controllers", metavar="NAME,...", help="Each drives an equal share of the episodes."
        ),
    ] = "true-plant-horizon,pi-preview,adaptive-feedforward,random",
    episodes: Annotated[int, typer.Option("--episodes", help="How many in all.")] = 40,
    out: OutOption = Path("results/dataset"),
    steps: Annotated[
        int | None, typer.Option("--steps", help="Of an episode; else the task's, 2500.")
    ] = None,
    seed: SeedOption = 0,
    action: Annotated[
        Action, typer.Option("--action", metavar="command|increment", help="What an action is.")
    ] = Action.command,
) -> None:
    """Write episodes of a task's training draws, driven by controllers, for offline learning.

    Minari loads them; true-plant-horizon knows the true plant, random knows nothing.
    """
    with progress_bar() as show:
        collection = rg.collect(
            task, words(controllers) or [], episodes, out,
            steps=steps, seed=seed, action=action.value, progress=show,
        )  # fmt: skip
    print(collection)
