"""The page of a task, made of what the task states: the docstring of its environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rdpi_gym.envs.references import ReferenceChoice
from rdpi_gym.envs.tasks.task import StageTask
from rdpi_gym.plant import PlantModel
from rdpi_gym.signals import Signal


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
