"""What a student sees of the controller that it corrects, and where its correction enters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.adaptive_dual_loop import CorrectedAdaptive
from baselines.adaptive_feedforward import PLAYS, SLOW_S, SPLINE, spline_weights
from baselines.learned.imitation.student import UNIT_UM, Student
from baselines.products import lane_products, product
from baselines.tuning import Settings
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array

PREVIEW = 8
"""Samples of the reference ahead that a student sees."""
COURSE = spline_weights(PREVIEW)
"""Value and derivatives of the reference over what is seen of it."""
WEIGHTED = len(COURSE) + len(PLAYS)
"""Inputs that a student weights: the course of the reference, and the plays."""
SINCE_S = (0.01, 0.1)
"""Time constants (s) of what says how long an episode runs."""

Witness = Callable[[Array, Array, Array], None]
"""Told at every sample what was seen ``(inputs, B)``, the error and the correction (µm), ``(B,)``."""


class TaughtAdaptive(CorrectedAdaptive):
    """The adaptive feedforward with a student beside it, whose correction the estimate knows of.

    A student sees, in this order: value and derivatives of the reference over the preview; how far
    each play is from the reference, and each slow low-pass; the estimate, as distance from its prior
    in expected deviations; what the estimate leaves unexplained of the newest sample that it can
    compare; the base's own correction; and for how long the episode runs.

    Parameters
    ----------
    belief, layout, settings
        As :class:`baselines.tuning.Tunable`.
    student
        What is added.
    witness
        Told of every sample, by a training.
    """

    def __init__(
        self,
        belief: PlantModel,
        layout: ObservationLayout,
        settings: Settings,
        student: Student,
        witness: Witness | None = None,
    ) -> None:
        super().__init__(belief, layout, settings)
        self.student, self._witness = student, witness
        self._inside = self.rows.total
        since = np.array(SINCE_S)[:, None]
        self.fades = np.exp(-layout.ts_s / since)

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest, the student's below that of the estimate."""
        own = np.zeros((self.student.rows, len(reference_um)))
        return np.concatenate([super().start(reference_um), own])

    def corrected_command(
        self, observation: NDArray[np.floating[Any]], correction_um: Array, state: Array
    ) -> Array:
        """Return u(k+1) (V), ``(B,)``; see :class:`baselines.linear_feedback.CorrectedInverse`."""
        inside = state[: self._inside]
        measured = self.layout.measured_um(observation)
        ahead = self.layout.reference_um(observation[:, : PREVIEW + 1])
        wanted = self.wanted_um(observation, measured, ahead[:, 0], inside)
        seen, error = self._seen(observation, ahead, wanted, inside), ahead[:, 0] - measured
        added = self.student.answer_um(seen, error, state[self._inside :])
        if self._witness is not None:
            self._witness(seen, error, added)
        return self.driven(observation, wanted + correction_um + added, inside)

    def _seen(
        self,
        observation: NDArray[np.floating[Any]],
        ahead_um: Array,
        wanted_um: Array,
        state: Array,
    ) -> Array:
        of, layout = self.rows.of, self.layout
        course = product(COURSE, ((ahead_um - layout.centre_um) / layout.scale_um).T)
        window = layout.reference_um(observation[:, : layout.preview + 1])
        smooth = product(SPLINE[0], window[:, self.window].T)
        plays = (of(state, "plays") - smooth) / self.thresholds_um[:, None]
        slow = (of(state, "slow") - smooth) / layout.scale_um
        theta = self.fit.theta(of(state, "fit"))
        phi, z = self.compared(state)
        left = (z - lane_products(theta, phi)) / UNIT_UM
        known = (theta - self.fit.prior[:, None]) / self.fit.spread[:, None]
        own = (wanted_um - smooth) / layout.scale_um
        since = self.fades ** of(state, "count")
        return np.vstack([course, plays, slow, known, left, own, since])


def seen_by(base: CorrectedAdaptive) -> int:
    """Return how many numbers a student sees beside errors and its own corrections.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> seen_by(CorrectedAdaptive(P10, ObservationLayout.for_plant(P10, 1e-4, preview=8)))
    42
    """
    return WEIGHTED + len(SLOW_S) + base.fit.size + 2 + len(SINCE_S)
