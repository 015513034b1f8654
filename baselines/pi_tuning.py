"""PI gains from the belief, by the SIMC rule for a plant that is a gain, a delay and a bad zero."""

from __future__ import annotations

from typing import NamedTuple

from baselines.stability import nyquist_gain
from rdpi_gym.plant import RDPI, check_ts

# What the proportional part may leave of |L| < 1 at half the sampling frequency.
_NYQUIST_GAIN = 0.4


class Gains(NamedTuple):
    """Gains of u = kp e + ki ∫ e dt: proportional (V/µm) and integral (V/(µm s)).

    Examples
    --------
    >>> Gains(0.1, 500.0).integral_V_um_s
    500.0
    """

    proportional_V_um: float
    integral_V_um_s: float


def simc_gains(model: RDPI, ts_s: float) -> Gains:
    """Tune a PI controller to the plant between its slopes a_0 and A.

    Parameters
    ----------
    model
        The belief's RDPI parameters.
    ts_s
        Sampling time (s).

    Returns
    -------
    Gains

    Raises
    ------
    InputError
        Ts is not above zero.

    Examples
    --------
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> gains = simc_gains(PAPER_IV_B.static(), 1e-4)
    >>> round(gains.proportional_V_um * PAPER_IV_B.A, 3), round(gains.integral_V_um_s * 1e-4 * PAPER_IV_B.A, 3)
    (0.15, 0.5)

    Notes
    -----
    While all plays slide, the plant is A (1 - s / z0) behind one sample of delay: no lag, and by
    SIMC's half rule an effective delay θ = Ts + 1 / z0, to which a right-half-plane zero adds its
    time constant. With the tight closed-loop time constant θ that SIMC recommends, the integral gain
    is 1 / (2 A θ) (Skogestad, J. Process Control 13, 2003), and the integral time θ / 3 of the
    improved rule for delay-dominant plants (Grimholt, Skogestad, IFAC PID'12, 2012) gives the
    proportional gain. That rule knows nothing of a zero whose gain grows with frequency, so the
    proportional part is cut back to what |L(z = -1)| of 0.4 leaves, for the sliding and the sticking
    plant (slope a_0) both; the integral part alone reaches 0.5 at most. Phase margin 60° or more.
    """
    check_ts(ts_s)
    delay_s = ts_s + 1.0 / model.zero_rad_s
    integral = 1.0 / (2.0 * model.A * delay_s)
    largest = max(model.a0, abs(nyquist_gain(model, ts_s)))
    room = _NYQUIST_GAIN / largest - 0.5 * integral * ts_s
    return Gains(max(0.0, min(integral * delay_s / 3.0, room)), integral)
