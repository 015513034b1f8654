"""``pi-preview``, ``smith-predictor``, ``lqg-preview``, ``h-infinity``: linear feedback around the inverted hysteresis."""

from __future__ import annotations

import math
import warnings
from abc import abstractmethod
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import ClassVar, Protocol

import numpy as np
from scipy.linalg import solve_discrete_are

from baselines.base import Observation, Rows, product
from baselines.extended import ExtendedInverse
from baselines.inverses.linear import PreviewFilter
from baselines.loops import (
    FACTORS,
    BeliefPath,
    Certificate,
    LinearSystem,
    belief_path,
    certify,
    gain,
    grid,
    harmful_mode_hz,
    integral_shape,
    integrator,
    largest_factor,
    loop_warning,
    sampled,
    unit_delay,
    weighted,
)
from baselines.monitors import BAND_HZ, RingingMonitor
from baselines.tuning import Knob, Settings, Tunable
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.delay import Delay
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

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
        """As :meth:`baselines.classical.ExtendedInverse.corrected_command`."""

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


class PIPreview(LinearFeedback):
    """C = N(s) (k_i / s + k_p) / (τ s + 1) on the inverse of r(t + lead).

    The lead is the belief's delay of slow signals, lags and mode included, times a share; the
    feedforward knows of the effects by it alone. N = (s² + 2 ζ ω0 s + ω0²) / (s² + 2 w ω0 s + ω0²)
    cuts the believed mode out, wider than it is; a belief without a mode gives a controller without
    a notch. k_i is a share of the largest that leaves |1 / (1 + L)| at most 2 on the belief, as
    :func:`baselines.pi.gains_within_margin` finds it.

    Source: PI, notch and inversion as compared by Fleming, Leang, ACC 2013.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import P10
    >>> from rdpi_gym.plant.effects import load_effect
    >>> stage = replace(P10, effects=(load_effect("resonance")(f0_hz=700.0, damping=0.02),))
    >>> controller = PIPreview(stage, ObservationLayout.for_plant(stage, 1e-4, preview=8), {})
    >>> controller.certified.stable
    True
    """

    name = "pi-preview"
    knobs = (
        Knob("lead_share", 0.0, 2.0, 1.0),
        Knob("rate_share", 0.0, 1.5, 1.0),
        Knob("gain_share", 0.01, 3.0, 0.7, logarithmic=True),
        Knob("proportional_s", 1e-6, 2e-3, 5e-5, "s", logarithmic=True),
        Knob("second_integral_hz", 0.0, 60.0, 0.0, "Hz"),
        Knob("lowpass_hz", 50.0, 5000.0, 2000.0, "Hz", logarithmic=True),
        Knob("notch_width", 0.02, 3.0, 0.5, logarithmic=True),
    )

    def inverted_belief(self) -> PlantModel:
        """Return the belief with its effects as one delay, and its rate's share."""
        core = self.belief.hysteresis
        lead_s = self.settings["lead_share"] * belief_path(self.belief, self.layout.ts_s).delay_s
        rated = replace(core, delta2_s=self.settings["rate_share"] * core.delta2_s)
        effects = (Delay(min(max(lead_s, 0.0), 0.02)),) if lead_s else ()
        return replace(self.belief, hysteresis=rated, effects=effects)

    def design(self) -> LinearSystem:
        """Return the filtered PI."""
        ts_s, mode = self.layout.ts_s, self.path.mode
        shape = integral_shape(self.settings, ts_s)
        if mode is not None and mode.omega0_rad_s * ts_s < 0.9 * math.pi:
            w0, wide = mode.omega0_rad_s, max(self.settings["notch_width"], mode.damping)
            notch = sampled(
                [1.0, 2.0 * mode.damping * w0, w0**2], [1.0, 2.0 * wide * w0, w0**2], ts_s, w0
            )
            shape = notch * shape
        loops = [(unit_delay() * shape * each).response(self.z) for each in self.path.extremes]
        unit = 1.0 / ts_s  # largest_factor looks below 10: gains in units of a sample
        largest = largest_factor([unit * loop for loop in loops]) * unit
        return shape.times(self.settings["gain_share"] * largest)


class SmithPredictor(LinearFeedback):
    """C = C_0 / (1 + C_0 G_0 (1 - D)), with C_0 = k_i / s + k_p and the belief's path G_0 D.

    G_0 has lags, modes and the sample that computing takes, D the delay. Were the belief true,
    C_0 would see a path without delay. k_i is a share of the largest that leaves |1 / (1 + L)| within
    a bound with all plays sticking and with all sliding, which the model knows nothing of.

    Source: O. J. M. Smith, Chem. Eng. Prog. 53, 1957.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import P10
    >>> from rdpi_gym.plant.effects import load_effect
    >>> late = replace(P10, effects=(load_effect("delay")(delay_s=5e-4),))
    >>> controller = SmithPredictor(late, ObservationLayout.for_plant(late, 1e-4, preview=8), {})
    >>> controller.certified.stable
    True
    """

    name = "smith-predictor"
    knobs = (
        Knob("gain_share", 0.01, 3.0, 0.5, logarithmic=True),
        Knob("proportional_s", 1e-6, 2e-3, 5e-5, "s", logarithmic=True),
        Knob("sensitivity", 1.2, 3.0, 2.0),
    )

    def design(self) -> LinearSystem:
        """Return the PI with its inner model."""
        ts_s = self.layout.ts_s
        prompt = tuple(e for e in self.belief.effects if e.name != "delay")
        model = belief_path(replace(self.belief, effects=prompt), ts_s).dynamics
        missing = unit_delay() * (model + self.path.dynamics.times(-1.0))
        pi = integrator(ts_s) + gain(self.settings["proportional_s"])
        pi = pi.times(self.settings["gain_share"] * self._largest(pi, missing))
        return pi.around(missing)

    def _largest(self, pi: LinearSystem, missing: LinearSystem) -> float:
        """Largest gain up to which |1 / (1 + L)| stays within the bound on both extremes."""
        inner = (pi * missing).response(self.z)
        late = unit_delay() * pi
        outer = [(late * each).response(self.z) for each in self.path.extremes]
        allowed = 0.0
        for factor in (FACTORS / self.layout.ts_s).tolist():
            left = 1.0 + factor * inner
            peaks = (np.abs(left / (left + factor * each)).max() for each in outer)
            if max(peaks) > self.settings["sensitivity"]:
                break
            allowed = factor
        return allowed


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


