"""Half-wave symmetry of steady periods: plays are odd, so what is even is asymmetry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, cannot_tell, zone_of
from rdpi_gym.diagnosis.features.periods import Periods, harmonics, orders_off_mains
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.words import digits

NAME = "asymmetry"
THRESHOLD_PERCENT = 0.15
"""Even part over the rest (rms): a quadratic distortion of 1 % of the stroke leaves 0.5 %."""
_LARGE = 0.5  # of the largest swing: records that count
_MOST_ORDERS = 400
_EXPERIMENT = (
    "Take five periods or more of a slow sine or triangle about the middle of the range, at full "
    "and at half amplitude."
)


def half_wave(stretches: Sequence[Periods]) -> Check:
    """Even harmonics of the displacement under commands that have none.

    A play operator is odd and congruent: a command whose second half period is the negative of
    its first gives a displacement of the same symmetry, whatever thresholds and weights are.
    """
    found = []
    for periods in stretches:
        share = _even_share(periods, periods.record.u_V)
        if share is not None and share[0] + share[1] < THRESHOLD_PERCENT:
            even = _even_share(periods, periods.record.y_um)
            if even is not None:
                swing = float(np.ptp(periods.record.u_V[periods.part]))
                found.append((swing, *even, periods))
    if not found:
        return cannot_tell(
            NAME,
            "No record holds three steady periods of a half-wave symmetric command, so even "
            "harmonics of the {output} cannot be laid to the actuator.",
            _EXPERIMENT,
        )
    widest = max(swing for swing, *_ in found)
    large = [entry for entry in found if entry[0] > _LARGE * widest]
    # a record whose second harmonic is free of the mains goes before one where it is not
    _, value, error, periods = max(large, key=lambda e: (_second_is_clear(e[3]), e[0], -e[2]))
    zone = zone_of(value, error, THRESHOLD_PERCENT)
    facts = (
        f"Under the half-wave symmetric command of {periods.record.name} the {{output}} has even "
        f"harmonics of {digits(value)} % of the odd ones (rms)"
    )
    if zone == "yes":
        text = f"{facts}: play operators leave none, so the actuator is not symmetric."
    elif zone == "no":
        text = f"{facts}: no asymmetry."
    else:
        text = f"{facts}, not safely more than its noise."
    step = "" if zone != "cannot tell" else _EXPERIMENT
    return Check(NAME, value, THRESHOLD_PERCENT, "%", zone, text, step, ("asymmetry",))


def _second_is_clear(periods: Periods) -> bool:
    return orders_off_mains(periods, np.array([2])).size > 0


def _even_share(periods: Periods, x: Array) -> tuple[float, float] | None:
    """Even over odd harmonics (%) and its error; None without steady motion."""
    found = harmonics(periods, x)
    last = min(found.mean.size - 1, _MOST_ORDERS)
    odd, _ = found.rms(np.arange(1, last + 1, 2))
    orders = np.arange(2, last + 1, 2)
    clear = orders_off_mains(periods, orders)
    even, error = found.rms(clear if clear.size and clear[0] == 2 else orders)
    return (100.0 * even / odd, 100.0 * error / odd) if odd > 0.0 else None
