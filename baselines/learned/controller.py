"""Trained policies as controllers, by name; and with a monitor beside them that hands over to a controller with a certificate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from baselines.base import Baseline, Observation, Rows
from baselines.learned import policy as networks
from baselines.learned.imitation import policy as students
from baselines.learned.imitation.policy import StudentController, StudentPolicy
from baselines.learned.policy import DESCRIPTION, Policy, check_preview, policy_folder
from baselines.monitors import BAND_HZ, MARGIN, QUANTITIES, RingingMonitor, Watch
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

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
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


FALLBACK = "pi-preview"
"""Name of the controller that is handed over to: its loop is passive on what the tasks believe."""
LIMIT_S, LIMIT_SHARE = 5e-3, 0.5
"""Time constant (s) over which commands at their limit are counted, and the share that is too much."""
BLEND_S = 1e-3
"""Time (s) in which the fallback takes over."""
# What a command may be off its limit and still count as at it, as share of the range.
_NEAR = 1e-6


class Guarded(Baseline):
    """A policy until its monitor takes it off; then, for the rest of the episode, its fallback.

    It is taken off where the error rings (:class:`baselines.monitors.RingingMonitor`), where half of
    its commands of the last 5 ms lie at the end of their range or change by the most that one sample
    allows, where the loop goes further than those of its training did
    (:class:`baselines.monitors.Watch`), or where its answer is no finite number. Until then the fallback runs along, shown the
    reference in place of the measurement, so that nothing winds up in it; it takes over within a
    millisecond.

    Parameters
    ----------
    policy
        What is watched; None: it cannot run here, and the fallback has all of the episode.
    fallback
        What takes over, of the same belief and layout.
    seen
        How far the loops of its training went; empty: not known, and not watched.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> layout = ObservationLayout.for_plant(P10, ts_s=1e-4, preview=8)
    >>> pi, none = (known_controller(name)(P10, layout) for name in ("pi-preview", "none"))
    >>> Guarded(none, pi).certificate().split(";")[0]
    'handed over to pi-preview where it rings, stays at its limits or goes beyond its training'
    """

    def __init__(
        self,
        policy: Baseline | None,
        fallback: Baseline,
        seen: Mapping[str, float] | None = None,
    ) -> None:
        super().__init__(fallback.belief, fallback.layout)
        self.policy, self.fallback = policy, fallback
        ts, one = self.layout.ts_s, np.zeros(1)
        self.monitor = RingingMonitor(BAND_HZ, self.layout.scale_um, ts)
        self._forgets = 1.0 - math.exp(-ts / LIMIT_S)
        self._slide = min(ts / BLEND_S, 1.0)
        self._measured = self.layout.columns["measured"].start
        self._reference = self.layout.columns["reference"].start
        self.watch = Watch(self.layout)
        most = [(seen or {}).get(name, math.inf) for name in QUANTITIES]
        self._furthest = MARGIN * np.array(most)[:, None]
        self.rows = Rows(
            policy=0 if policy is None else len(policy.start(one)),
            fallback=len(fallback.start(one)),
            monitor=self.monitor.rows,
            watch=self.watch.rows,
            at_limit=1,
            share=1,
        )

    @property
    def needed_preview(self) -> int:
        """The longer of both."""
        own = 0 if self.policy is None else self.policy.needed_preview
        return max(own, self.fallback.needed_preview)

    def warning(self) -> str | None:
        """Return one line where the policy or the fallback has one, else None."""
        if self.policy is None:
            return f"the policy does not run at Ts = {self.layout.ts_s:g} s: {self.fallback.name} alone"
        return self.policy.warning() or self.fallback.warning()

    def certificate(self) -> str:
        """Return one line on the handing over, and what is certain of the fallback."""
        said = self.fallback.certificate() or "no certificate"
        return f"handed over to {self.fallback.name} where it rings, stays at its limits or goes beyond its training; of that one: {said}"

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest; see :meth:`baselines.base.Baseline.start`."""
        state, of = np.zeros((self.rows.total, len(reference_um))), self.rows.of
        if self.policy is None:
            of(state, "share")[:] = 1.0
        else:
            of(state, "policy")[:] = self.policy.start(reference_um)
        of(state, "fallback")[:] = self.fallback.start(reference_um)
        of(state, "monitor")[:] = self.monitor.start(reference_um)
        of(state, "watch")[:] = self.watch.start(len(reference_um))
        return state

    def handed_over(self, state: Array) -> NDArray[np.bool_]:
        """Return where the fallback drives, or takes over, ``(B,)``."""
        taken: NDArray[np.bool_] = self.rows.of(state, "share")[0] > 0.0
        return taken

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """Return the policy's command, or the fallback's; see :meth:`baselines.base.Baseline.next_command`."""
        of = self.rows.of
        share = of(state, "share")[0]
        if self.policy is not None and (share < 1.0).any():
            own = self.policy.next_command(observation, reference_um, of(state, "policy"))
            alarm = self._alarm(own, observation, reference_um, state)
            share[:] = np.where(alarm | (share > 0.0), np.minimum(share + self._slide, 1.0), 0.0)
        else:
            own = np.zeros(len(share))
        shown = observation.copy()
        rests = share == 0.0
        shown[rests, self._measured] = observation[rests, self._reference]
        other = self.fallback.next_command(shown, reference_um, of(state, "fallback"))
        return np.where(share < 1.0, (1.0 - share) * np.nan_to_num(own) + share * other, other)

    def _alarm(
        self,
        command_V: Array,
        observation: Observation,
        reference_um: Array,
        state: Array,
    ) -> NDArray[np.bool_]:
        low, high, step = self.limits
        near = _NEAR * (high - low)
        change = np.abs(command_V - self.layout.command_V(observation))
        there = (command_V <= low + near) | (command_V >= high - near) | (change >= step - near)
        at_limit = self.rows.of(state, "at_limit")[0]
        at_limit += self._forgets * (there - at_limit)
        error = reference_um[0] - self.layout.measured_um(observation)
        _, ringing = self.monitor.watch(self.rows.of(state, "monitor"), error, reference_um[0])
        met = self.watch.take(self.rows.of(state, "watch"), observation)
        further = (met > self._furthest).any(axis=0)
        alarm: NDArray[np.bool_] = (
            ringing | (at_limit > LIMIT_SHARE) | further | ~np.isfinite(command_V)
        )
        return alarm


def guarded(
    policy: Policy | StudentPolicy, belief: PlantModel, layout: ObservationLayout
) -> Guarded:
    """Return a trained policy with its monitor and :data:`FALLBACK`, which is alone at another Ts."""
    own = controller_of(policy, belief, layout) if policy.runs_at(layout.ts_s) else None
    fallback = known_controller(FALLBACK)(belief, layout)
    return Guarded(own, fallback, policy.seen)
