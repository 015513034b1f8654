"""Gain over amplitude: at one rate a larger loop of plays never has a smaller gain."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rdpi_gym.diagnosis.checks.bias import Loop
from rdpi_gym.diagnosis.checks.check import Check, Zone, cannot_tell, zone_of
from rdpi_gym.support.words import digits, pm

NAME = "gain over amplitude"
THRESHOLD_PERCENT = 0.5
"""Fall of the gain from a smaller to a larger loop (%)."""
_LARGER = 1.2
_RATE_SLACK = 1.05
_SLOW = 0.1  # of the fastest loop: lags, resonances and slew limits are far
_FREQUENCY = 3.0  # times: so much may the loops' frequencies differ
_MOST = 80
_EXPERIMENT = (
    "Take sines at four amplitudes up to the full range, the frequency lower in proportion as the "
    "amplitude is larger."
)


def gain_over_amplitude(loops: Sequence[Loop]) -> Check:
    """Fall of the gain from a smaller loop to a larger one that is no faster.

    Weights of plays are not negative and thresholds grow with the rate, so a larger loop at the
    same or a smaller rate has a gain that is the same or larger. Saturation alone breaks this.
    """
    fastest = max((loop.rate_V_s for loop in loops), default=0.0)
    slowest = min((loop.rate_V_s for loop in loops), default=0.0)
    limit = max(_SLOW * fastest, 1.1 * slowest)
    slow = [loop for loop in loops if loop.rate_V_s <= limit]
    order = sorted(slow, key=lambda loop: loop.span_V)
    # of many loops, some of each size
    every = max(1, len(order) // _MOST)
    chosen = order[::every]
    changes = [
        (100.0 * (large.gain_um_V / small.gain_um_V - 1.0), _error(small, large), small, large)
        for i, small in enumerate(chosen)
        for large in chosen[i + 1 :]
        if large.span_V > _LARGER * small.span_V
        and large.rate_V_s <= _RATE_SLACK * small.rate_V_s
        and small.gain_um_V > 0.0
        and small.rate_V_s / small.span_V < _FREQUENCY * large.rate_V_s / large.span_V
    ]
    if not changes:
        return cannot_tell(
            NAME,
            "There are no closed loops of two sizes at one rate, so it cannot be seen whether the "
            "gain falls with amplitude.",
            _EXPERIMENT,
        )
    # the deepest fall that is sure; without one, the widest comparison
    falls = [c for c in changes if c[0] < 0.0 and zone_of(c[0], c[1], THRESHOLD_PERCENT) == "yes"]
    change, error, small, large = (
        min(falls, key=lambda c: c[0])
        if falls
        else max(changes, key=lambda c: c[3].span_V / c[2].span_V)
    )
    where = f"From loops of {digits(small.span_V, 3)} {{input_unit}} ({small.record}) to {digits(large.span_V, 3)} {{input_unit}} ({large.record})"
    if falls:
        text = f"{where} the gain falls by {digits(-change)} %: with plays it only grows, so the actuator saturates."
        return Check(NAME, change, THRESHOLD_PERCENT, "%", "yes", text, "", ("saturation",))
    if change > THRESHOLD_PERCENT:
        text = f"{where} the gain grows by {digits(change)} %, as plays have it; a weak saturation could hide under it."
        return Check(NAME, change, THRESHOLD_PERCENT, "%", "cannot tell", text, _EXPERIMENT)
    zone: Zone = "no" if zone_of(change, error, THRESHOLD_PERCENT) == "no" else "cannot tell"
    text = f"{where} the gain stays ({pm(change, error)} %): {'no saturation' if zone == 'no' else 'too uncertain'}."
    return Check(
        NAME, change, THRESHOLD_PERCENT, "%", zone, text, "" if zone == "no" else _EXPERIMENT
    )


def _error(small: Loop, large: Loop) -> float:
    of_small, of_large = (loop.error_um_V / loop.gain_um_V for loop in (small, large))
    return 100.0 * math.hypot(of_small, of_large)
