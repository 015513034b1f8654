"""Train a policy with PPO: ``rdpi train ppo``.

From Python: ``python -m baselines.learned.train_ppo`` takes the options below as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stable_baselines3 import PPO
from torch import nn

from baselines.learned.options import TrainingOptions
from baselines.learned.run import Run
from baselines.learned.stable_baselines import StableBaselinesLearner
from baselines.learned.training import learn
from rdpi_gym.support.progress import Progress


@dataclass(frozen=True)
class Options(TrainingOptions):
    """Options of a training with PPO; its hyper-parameters are in ``hyperparameters/ppo.yml``."""

    out: Path = Path("results/train-ppo")


def train(options: Options, progress: Progress | None = None) -> Path:
    """Train, or go on with what was interrupted."""
    # What was asked for; a folder with a run of other options is refused.
    run = Run.open(options, "ppo", PPO)
    # The agent, its networks drawn from the seed, among thousands of plants side by side: it is
    # shown observations with their history, in fixed units.
    learner = StableBaselinesLearner(run, PPO, actor)
    # Between stretches it is evaluated, and a checkpoint kept; the best policy stays.
    return learn(run, learner, progress)


def actor(model: PPO) -> list[nn.Module]:
    """Return the deterministic actor: the mean of its Gaussian, clipped as actions are."""
    policy = model.policy
    return [*policy.mlp_extractor.policy_net, policy.action_net, nn.Hardtanh()]


if __name__ == "__main__":
    print(train(Options()))
