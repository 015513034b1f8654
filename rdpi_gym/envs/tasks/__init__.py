"""The registered tasks: stages from easy to hard, each with its references, belief and protocol.

What a task is stands in :mod:`rdpi_gym.envs.tasks.task`; the tasks themselves, a family a file, beside it. ``gymnasium.make("rdpi_gym/PiezoStage-v0")`` makes the
environment of one; its docstring is its page.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rdpi_gym.envs.tasks.task import PUBLIC_SEED, Draw, Lanes, Split, StageTask
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.plugins import modules_of
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

_FOUND = {
    value.name: value
    for module in modules_of(__name__)
    for value in vars(module).values()
    if isinstance(value, StageTask)
}
TASKS: Mapping[str, StageTask] = MappingProxyType(
    dict(sorted(_FOUND.items(), key=lambda item: item[1].rank))
)
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