# Of the largest |1 / (1 + L)| at high frequencies, and what is left of errors at rest.
_PEAK, _AT_REST = 2.0, 1e-3


class HInfinity(LinearFeedback):
    """C that minimises the peak of (W1 S, W2 C S, W3 T), S = 1 / (1 + L), T = 1 - S.

    W1 = (s / 2 + ω_b) / (s + 1e-3 ω_b) asks for errors that fall below ω_b, W2 is the price of the
    correction, and W3 = s / ω_r that of high frequencies, where the belief's mode is another than the
    stage's. The path in samples, one of delay included, is carried to the w plane, z = (1 + w Ts/2) /
    (1 - w Ts/2), and the controller back: Tustin's rule keeps the norm, so nothing is approximated.

    Source: Glover, Doyle, Systems & Control Letters 11, 1988; weights after Skogestad, Postlethwaite,
    Multivariable Feedback Control, 2005; on nanopositioners Salapaka et al., Rev. Sci. Instrum. 73, 2002.

    Raises
    ------
    InputError
        As :class:`baselines.tuning.Tunable`; python-control or slycot is not installed, or there is no
        controller for these weights.
    """

    name = "h-infinity"
    knobs = (
        Knob("bandwidth_hz", 2.0, 1000.0, 60.0, "Hz", logarithmic=True),
        Knob("effort", 1e-4, 10.0, 0.05, logarithmic=True),
        Knob("roll_off_hz", 20.0, 5000.0, 400.0, "Hz", logarithmic=True),
    )

    def design(self) -> LinearSystem:
        """Return the synthesised controller."""
        path, ts_s = unit_delay() * self.path.dynamics, self.layout.ts_s
        numbers = (path.a.tobytes(), path.b.tobytes(), path.c.tobytes(), path.d)
        weights = tuple(2.0 * math.pi * self.settings[f"{name}_hz"] for name in _RATES)
        return _synthesised(numbers, ts_s, weights, self.settings["effort"])


_RATES = ("bandwidth", "roll_off")


@lru_cache(maxsize=64)
def _synthesised(
    numbers: tuple[bytes, bytes, bytes, float],
    ts_s: float,
    weights: tuple[float, ...],
    effort: float,
) -> LinearSystem:
    try:
        import control  # 3 s; nothing else here needs it
        import slycot  # noqa: F401 - where it lacks, control says so as if the weights were at fault
    except ImportError as error:
        raise InputError(
            f"h-infinity needs python-control and slycot, which is GPL ({error}); install rdpi-gym[robust]"
        ) from error
    b, c = np.frombuffer(numbers[1]), np.frombuffer(numbers[2])
    path = LinearSystem(np.frombuffer(numbers[0]).reshape(len(b), len(b)), b, c, numbers[3])
    wanted, rolled = weights
    w1 = control.tf([1.0 / _PEAK, wanted], [1.0, _AT_REST * wanted])
    w2 = control.tf([effort], [1.0])
    # proper: beyond half the sampling frequency nothing is left to weigh
    w3 = control.tf([1.0 / rolled, 1e-3], [0.1 * ts_s, 1.0])
    try:
        with warnings.catch_warnings():  # mixsyn calls what the library itself calls outdated
            warnings.simplefilter("ignore", FutureWarning)
            found = control.mixsyn(control.ss(*_continuous(path, ts_s)), w1, w2, w3)[0]
    except (ValueError, ArithmeticError, control.exception.ControlException) as error:
        reason = " ".join(str(error).split())[:100]
        raise InputError(f"h-infinity finds no controller for these weights ({reason})") from error
    return _discrete(found.A, found.B[:, 0], found.C[0], float(found.D[0, 0]), ts_s)


def _continuous(path: LinearSystem, ts_s: float) -> tuple[Array, Array, Array, Array]:
    """Carry a system in samples to the w plane, as A, B, C, D."""
    left = np.linalg.inv(path.a + np.eye(path.order))
    a = 2.0 / ts_s * (path.a - np.eye(path.order)) @ left
    b, c = 2.0 / ts_s * left @ path.b, 2.0 * path.c @ left
    d = path.d - path.c @ left @ path.b
    return a, b[:, None], c[None], np.array([[d]])


def _discrete(a: Array, b: Array, c: Array, d: float, ts_s: float) -> LinearSystem:
    left = np.linalg.inv(np.eye(len(a)) - 0.5 * ts_s * a)
    moved = ts_s * left @ b
    return LinearSystem(
        left @ (np.eye(len(a)) + 0.5 * ts_s * a), moved, c @ left, d + 0.5 * float(c @ moved)
    )
