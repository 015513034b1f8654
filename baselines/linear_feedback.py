"""Linear feedback around the inverted hysteresis: what PI, damping, LQG and H-infinity share."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from baselines.extended import ExtendedInverse
from baselines.inverses.preview_filter import PreviewFilter
from baselines.loops.certificates import Certificate, certify, harmful_mode_hz, loop_warning
from baselines.loops.path import BeliefPath, belief_path, grid
from baselines.loops.systems import LinearSystem, unit_delay, weighted
from baselines.tuning import Settings, Tunable
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array


class LinearFeedback(Tunable):
    """u(k+1) = H⁻¹[G⁻¹ r(k+1) + C(z) e(k)], e = r - measured.

    G⁻¹ and H⁻¹ are the inverses of the belief's effects and of its hysteresis, those of
    ``extended-inverse``. The feedback stands between the two: with the hysteresis inverted, what it
    drives is nearly linear, and it answers what the inverses leave. A subclass designs C from the
    linear part of the belief. Where the command is at its limit and the error drives further into
    it, C's memory stands still.

    Parameters
    ----------
    belief, layout, settings
        As :class:`baselines.tuning.Tunable`.

    Attributes
    ----------
    path : BeliefPath
        The linear part of the belief.
    feedback : LinearSystem
        C, from e(k) (µm) to the correction of sample k + 1 (µm).
    """

    inverts_effects = True
    needs_core: ClassVar[type[Core] | None] = RDPI

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        super().__init__(belief, layout, settings)
        self.inverse = ExtendedInverse(self.inverted_belief(), layout)
        self.path = belief_path(belief, layout.ts_s)
        for stage in self.inverse.inverses.command:
            if isinstance(stage, PreviewFilter):  # the correction passes it too
                passed = weighted(stage.weights[::-1].tolist()) * self.path.dynamics
                self.path = BeliefPath(passed, self.path.sliding, self.path.mode, self.path.delay_s)
        self.angles, self.z = grid(self.path, layout.ts_s)
        self.feedback = self.design()

    def inverted_belief(self) -> PlantModel:
        """Return the plant that the feedforward inverts; the belief, unless a subclass knows better."""
        return self.belief

    @abstractmethod
    def design(self) -> LinearSystem:
        """Return C from the path, the grid and the settings."""

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest: that of C, then the inverse's."""
        own = np.zeros((self.feedback.order, len(reference_um)))
        return np.concatenate([own, self.inverse.start(reference_um)])

    def next_command(
        self, observation: NDArray[np.floating[Any]], reference_um: Array, state: Array
    ) -> Array:
        """Answer e(k) and r(k+1); see :meth:`baselines.base.Baseline.next_command`."""
        system = self.feedback
        own, rest = state[: system.order], state[system.order :]
        error = reference_um[0] - self.layout.measured_um(observation)
        last = rest[0].copy()
        u = self.inverse.corrected_command(observation, system.c @ own + system.d * error, rest)
        low, high, step = self.limits
        above = (u >= high) | (u - last >= step)
        below = (u <= low) | (last - u >= step)
        stands = (above & (error > 0.0)) | (below & (error < 0.0))
        own[:] = np.where(stands, own, system.a @ own + system.b[:, None] * error)
        return u

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
        """What is certain of the loop on its belief; see :mod:`baselines.loops.certificates`."""
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
