"""Train a policy with SAC: ``rdpi train sac``.

From Python: ``python -m baselines.learned.train_sac`` takes the options below as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stable_baselines3 import SAC
from torch import nn

from baselines.learned.options import TrainingOptions
from baselines.learned.run import Run
from baselines.learned.stable_baselines import StableBaselinesLearner
from baselines.learned.training import learn
from rdpi_gym.support.progress import Progress


@dataclass(frozen=True)
class Options(TrainingOptions):
    """Options of a training with SAC; its hyper-parameters are in ``hyperparameters/sac.yml``."""

    out: Path = Path("results/train-sac")


def train(options: Options, progress: Progress | None = None) -> Path:
    """Train, or go on with what was interrupted."""
    # What was asked for; a folder with a run of other options is refused.
    run = Run.open(options, "sac", SAC)
    # The agent, its networks drawn from the seed, among thousands of plants side by side: it is
    # shown observations with their history, in fixed units.
    learner = StableBaselinesLearner(run, SAC, actor)
    # Between stretches it is evaluated, and a checkpoint kept; the best policy stays.
    return learn(run, learner, progress)


def actor(model: SAC) -> list[nn.Module]:
    """Return the deterministic actor: the mean of its Gaussian, squashed."""
    return [*model.actor.latent_pi, model.actor.mu, nn.Tanh()]


if __name__ == "__main__":
    print(train(Options()))
