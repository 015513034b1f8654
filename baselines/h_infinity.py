"""``h-infinity``: the mixed-sensitivity design of the belief's path, by python-control."""

from __future__ import annotations

import math
import warnings
from functools import lru_cache

import numpy as np

from baselines.linear_feedback import LinearFeedback
from baselines.loops.systems import LinearSystem, unit_delay
from baselines.tuning import Knob
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

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
