"""Teach a student on the true plants of a task: ``rdpi train imitation``."""

from __future__ import annotations

from pathlib import Path

import torch

from baselines.learned.folder import begin_folder, check_folder
from baselines.learned.imitation.options import Options
from baselines.learned.imitation.rounds import Rounds
from rdpi_gym.support.progress import Progress

__all__ = ["Options", "train"]


def train(options: Options, progress: Progress | None = None) -> Path:
    """Teach, or go on with what was interrupted."""
    check_folder(options.out, options.document())
    torch.set_num_threads(options.threads)
    begin_folder(options.out, options.document())
    return Rounds(options, progress).run()
