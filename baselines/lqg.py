"""``lqg-preview``: a Kalman filter with a disturbance, and the state feedback that is optimal for it."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_are

from baselines.linear_feedback import LinearFeedback
from baselines.loops.systems import LinearSystem, unit_delay
from baselines.tuning import Knob
from rdpi_gym.support.arrays import Array


class LQGPreview(LinearFeedback):
    """c = -K x̂ - d̂: linear-quadratic feedback of estimated states, and a disturbance that is undone.

    The estimator runs the belief's path x(k+1) = A x + b (c + d), y = c x, with the command's own
    sample of delay, and a disturbance at its input that wanders and drifts, d(k+1) = d(k) + v(k) + w,
    v(k+1) = v(k) + w'. What it has of the reference is the deviation e, so the preview is the feedforward's. K minimises
    Σ e² + ρ c², the filter's gain follows from the ratio of the disturbance's and the mode's noise to
    the sensor's. Both Riccati equations are SciPy's.

    Source: Anderson, Moore, Optimal Control: Linear Quadratic Methods, 1990; disturbance observer
    after Johnson, IEEE Trans. Automatic Control 16, 1971.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import P10
    >>> from rdpi_gym.plant.effects import load_effect
    >>> stage = replace(P10, effects=(load_effect("resonance")(f0_hz=739.0, damping=0.03),))
    >>> controller = LQGPreview(stage, ObservationLayout.for_plant(stage, 1e-4, preview=8), {})
    >>> controller.certified.stable
    True
    """

    name = "lqg-preview"
    knobs = (
        Knob("effort", 1e-3, 1e3, 1.0, logarithmic=True),
        Knob("wander", 1e-4, 1.0, 3e-2, logarithmic=True),
        Knob("drift", 1e-6, 1e-2, 1e-5, logarithmic=True),
        Knob("shaking", 1e-4, 10.0, 0.1, logarithmic=True),
    )

    def design(self) -> LinearSystem:
        """Return estimator and feedback as one system from e to c."""
        path = unit_delay() * self.path.dynamics
        n = path.order
        # estimated: states, disturbance and its change; y is the path's output deviation, -e
        a = np.zeros((n + 2, n + 2))
        a[:n, :n], a[:n, n] = path.a, path.b
        a[n:, n:] = [[1.0, 1.0], [0.0, 1.0]]
        c = np.append(path.c, [0.0, 0.0])
        drive = np.append(path.b, [0.0, 0.0])
        noise = self.settings["shaking"] ** 2 * np.outer(drive, drive)
        noise[n, n] += self.settings["wander"] ** 2
        noise[n + 1, n + 1] += self.settings["drift"] ** 2
        covariance = riccati(a.T, c[:, None], noise + 1e-12 * np.eye(n + 2), 1.0)
        filter_gain = covariance @ c / (c @ covariance @ c + 1.0)
        weight = np.outer(path.c, path.c)
        cost = riccati(path.a, path.b[:, None], weight, self.settings["effort"])
        feedback = (path.b @ cost @ path.a) / (path.b @ cost @ path.b + self.settings["effort"])
        k = np.append(feedback, [1.0, 0.0])
        # x̂ = x̄ + M (y - c x̄) with y = -e; the feedback is -k x̂, and x̄ moves on with it
        seen = np.eye(n + 2) - np.outer(filter_gain, c)
        moved = a - np.outer(drive, k)
        return LinearSystem(moved @ seen, -moved @ filter_gain, -k @ seen, float(k @ filter_gain))


def riccati(a: Array, b: Array, q: Array, r: float) -> Array:
    """Solve the discrete algebraic Riccati equation of one input."""
    return np.asarray(solve_discrete_are(a, b, q, np.array([[r]])), dtype=np.float64)
