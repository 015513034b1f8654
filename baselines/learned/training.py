"""Training, from the newest checkpoint on."""

from __future__ import annotations

from pathlib import Path

import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from baselines.learned.checkpoint import load_checkpoint
from baselines.learned.course import ActorOf, Course
from baselines.learned.run import CHECKPOINT, CONFIG, POLICY, Run
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_json
from rdpi_gym.support.progress import Progress

_DIVERGED = 1e6


def learn(
    run: Run, model: BaseAlgorithm, actor_of: ActorOf, progress: Progress | None = None
) -> Path:
    """Train, from the newest checkpoint on; the best policy so far lies in ``policy``.

    Parameters
    ----------
    run
        The training.
    model
        Fresh, in its :meth:`~baselines.learned.run.Run.environment`.
    actor_of
        Takes the deterministic actor out of a model: linear layers, activations, and what keeps
        actions within [-1, 1].
    progress
        Called as steps are done.

    Returns
    -------
    Path
        Folder of the policy.

    Raises
    ------
    InputError
        The checkpoint cannot be read, or the training diverged.
    """
    course = Course(run, actor_of, progress)
    if not (run.options.out / CONFIG).exists():
        write_json(run.options.out / CONFIG, run.document())
    kept = load_checkpoint(run.options.out / CHECKPOINT, model)
    if kept is not None:
        course.resume(kept)
    left = run.timesteps - model.num_timesteps
    try:
        if left > 0:
            model.learn(
                left,
                callback=course,
                reset_num_timesteps=False,
                tb_log_name=run.algorithm,
                log_interval=1 if run.algorithm == "ppo" else 100,
            )
    except ValueError as error:
        weights = torch.nn.utils.parameters_to_vector(model.policy.parameters())
        largest = float(weights.detach().abs().max())  # NaN where one is
        if largest < _DIVERGED:
            raise
        raise InputError(
            f"the training diverged after {model.num_timesteps} steps: a weight is {largest:.3g}; "
            "take a lower learning_rate"
        ) from error
    return run.options.out / POLICY
