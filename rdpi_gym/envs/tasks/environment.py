"""Environments of the tasks: plants, observations with history, and pages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.piezo_tracking import PiezoTrackingEnv
from rdpi_gym.envs.tasks.task import ChangingPlant, StageTask
from rdpi_gym.envs.tracking import NoiseSource, TrackingTask
from rdpi_gym.envs.truth import ReferenceChoice, TruthSource
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.envs.wrappers.history import History, VectorHistoryObservation
from rdpi_gym.plant import PlantModel
from rdpi_gym.signals import Signal


class TaskTruths(TruthSource):
    """Draws the plant of each episode by a task's own law."""

    def __init__(self, task: StageTask, **options: Any) -> None:
        super().__init__(**options)
        self._task = task
        self.later: Mapping[int, PlantModel] = {}

    def draw(self, seed: int, options: Mapping[str, Any], layout: ObservationLayout) -> PlantModel:
        """Return the plant of an episode; see :meth:`TruthSource.draw`."""
        self.later = {}
        model = self.given(options, layout)
        if model is None:
            rng = np.random.default_rng(seed)
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
        self.layout = replace(self.layout, history=self.history.steps)
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
        """Later plants of this episode, by the sample from which each holds."""
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


def page_of(task: StageTask) -> str:
    """Return a page in Gymnasium's style: plant, belief, references, protocol."""
    first = task.nominals[0]
    history = (
        f"An observation holds {task.history} earlier samples of reference, reading and command."
        if task.history
        else "A few earlier samples would not either, and none are in the observation."
    )
    lines = [
        f"{task.title}.",
        "",
        "## Description",
        task.about,
        "",
        "## Plant",
        *(_plants(task)),
        "",
        f"A draw varies each number of the hysteresis by up to {100 * task.half_width:g} % and each "
        f"parameter of an effect by up to {100 * task.effects_half_width:g} %. "
        f"The sensor adds {1e3 * task.noise_um:.3g} nm rms"
        + (
            f" and rounds to {1e3 * first.sensor.resolution_um:.3g} nm."
            if first.sensor.resolution_um
            else "."
        )
        + (f" The command's converter has {task.command_bits} bits." if task.command_bits else ""),
        "",
        "## Belief",
        _belief(task),
        "",
        "## References",
        ", ".join(_reference(task, choice) for choice in task.references)
        + f"; amplitude {task.layout().scale_um:.4g} µm, a smooth start of {task.smooth_start_s:g} s.",
        "",
        "## Observation and history",
        f"As of `PiezoTracking-v0`, with {task.preview} samples of preview. Not Markov: it does not show "
        f"{task.hidden}. {history}",
        "",
        "## Protocol",
        f"Sampling time {1e3 * task.ts_s:g} ms; an episode has {task.samples} samples, the "
        f"score is over those from {task.first} on. `gymnasium.make` draws from training plants; "
        "validation and test plants come from random words of their own.",
        "",
        "```python",
        "import gymnasium as gym",
        "import rdpi_gym",
        "",
        f'env = gym.make("{task.id}")',
        "```",
    ]
    return "\n".join(lines)


def _plants(task: StageTask) -> list[str]:
    names = ", ".join(f"`{model.name}`" for model in task.nominals)
    if not any(model.effects for model in task.nominals):
        return [f"{names}; no effects."]
    rows = [f"{names}; nominal effects:", "", "| effect | parameters |", "|---|---|"]
    return rows + [f"| {name} | {said} |" for name, said in _effects(task.nominals[0]).items()]


def _effects(model: PlantModel) -> Mapping[str, str]:
    return {
        effect.full_name(): ", ".join(
            f"{p.name} = {effect.values[p.name]:g}{'' if p.unit == '1' else f' {p.unit}'}"
            for p in effect.parameters
        )
        for effect in model.effects
    }


def _belief(task: StageTask) -> str:
    if not task.beliefs:
        return "The nominal plant, with its nominal effects."
    names = ", ".join(f"`{name}`" for name in dict.fromkeys(model.name for model in task.beliefs))
    return f"{names}: a model of another structure, with the nominal effects."


def _reference(task: StageTask, choice: ReferenceChoice) -> str:
    if isinstance(choice, Signal):
        return choice.name
    given: dict[str, Any] = {"signal": choice} if isinstance(choice, str) else dict(choice)
    name, hz = given.pop("signal"), given.pop("frequency_hz", None)
    lines = given.pop("lines", None)
    rest = ", ".join(f"{key} {value:g}" for key, value in given.items())
    detail = f" ({rest})" if rest else ""
    if hz is not None:
        span = f"{hz:g} to {lines * hz:g}" if lines else f"{hz:g}"
        return f"{name} {span} Hz{detail}"
    if "hold_s" in given:
        return f"{name}{detail}"
    low, high = task.frequency_hz
    return f"{name} {low:g} to {high:g} Hz{detail}"
