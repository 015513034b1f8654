"""Linear feedback around the inverted hysteresis: what PI, damping, LQG and H-infinity share."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import replace
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np

from baselines.base import Observation, Rows, product
from baselines.extended import ExtendedInverse
from baselines.inverses.linear import PreviewFilter
from baselines.loops import (
    BeliefPath,
    Certificate,
    LinearSystem,
    belief_path,
    certify,
    grid,
    harmful_mode_hz,
    loop_warning,
    unit_delay,
    weighted,
)
from baselines.monitors import BAND_HZ, RingingMonitor
from baselines.tuning import Settings, Tunable
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array

FALL_S, RECOVERY_S = 5e-3, 1.0
"""Time constants (s) with which the feedback is withdrawn while it rings, and given back."""


class CorrectedInverse(Protocol):
    """A feedforward that takes a correction of what the plays are to give; row 0: the last command."""

    @property
    def needed_preview(self) -> int:
        """As :attr:`baselines.base.Baseline.needed_preview`."""

    def start(self, reference_um: Array) -> Array:
        """As :meth:`baselines.base.Baseline.start`."""

    def corrected_command(
        self, observation: Observation, correction_um: Array, state: Array
    ) -> Array:
        """As :meth:`baselines.extended.ExtendedInverse.corrected_command`."""

    def warning(self) -> str | None:
        """As :meth:`baselines.base.Baseline.warning`."""


class LinearFeedback(Tunable):
    """u(k+1) = H⁻¹[G⁻¹ r(k+1) + C(z) e(k)], e = r - measured.

    G⁻¹ and H⁻¹ are the inverses of the belief's effects and of its hysteresis, those of
    ``extended-inverse``. The feedback stands between the two: with the hysteresis inverted, what it
    drives is nearly linear, and it answers what the inverses leave. A subclass designs C from the
    linear part of the belief. Where the command is at its limit and the error drives further into
    it, C's memory stands still.

    A guard watches whether the error rings, :class:`baselines.monitors.RingingMonitor`: while it does
    C is given less and less of the error, what it holds stays, and what it is given comes back over a
    second only. A loop that is stable with its gain is so with less, so a mode that a load has moved
    costs bandwidth and not the stage.

    Attributes
    ----------
    path : BeliefPath
        The linear part of the belief.
    feedback : LinearSystem
        C, from e(k) (µm) to the correction of sample k + 1 (µm).
    falls, returns : float
        What is left of the share that C is given, a sample on, where it rings; what comes back of the
        rest where it does not.
    """

    inverts_effects = True
    needs_core: ClassVar[type[Core] | None] = RDPI

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        super().__init__(belief, layout, settings)
        self.inverse, self.path = self.inverse_and_path()
        self.angles, self.z = grid(self.path, layout.ts_s)
        self.feedback = self.design()
        self.monitor = RingingMonitor(BAND_HZ, layout.scale_um, layout.ts_s)
        self.falls = math.exp(-layout.ts_s / FALL_S)
        self.returns = 1.0 - math.exp(-layout.ts_s / RECOVERY_S)
        self.rows = Rows(
            feedback=self.feedback.order,
            monitor=self.monitor.rows,
            allowed=1,
            inverse=len(self.inverse.start(np.zeros(1))),
        )

    def inverse_and_path(self) -> tuple[CorrectedInverse, BeliefPath]:
        """Return what makes commands of the reference and a correction, and the path of the latter."""
        inverse = ExtendedInverse(self.inverted_belief(), self.layout)
        path = belief_path(self.belief, self.layout.ts_s)
        for stage in inverse.inverses.command:
            if isinstance(stage, PreviewFilter):  # the correction passes it too
                passed = weighted(stage.weights[::-1].tolist()) * path.dynamics
                path = replace(path, dynamics=passed)
        return inverse, path

    def inverted_belief(self) -> PlantModel:
        """Return the plant that the feedforward inverts; the belief, unless a subclass knows better."""
        return self.belief

    @abstractmethod
    def design(self) -> LinearSystem:
        """Return C from the path, the grid and the settings."""

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest; see :meth:`baselines.base.Baseline.start`."""
        state = np.zeros((self.rows.total, len(reference_um)))
        self.rows.of(state, "monitor")[:] = self.monitor.start(reference_um)
        self.rows.of(state, "allowed")[:] = 1.0
        self.rows.of(state, "inverse")[:] = self.inverse.start(reference_um)
        return state

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """Answer e(k) and r(k+1); see :meth:`baselines.base.Baseline.next_command`."""
        system = self.feedback
        own, rest = self.rows.of(state, "feedback"), self.rows.of(state, "inverse")
        error = reference_um[0] - self.layout.measured_um(observation)
        error *= self._allowed(error, reference_um[0], state)
        last = rest[0].copy()
        correction = product(system.c, own) + system.d * error
        u = self.inverse.corrected_command(observation, correction, rest)
        low, high, step = self.limits
        above = (u >= high) | (u - last >= step)
        below = (u <= low) | (last - u >= step)
        stands = (above & (error > 0.0)) | (below & (error < 0.0))
        own[:] = np.where(stands, own, product(system.a, own) + system.b[:, None] * error)
        return u

    def _allowed(self, error_um: Array, reference_um: Array, state: Array) -> Array:
        """Share of the error that the feedback is given, 1 until something rings."""
        allowed: Array = self.rows.of(state, "allowed")[0]
        _, ringing = self.monitor.watch(self.rows.of(state, "monitor"), error_um, reference_um)
        allowed[:] = np.where(
            ringing, self.falls * allowed, allowed + self.returns * (1.0 - allowed)
        )
        return allowed

    @property
    def needed_preview(self) -> int:
        """That of the inverses."""
        return self.inverse.needed_preview

    @cached_property
    def open_loops(self) -> tuple[LinearSystem, ...]:
        """Open loops with all plays sticking and with all sliding, one sample late."""
        return tuple(unit_delay() * self.feedback * each for each in self.path.extremes)

    @cached_property
    def certified(self) -> Certificate:
        """Certificate of the loop on its belief; see :mod:`baselines.loops`."""
        core = self.belief.hysteresis
        return certify(self.open_loops, self.z, (core.a0 / core.A, core.A / core.a0))

    def certificate(self) -> str | None:
        """Return what is certain of the loop on its belief in one line; None where nothing is."""
        return self.certified.line()

    def warning(self) -> str | None:
        """Return one line where the loop is unstable, uncertified or blind to a mode; else None."""
        return (
            loop_warning(
                self.certified,
                None if self.path.mode else self.harmful_mode_hz,
                self.belief,
                self.layout.ts_s,
            )
            or self.inverse.warning()
        )

    @property
    def harmful_mode_hz(self) -> float:
        """Frequency (Hz) below which a mode that the belief lacks makes the loop unstable."""
        loops = (loop.response(self.z) for loop in self.open_loops)
        return max(harmful_mode_hz(loop, self.angles, self.layout.ts_s) for loop in loops)
