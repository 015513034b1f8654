"""A controller on a plant, sample by sample: what it commands and how far it is off."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rdpi_gym.envs import TrackingTask


class Played(NamedTuple):
    """Commands (V) and errors (µm) behind row 0, float64[K-1, B], the last memory, and the actions."""

    commands_V: np.ndarray
    errors_um: np.ndarray
    state: Any
    actions: np.ndarray


def play(controller: Any, truths: Any, r: Any, rngs: Any = None, layout: Any = None) -> Played:
    """Let a controller track a reference (µm), ``(K, B)``, on one plant or on one for each lane."""
    layout = layout or controller.layout
    plants = truths if isinstance(truths, list) else [truths] * r.shape[1]
    task = TrackingTask(plants, layout)
    observation, state = task.reset(r, rngs), None
    if hasattr(controller, "plan"):
        controller.plan(r)
    starts = np.ones(r.shape[1], dtype=bool)
    commands, errors, actions = [], [], []
    for _ in range(len(r) - 1):
        action, state = controller.predict(observation, state, starts, deterministic=True)
        starts = np.zeros_like(starts)
        command = np.float64(action[:, 0])
        if layout.action == "command":
            command = layout.place_to_V(command)
        else:
            command = task.command_V + layout.action_scale_V * command
        observation = task.step(command)
        commands.append(task.command_V.copy())
        errors.append(task.error_um.copy())
        actions.append(action)
    return Played(np.array(commands), np.array(errors), state, np.array(actions))


def rms(errors_um: Any) -> float:
    """Root mean square of errors (µm)."""
    return float(np.sqrt(np.mean(np.square(errors_um))))
