"""The environments of the tasks: their plants, what is shown with its history, their pages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.piezo_tracking import PiezoTrackingEnv
from rdpi_gym.envs.tasks.changing import ChangingPlant
from rdpi_gym.envs.tasks.page import page_of
from rdpi_gym.envs.tasks.task import StageTask
from rdpi_gym.envs.tracking import NoiseSource, TrackingTask
from rdpi_gym.envs.truth import TruthSource
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.envs.wrappers.history import History, VectorHistoryObservation
from rdpi_gym.plant import PlantModel


class TaskTruths(TruthSource):
    """Draws the plant of each episode by a task's own law.

    Parameters
    ----------
    task
        The task.
    **options
        Those of :class:`~rdpi_gym.envs.truth.TruthSource`.

    Attributes
    ----------
    later : dict
        What the plant drawn last becomes within its episode.
    """

    def __init__(self, task: StageTask, **options: Any) -> None:
        super().__init__(**options)
        self._task = task
        self.later: Mapping[int, PlantModel] = {}

    def draw(
        self, rng: np.random.Generator, options: Mapping[str, Any], layout: ObservationLayout
    ) -> PlantModel:
        """Return the plant of an episode; see :meth:`TruthSource.draw`."""
        self.later = {}
        model = self.given(options, layout)
        if model is None:
            number = int(rng.integers(len(self._task.nominals)))
            model, self.later = self._task.truth(rng, number)
        return model


class TaskEnv(PiezoTrackingEnv):
    """The environment of a task: training draws of its plants, references and noise.

    Parameters
    ----------
    history
        Earlier samples in an observation; by default the task's.
    **options
        Those of :class:`~rdpi_gym.envs.PiezoTrackingEnv`, in place of the task's.

    Attributes
    ----------
    task : StageTask
        What the class is of.

    Examples
    --------
    >>> import gymnasium
    >>> import rdpi_gym
    >>> env = gymnasium.make("rdpi_gym/PiezoStage-v0", action="increment")
    >>> env.reset(seed=0)[0].shape
    (107,)
    """

    task: ClassVar[StageTask]

    def __init__(self, *, history: int | None = None, **options: Any) -> None:
        super().__init__(**{**self.task.options, **options})
        self.history = History(self.layout, self.task.history if history is None else history)
        assert isinstance(self.observation_space, Box)
        stacked: Any = self.history.space(self.observation_space)
        self.observation_space = stacked
        self._draws_own = self.task.changes and not {"plant", "randomise", "ts_s"} & set(options)
        if self._draws_own:
            self.truths = TaskTruths(
                self.task,
                plant=self.nominal,
                rate_bandwidth_hz=None,
                sensor={},
                half_width=self.truths.half_width,
                effects_half_width=self.truths.effects_half_width,
            )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode; see :class:`~rdpi_gym.envs.PiezoTrackingEnv`."""
        observation, info = super().reset(seed=seed, options=options)
        self._last = observation[None]
        self._past = self.history.begin(self._last)
        return self.history.stack(self._last, self._past)[0], info

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Set the next command; see :class:`~rdpi_gym.envs.PiezoTrackingEnv`."""
        observation, reward, terminated, truncated, info = super().step(action)
        self._past = self.history.past(self._last, self._past)
        self._last = observation[None]
        shown = self.history.stack(self._last, self._past)[0]
        return shown, reward, terminated, truncated, info

    @property
    def later(self) -> Mapping[int, PlantModel]:
        """What the plant of this episode becomes, by the sample at which it does."""
        changes: Mapping[int, PlantModel] = getattr(self.truths, "later", {})
        return changes

    def _track(self, truth: PlantModel) -> TrackingTask:
        if not (self.later or self.task.command_step_V):
            return super()._track(truth)
        plant = ChangingPlant([truth], self.layout.ts_s, [self.later], self.task.command_step_V)
        return TrackingTask(plant, self.layout, self.bound_um)

    def _noise(self, rng: np.random.Generator) -> NoiseSource:
        return self.task.noise_of(rng)


def environment_of(task: StageTask, module: str) -> type[TaskEnv]:
    """Return the class of a task's environment, whose docstring is the task's page."""
    name = f"Piezo{task.name}Env"
    return type(name, (TaskEnv,), {"__doc__": page_of(task), "__module__": module, "task": task})


def environments_of(
    task: StageTask, module: str
) -> tuple[type[TaskEnv], Callable[..., VectorHistoryObservation | PiezoTrackingVectorEnv]]:
    """Return the environment of a task and its vector environment: see :func:`vector_of`."""
    return environment_of(task, module), partial(vector_of, task)


def vector_of(
    task: StageTask, num_envs: int, history: int | None = None, **options: Any
) -> VectorHistoryObservation | PiezoTrackingVectorEnv:
    """Return the vector environment of a task whose plants are numbers about one nominal plant."""
    lanes = PiezoTrackingVectorEnv(num_envs, **{**task.options, **options})
    steps = task.history if history is None else history
    return VectorHistoryObservation(lanes, steps) if steps else lanes
