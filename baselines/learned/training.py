"""Training, from the newest checkpoint on."""

from __future__ import annotations

from pathlib import Path

from baselines.learned.checkpoint import load_checkpoint
from baselines.learned.course import Course
from baselines.learned.folder import CHECKPOINT, POLICY, begin_folder
from baselines.learned.learner import Learner
from baselines.learned.run import Run
from rdpi_gym.support.progress import Progress


def learn(run: Run, learner: Learner, progress: Progress | None = None) -> Path:
    """Train, from the newest checkpoint on; the best policy so far lies in ``policy``."""
    course = Course(run, learner, progress)
    begin_folder(run.options.out, run.document())
    kept = load_checkpoint(run.options.out / CHECKPOINT, learner)
    if kept is not None:
        course.resume(kept)
    left = run.timesteps - learner.timesteps
    if left > 0:
        learner.learn(left, course)
    return run.options.out / POLICY
