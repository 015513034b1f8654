"""What is asked of a training of a student."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from baselines.adaptive_dual_loop import AdaptiveDualLoop
from baselines.learned.folder import FORMAT, VERSION
from baselines.learned.imitation.teacher import taught_lanes
from rdpi_gym.envs.tasks import StageTask, named_task
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError


@dataclass(frozen=True)
class Options:
    """Options of a training; the comment under each says what it does.

    Raises
    ------
    InputError
        A value that nothing can be taught with.
    """

    out: Path = Path("results/train-imitation")
    # Folder of the run. The same options with the same folder continue an interrupted run.
    seed: int = 0
    # Of weights, plants, references and noise: the same seed, the same run.
    task: str = "Stage"
    # Its training draws are taught on, its validation draws choose the policy.
    timesteps: int = 30_000_000
    # Of all plants together; rounded to whole rounds.
    lanes: int = 96
    # Side by side in a round, each plant with every reference of the task.
    every: int | None = None
    # Steps between evaluations, each with a checkpoint; None: a twentieth of all.
    hidden: int = 64
    # Width of the recurrent layer.
    learning_rate: float = 3e-3
    # At the begin; it falls to 3 % along a cosine.
    held_out: int = 8
    # Validation plants.
    threads: int = 1
    # Of torch.

    def __post_init__(self) -> None:
        for name in ("timesteps", "lanes", "every", "hidden", "held_out", "threads"):
            value = getattr(self, name)
            if value is not None and (type(value) is not int or value < 1):
                raise InputError(f"{name} is {value!r}; give a whole number of 1 or more")
        if type(self.seed) is not int or not 0 <= self.seed < 2**32:
            raise InputError(f"seed is {self.seed!r}; give a whole number of 0 to 2^32 - 1")
        if not (is_finite(self.learning_rate) and self.learning_rate > 0.0):
            raise InputError(f"learning_rate is {self.learning_rate!r}; give a number above 0")
        references = len(self.stage.references)
        if self.lanes % references:
            raise InputError(
                f"lanes is {self.lanes}, and every plant of {self.task} has {references} references; "
                f"give a multiple of {references}"
            )
        taught_lanes(self.stage, "validation", range(1), self.seed)

    @property
    def stage(self) -> StageTask:
        """The task."""
        return named_task(self.task)

    @property
    def baseline(self) -> str:
        """Name of the controller that is corrected, and compared with."""
        return AdaptiveDualLoop.name

    def document(self) -> dict[str, Any]:
        """All that the result depends on, as JSON holds it."""
        kept = asdict(self) | {"task": self.stage.name}
        del kept["out"]
        nominals = [model.to_dict() for model in self.stage.nominals]
        return {
            "format": FORMAT,
            "version": VERSION,
            "algorithm": "imitation",
            "options": kept | {"nominals": nominals},
            "versions": {name: version(name) for name in ("torch", "numpy")},
        }
