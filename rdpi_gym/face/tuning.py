"""`tune` and `certificate`: settings of a controller, and what its loop is certain of, on a task."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from benchmarks.stages import tuning
from benchmarks.stages.tuning import Tuned
from rdpi_gym.support.checked import checked
from rdpi_gym.support.progress import Progress


@checked
def tune(
    controller: str,
    task: str = "Stage",
    out: PathLike[str] | str = "results/tune",
    *,
    trials: int = 40,
    seed: int = 0,
    plants: int = 16,
    progress: Progress | None = None,
) -> Tuned:
    """Find settings of a controller with Optuna; the same call goes on with an interrupted search.

    Parameters
    ----------
    controller
        Name of one with knobs, such as ``dual-loop``.
    task
        Short name or id of a registered task; its training draws are used, and its validation draws
        to say what was found.
    out
        Folder of the search and of ``CONTROLLER.json``, the settings by task.
    trials
        Settings that are tried, the defaults among them.
    seed
        Of the draws and of the search.
    plants
        Training plants, each with every reference of the task.
    progress
        Called as ``progress(stage, done, total)``.

    Returns
    -------
    benchmarks.stages.tuning.Tuned
        It prints the error on validation plants with what was found and without.

    Raises
    ------
    InputError
        The controller has no knobs, there is no such task, a number is out of range, or
        ``rdpi-gym[tune]`` is not installed.
    """
    return tuning.tune(
        controller, task, Path(out), trials=trials, seed=seed, plants=plants, progress=progress
    )


@checked
def certificate(controller: str, task: str = "Stage") -> str:
    """Say what is certain of a controller's loop on what a task believes, before it drives anything.

    Parameters
    ----------
    controller
        Name of one that ships.
    task
        Short name or id of a registered task.

    Returns
    -------
    str
        One line: small gain, passivity or poles where one of them holds, and the controller's
        warning where it has one.

    Raises
    ------
    InputError
        There is no such controller or task.

    Examples
    --------
    >>> certificate("dual-loop", "Bare").split(":")[0]
    'dual-loop on Bare, certificate'
    """
    return tuning.certified(controller, task)
