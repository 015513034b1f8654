"""Trained policies as controllers, by name."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from baselines.base import Baseline
from baselines.learned import policy as networks
from baselines.learned.imitation import policy as students
from baselines.learned.imitation.policy import StudentController, StudentPolicy
from baselines.learned.policy import DESCRIPTION, Policy, check_preview, policy_folder
from baselines.registry import known_controller
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, settled_folder


class LearnedController(Baseline):
    """A trained policy as a controller: the actions of its training, from the same observations.

    Observations and actions are relative to the layout's amplitude and command range, so a policy
    runs on a plant of another size too; :meth:`warning` says so. Its memory has the history's rows
    r, measured and command of k-1, ... k-H, then those of its baseline.

    Parameters
    ----------
    policy
        What was trained.
    belief, layout
        As :class:`baselines.base.Baseline`; the belief is its baseline's.

    Raises
    ------
    InputError
        The policy was trained at another sampling time, or its baseline is no controller of this
        package.

    Examples
    --------
    >>> from baselines.learned.policy import Network
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> layout = ObservationLayout.for_plant(plant, ts_s=1e-4)
    >>> actor = Network((layout.size, 1), "Tanh", "Tanh").build()
    >>> policy = Policy(layout, history=0, frequency_hz=100.0, error=0.02, actor=actor)
    >>> action, state = LearnedController(policy, plant, layout).predict(np.zeros((3, 7)))
    >>> action.shape
    (3, 1)
    """

    def __init__(self, policy: Policy, belief: PlantModel, layout: ObservationLayout) -> None:
        super().__init__(belief, layout)
        self.policy = policy
        own = policy.layout
        policy.check_runs(layout)
        self._scaling = policy.scaling
        self._history = self._scaling.history
        self._rows = len(own.fields) * policy.history
        self._columns = layout.columns_of(own)
        span_V = layout.command_range_V[1] - layout.command_range_V[0]
        own_span_V = own.command_range_V[1] - own.command_range_V[0]
        self._scale_V = own.action_scale_V * span_V / own_span_V
        self.baseline = (
            None if policy.baseline is None else _baseline(policy.baseline, belief, layout)
        )

    @property
    def needed_preview(self) -> int:
        """Samples of the reference that the policy was shown."""
        return self.policy.layout.preview

    def warning(self) -> str | None:
        """Return one line where the policy was trained on another amplitude or command range."""
        own, layout = self.policy.layout, self.layout
        trained = (own.centre_um, own.scale_um, own.command_range_V)
        if trained == (layout.centre_um, layout.scale_um, layout.command_range_V):
            return None
        return (
            f"trained for {own.scale_um:g} µm about {own.centre_um:g} µm and commands from "
            f"{own.command_range_V[0]:g} to {own.command_range_V[1]:g} V"
        )

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest; the history is filled when the first observation is there."""
        past = np.full((self._rows, len(reference_um)), np.nan)
        if self.baseline is None:
            return past
        return np.concatenate([past, self.baseline.start(reference_um)])

    def next_command(
        self, observation: NDArray[np.floating[Any]], reference_um: Array, state: Array
    ) -> Array:
        """Return the network's answer; see :meth:`baselines.base.Baseline.next_command`."""
        check_preview(self.layout, self.needed_preview)
        shown = np.ascontiguousarray(observation[:, self._columns], dtype=np.float32)
        past = state[: self._rows].T.astype(np.float32)
        begins = np.isnan(past).any(axis=1)
        if begins.any():
            past[begins] = self._history.begin(shown[begins])
        with torch.no_grad():
            scaled = torch.from_numpy(self._scaling(self._history.stack(shown, past)))
            action = self.policy.actor(scaled).numpy()[:, 0].astype(np.float64)
        state[: self._rows] = self._history.past(shown, past).T
        if self.policy.layout.action == "command":
            command = self.layout.place_to_V(action)
        elif self.baseline is None:
            command = self.layout.command_V(observation) + self._scale_V * action
        else:
            base = self.baseline.next_command(observation, reference_um, state[self._rows :])
            command = base + self._scale_V * action
        return np.clip(command, self.limits.low_V, self.limits.high_V)


def _baseline(name: str, belief: PlantModel, layout: ObservationLayout) -> Baseline:
    """Make the controller that a policy corrects; it must not plan beyond what is observed."""
    made = known_controller(name)(belief, replace(layout, action="command"))
    if hasattr(made, "plan"):
        raise InputError(
            f"the policy corrects {name!r}, which plans over the whole reference; a policy corrects a controller that runs on observations alone"
        )
    return made


def find_learned(name: str) -> Policy | StudentPolicy:
    """Return the policy in a folder, or a shipped one by its name: a network, or a student."""
    folder = policy_folder(name)
    formats = (networks.FORMAT, students.FORMAT)
    newest = max(networks.VERSION, students.VERSION)
    document = read_json(settled_folder(folder) / DESCRIPTION, formats, newest)
    kind = StudentPolicy if document["format"] == students.FORMAT else Policy
    return kind.load(folder)


def controller_of(
    policy: Policy | StudentPolicy, belief: PlantModel, layout: ObservationLayout
) -> Baseline:
    """Make the controller of a policy."""
    if isinstance(policy, StudentPolicy):
        return StudentController(policy, belief, layout)
    return LearnedController(policy, belief, layout)
