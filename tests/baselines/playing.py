"""A controller on a plant, sample by sample: commands and errors; and policies that nobody has trained."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rdpi_gym.envs import ObservationLayout, TrackingTask
from rdpi_gym.plant import P10


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


def make_policy(
    action: Any = "correction",
    hidden: Any = (8,),
    history: int = 3,
    output: str = "Hardtanh",
    baseline: Any = "classical-static",
    scale_V: float = 8.0,
    seed: int = 0,
    **fields: Any,
) -> Any:
    """Return a policy with weights that were drawn, which looks ahead by two samples."""
    import torch

    from baselines.learned.policy import Network, Policy

    torch.manual_seed(seed)
    layout = ObservationLayout.for_plant(
        P10, ts_s=1e-4, preview=2, action=action, action_scale_V=scale_V
    )
    actor = Network((layout.size + 3 * history, *hidden, 1), "Tanh", output).build()
    corrected = baseline if action == "correction" else None
    return Policy(layout, history, 100.0, 0.02, actor, corrected, **fields)
