"""Train a policy with the PPO of this package: ``rdpi train native-ppo``.

From Python: ``python -m baselines.learned.train_native_ppo`` takes the options below as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from baselines.learned.native.learner import NativeLearner, NativePPO
from baselines.learned.options import TrainingOptions
from baselines.learned.run import Run
from baselines.learned.training import learn
from rdpi_gym.support.progress import Progress


@dataclass(frozen=True)
class Options(TrainingOptions):
    """Options of a training; its hyper-parameters are in ``hyperparameters/native-ppo.yml``.

    Without `every` a stretch has a twentieth of all steps, and two episodes of every lane at least.
    """

    out: Path = Path("results/train-native-ppo")


def train(options: Options, progress: Progress | None = None) -> Path:
    """Train, or go on with what was interrupted.

    Parameters
    ----------
    options
        What is asked for.
    progress
        Called with the number of steps done, and in all.

    Returns
    -------
    Path
        Folder of the policy that did best on held-out plants and references.

    Raises
    ------
    InputError
        Options that nothing can be trained with, or a folder that holds something else.
    """
    # What was asked for; a folder with a run of other options is refused.
    run = Run.open(options, "native-ppo", NativePPO, samples=2 * options.episode)
    # The agent, its networks drawn from the seed, among the plants that write what they show into
    # its rollouts.
    learner = NativeLearner(run)
    # Between stretches it is evaluated, and a checkpoint kept; the best policy stays.
    return learn(run, learner, progress)


if __name__ == "__main__":
    print(train(Options()))
