"""The students that ship: taught on one task each, by the same command that a user has."""

from __future__ import annotations

import shutil
from pathlib import Path

from baselines.learned.imitation.rounds import Options, train
from rdpi_gym.support.files import replaced_folder
from rdpi_gym.support.progress import Progress


def teach(
    task: str, timesteps: int, runs: Path, target: Path, progress: Progress | None = None
) -> Path:
    """Teach a student on a task, from where an earlier run stopped, and put it among what ships."""
    name = f"imitation-{task.lower()}"
    options = Options(out=runs / name, task=task, timesteps=timesteps)
    policy = train(options, progress)
    with replaced_folder(target / name) as fresh:
        for file in sorted(policy.iterdir()):
            shutil.copyfile(file, fresh / file.name)
    return target / name
