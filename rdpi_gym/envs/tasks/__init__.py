"""The registered tasks: stages from easy to hard, each with its references, belief and protocol.

What a task is stands in :mod:`rdpi_gym.envs.tasks.task`; the tasks themselves, a family a file, in
``one_effect``, ``whole_stage`` and ``structure``. ``gymnasium.make("rdpi_gym/PiezoStage-v0")`` makes the
environment of one; its docstring is its page.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rdpi_gym.envs.tasks.one_effect import BARE, CREEP_TASK, LAG_TASK, RESONANCE_TASK
from rdpi_gym.envs.tasks.structure import BOUC_WEN, DUHEM, MEASURED, PREISACH
from rdpi_gym.envs.tasks.task import PUBLIC_SEED, Draw, Lanes, Split, StageTask
from rdpi_gym.envs.tasks.whole_stage import AGEING, LOAD, RASTER, ROUGH, STAGE, STEPS
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import guess, quoted

__all__ = [
    "PUBLIC_SEED",
    "TASKS",
    "Draw",
    "Lanes",
    "Split",
    "StageTask",
    "named_task",
]

TASKS: Mapping[str, StageTask] = MappingProxyType(
    {
        task.name: task
        for task in (
            BARE, CREEP_TASK, LAG_TASK, RESONANCE_TASK, STAGE, LOAD, AGEING, ROUGH, RASTER, STEPS,
            MEASURED, PREISACH, BOUC_WEN, DUHEM,
        )
    }
)  # fmt: skip
"""Every task by its short name, from easy to hard."""


def named_task(name: str) -> StageTask:
    """Return a task by its short name or its id.

    Raises
    ------
    InputError
        No task has it.

    Examples
    --------
    >>> named_task("Stage") is named_task("rdpi_gym/PiezoStage-v0")
    True
    >>> named_task("Stag")
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: no task is named 'Stag'; did you mean 'Stage'? known are ...
    """
    for task in TASKS.values():
        if name in (task.name, task.id):
            return task
    close = guess(name, TASKS)
    raise InputError(
        f"no task is named {quoted(name)}; {close and close + ' '}known are {', '.join(TASKS)}"
    )
