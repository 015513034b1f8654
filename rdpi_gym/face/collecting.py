"""`collect`: episodes of a task driven by controllers, as a dataset that Minari loads."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Literal

from benchmarks.stages import offline
from benchmarks.stages.offline import CONTROLLERS, Collection
from rdpi_gym.support.checked import checked
from rdpi_gym.support.progress import Progress


@checked
def collect(
    task: str = "Stage",
    controllers: Sequence[str] = CONTROLLERS,
    episodes: int = 40,
    out: PathLike[str] | str = "results/dataset",
    *,
    steps: int | None = None,
    seed: int = 0,
    action: Literal["command", "increment"] = "command",
    progress: Progress | None = None,
) -> Collection:
    """Write episodes of a task, driven by controllers, in Minari's format, for offline learning.

    Plants, references and noise are training draws; no test draw is among them.

    Parameters
    ----------
    task
        Short name or id of a registered task.
    controllers
        Names, as :func:`make_controller` takes them, each for an equal share of the episodes;
        ``true-plant-horizon`` alone is given the true plant, ``random`` draws actions evenly.
    episodes
        How many in all.
    out
        Folder of datasets; this one is the folder ``rdpi-TASK-v0`` in it.
    steps
        Of an episode; by default the task's.
    seed
        Of all draws.
    action
        How the environment reads actions: places in the command's range, or increments.
    progress
        Called as ``progress(stage, done, total)``.

    Returns
    -------
    benchmarks.stages.offline.Collection
        It prints the error of each controller; ``minari.MinariDataset`` takes its `data`.

    Raises
    ------
    InputError
        There is no such task or controller, a number is out of range, ``rdpi-gym[minari]`` is not
        installed, or the folder holds a dataset of other options.
    """
    return offline.collect(
        task, controllers, episodes, Path(out), steps=steps, seed=seed, action=action,
        progress=progress,
    )  # fmt: skip
