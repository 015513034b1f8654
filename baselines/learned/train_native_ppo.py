"""Train a policy with the PPO of this package: ``rdpi train native-ppo``.

From Python: ``python -m baselines.learned.train_native_ppo`` takes the options below as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from baselines.learned.native.learner import NativeLearner
from baselines.learned.native.loop import PPOLoop
from baselines.learned.native.ppo import NativePPO
from baselines.learned.options import TrainingOptions
from baselines.learned.run import Run
from baselines.learned.training import learn
from rdpi_gym.support.progress import Progress


@dataclass(frozen=True)
class Options(TrainingOptions):
    """Options of a training; its hyper-parameters are in ``hyperparameters/native-ppo.yml``.

    Of a training on a device they are in ``native-ppo-device.yml``.

    Without `every` a stretch has a twentieth of all steps, and two episodes of every lane at least.
    """

    out: Path = Path("results/train-native-ppo")
    device: str | None = None
    # Of torch, "cuda" or "cpu", on which plants and networks stay; None: the kernels of a CPU.

    def file(self, algorithm: str) -> Path:
        """Hyper-parameters: on a device those of so many lanes that it has enough to do."""
        return super().file(algorithm if self.device is None else f"{algorithm}-device")


def train(options: Options, progress: Progress | None = None) -> Path:
    """Train, or go on with what was interrupted."""
    # What was asked for; a folder with a run of other options is refused.
    run = Run.open(options, "native-ppo", NativePPO, samples=2 * options.episode)
    # The agent, its networks drawn from the seed, among the plants that write what they show into
    # its rollouts.
    learner = learner_of(run, options.device)
    # Between stretches it is evaluated, and a checkpoint kept; the best policy stays.
    return learn(run, learner, progress)


def learner_of(run: Run, device: str | None) -> PPOLoop:
    """Return what learns: among the kernels of a CPU, or on a device of torch."""
    if device is None:
        return NativeLearner(run)
    from baselines.learned.device.learner import DeviceLearner  # the plant in torch, where needed

    return DeviceLearner(run, device)


if __name__ == "__main__":
    print(train(Options()))
