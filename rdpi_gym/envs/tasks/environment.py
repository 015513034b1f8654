"""Environments of the tasks: plants, observations with history, and pages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from rdpi_gym.envs.draw_laws import DrawLaw
from rdpi_gym.envs.piezo_tracking import PiezoTrackingEnv
from rdpi_gym.envs.tasks.task import ChangingPlant, StageTask
from rdpi_gym.envs.tracking import NoiseSource, TrackingTask
from rdpi_gym.envs.truth import ReferenceChoice
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.envs.wrappers.history import History
from rdpi_gym.plant import PlantModel
from rdpi_gym.signals import Signal

# Samples by which the past slides before it is moved.
_ROOM = 256


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
        self._is_own = not {"plant", "ts_s"} & set(options)
        super().__init__(**{**self.task.options, **options})
        self.history = History(self.layout, self.task.history if history is None else history)
        self.layout = replace(self.layout, history=self.history.steps)
        assert isinstance(self.observation_space, Box)
        stacked: Any = self.history.space(self.observation_space)
        self.observation_space = stacked

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode; see :class:`~rdpi_gym.envs.PiezoTrackingEnv`."""
        observation, info = super().reset(seed=seed, options=options)
        fields, steps = len(self.layout.fields), self.history.steps
        # What was shown before, the newest first; it slides down, a sample a step.
        self._past = np.empty((steps + _ROOM) * fields if steps else 0, np.float32)
        self._begin = _ROOM * fields
        self._last = observation
        self._past[self._begin :] = np.tile(observation[self.layout.now], steps)
        return self._stacked(observation), info

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Set the next command; see :class:`~rdpi_gym.envs.PiezoTrackingEnv`."""
        observation, reward, terminated, truncated, info = super().step(action)
        if self.history.steps:
            past, now = self._past, self.layout.now
            if self._begin == 0:
                self._begin = len(past) - (self.history.steps - 1) * len(now)
                past[self._begin :] = past[: len(past) - self._begin]
            self._begin -= len(now)
            past[self._begin : self._begin + len(now)] = self._last[now]
            self._last = observation
        return self._stacked(observation), reward, terminated, truncated, info

    def _stacked(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return an observation with what was shown before."""
        if not self.history.steps:
            return observation
        size, end = len(observation), self._begin + self.history.size - len(observation)
        shown = np.empty(self.history.size, np.float32)
        shown[:size], shown[size:] = observation, self._past[self._begin : end]
        return shown

    @property
    def later(self) -> Mapping[int, PlantModel]:
        """Later plants of this episode, by the sample from which each holds."""
        return self.truths.later

    def _draw_law(self) -> DrawLaw:
        law = self.task.law
        return law if self._is_own else replace(law, nominals=(), ageing=None, schedule=None)

    def _track(self, truth: PlantModel) -> TrackingTask:
        later, step_V = self.truths.later, self.truths.law.command_step_V
        if not (later or step_V):
            return super()._track(truth)
        plant = ChangingPlant([truth], self.layout.ts_s, [later], step_V)
        return TrackingTask(plant, self.layout, self.bound_um)

    def _noise(self, rng: np.random.Generator) -> NoiseSource:
        return self.task.noise_of(rng)


def environments_of(
    task: StageTask, module: str
) -> tuple[type[TaskEnv], Callable[..., PiezoTrackingVectorEnv]]:
    """Return the environment of a task, whose docstring is its page, and its vector environment."""
    fields = {"__doc__": page_of(task), "__module__": module, "task": task}
    single = type(f"Piezo{task.name}Env", (TaskEnv,), fields)
    return single, partial(PiezoTrackingVectorEnv, single=single)


def page_of(task: StageTask) -> str:
    """Return a page in Gymnasium's style: plant, belief, references, protocol."""
    first = task.nominals[0]
    history = (
        f"It holds {task.history} earlier samples of each field."
        if task.history
        else "It holds no earlier samples."
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
        "## Limits",
        f"Of a sample: no clipping; {100 * task.rate_share:g} % of the command's range; "
        f"{100 * task.ringing_share:g} % of the amplitude for the error's second difference, "
        f"{100 * task.stroke_share:g} % for the displacement.",
        "",
        "## Protocol",
        f"Sampling time {1e3 * task.ts_s:g} ms; an episode has {task.samples} samples, the "
        f"score is over those from {task.first} on. `gymnasium.make` draws training plants.",
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
