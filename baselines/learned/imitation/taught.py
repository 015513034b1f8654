"""What a student sees of the controller that it corrects, and where its correction enters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

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

KNOWN = WEIGHTED + len(SLOW_S)
"""First of the inputs that say what the estimate is; what it leaves and the base's own follow."""


class Moment(NamedTuple):
    """One decision of a student, and what the estimate beside it was.

    Parameters
    ----------
    seen
        ``(inputs, B)``.
    error_um, correction_um
        Measured error, and what the student answered (µm), ``(B,)``.
    wanted_um
        w, all that the belief's inverse is given (µm), ``(B,)``.
    theta, answered
        The estimate, and the φ of the reference that it multiplies, ``(F, B)``.
    phi, left_um
        φ of what was measured, which it learned from last, ``(F, B)``, and z - θ·φ (µm), ``(B,)``.
    """

    seen: Array
    error_um: Array
    correction_um: Array
    wanted_um: Array
    theta: Array
    answered: Array
    phi: Array
    left_um: Array


Witness = Callable[[Moment], None]
"""Told of every decision."""


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
        ahead = self.layout.reference_um(observation, slice(PREVIEW + 1))
        own = self.wanted_um(observation, measured, ahead[:, 0], inside)
        theta = self.fit.theta(self.rows.of(inside, "fit"))
        phi, z = self.compared(inside)
        left = z - lane_products(theta, phi)
        window = self.layout.reference_um(observation)
        smooth, *derivatives = product(SPLINE, window[:, self.window].T)
        seen, error = self._seen(ahead, smooth, own, left, inside), ahead[:, 0] - measured
        added = self.student.answer_um(seen, error, state[self._inside :])
        wanted = own + correction_um + added
        if self._witness is not None:
            static = self.rows.of(inside, "seen").reshape(*self._rings, -1)[-1]
            answered = np.vstack([*derivatives, static])
            told = seen, error, added, wanted, theta.copy(), answered, phi, left
            self._witness(Moment(*told))
        return self.driven(observation, wanted, inside)

    def _seen(
        self, ahead_um: Array, smooth_um: Array, own_um: Array, left_um: Array, state: Array
    ) -> Array:
        of, layout = self.rows.of, self.layout
        course = product(COURSE, ((ahead_um - layout.centre_um) / layout.scale_um).T)
        plays = (of(state, "plays") - smooth_um) / self.thresholds_um[:, None]
        slow = (of(state, "slow") - smooth_um) / layout.scale_um
        theta = self.fit.theta(of(state, "fit"))
        known = (theta - self.fit.prior[:, None]) / self.fit.spread[:, None]
        own = (own_um - smooth_um) / layout.scale_um
        since = self.fades ** of(state, "count")
        return np.vstack([course, plays, slow, known, left_um / UNIT_UM, own, since])


def seen_by(base: CorrectedAdaptive) -> int:
    """Return how many numbers a student sees beside errors and its own corrections."""
    return WEIGHTED + len(SLOW_S) + base.fit.size + 2 + len(SINCE_S)
