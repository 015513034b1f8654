"""Displacement while the command rests: creep follows the last step, drift does not."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rdpi_gym.diagnosis.checks.check import Check, Zone, cannot_tell, zone_of
from rdpi_gym.diagnosis.checks.rest_fit import RestFit, fit_rests, later
from rdpi_gym.diagnosis.features.rests import Rest
from rdpi_gym.support.words import digits, pm

CREEP_PERCENT = 0.2
"""Creep (% of a step a decade): an actuator has 1 to 2."""
DRIFT_PERCENT_MIN = 0.02
"""Drift (% of the stroke a minute)."""
GAIN_DRIFT_PERCENT_MIN = 0.06
"""Change of the gain (% a minute)."""
MOST_CREEP_PERCENT = 10.0
"""No stack creeps more (% of a step a decade): what does is a lag."""
DRIFT_S = 1.0
"""A rest is so long before a drift by the minute may be read from it (s)."""
_GOES_ON = 0.5  # of the creep: so much of it is there in the later part of the rests
_LEAK = 0.25  # of the other's contribution: what may be mistaken for a drift
_CREEP_LEAK = 0.08  # a minute, of the creep of a decade
_STAIRS = (
    "Take a stair of steps up and down with holds from 0.05 to 50 s: creep goes on in the "
    "direction of the last step, drift does not."
)
_LONG = "Record a minute or more at constant command, after a long rest."
_AGAIN = "Repeat the first record at the end."
_NAMES = ("creep", "drift in holds", "gain drift in holds")


def holds(rests: Sequence[Rest], stroke_um: float) -> tuple[Check, Check, Check]:
    """Creep, drift and gain drift from how displacement goes on at constant command.

    In a rest a play operator gives a constant. Displacement in all rests is regressed on what
    every step before should add to it by lg(t) (creep), on the clock (drift), and on displacement
    times the clock (gain drift).
    """
    found = fit_rests(rests)
    if found is None or stroke_um == 0.0:
        text = "The command never rests, so creep and drift cannot be watched at constant command."
        creep, drift, gain = (cannot_tell(name, text, _STAIRS) for name in _NAMES)
        return creep, drift, gain
    return _creep(found, fit_rests(later(rests))), _drift(found, stroke_um), _gain_drift(found)


def _creep(found: RestFit, late: RestFit | None) -> Check:
    value, error = (100.0 * number for number in found.creep_per_decade)
    zone = zone_of(value, error, CREEP_PERCENT)
    if zone == "yes" and value < 0:
        zone = "cannot tell"
    where = _where(found)
    if zone == "yes" and (value > MOST_CREEP_PERCENT or not _goes_on(found, late)):
        text = (
            f"{where}, of up to {digits(found.longest_s)} s, the {{output}} goes on by "
            f"{digits(value)} % of each step a decade of time, but not as creep does: a lag that is "
            "not over when the command stops."
        )
        return _check(0, value, CREEP_PERCENT, "%/decade", "cannot tell", text, _STAIRS, "creep")
    text = {
        "yes": f"{where} the {{output}} goes on by {digits(value)} % of each step a decade of "
        "time, in the step's direction: creep.",
        "no": f"{where} nothing follows the last step (under {CREEP_PERCENT:g} % of it a decade): "
        "no creep.",
        "cannot tell": f"{where} creep would be {pm(value, error)} % of a step a decade: too "
        "uncertain, or against the step.",
    }[zone]
    return _check(0, value, CREEP_PERCENT, "%/decade", zone, text, _STAIRS, "creep")


def _goes_on(found: RestFit, late: RestFit | None) -> bool:
    """Whether creep goes on in the later part of the rests, as far as they tell."""
    if late is None:
        return True
    value, error = late.creep_per_decade
    return not value + 3.0 * error < _GOES_ON * found.creep_per_decade[0]


def _drift(found: RestFit, stroke_um: float) -> Check:
    scale = 6000.0 / stroke_um
    value, error = (scale * number for number in found.drift_um_s)
    leak = _LEAK * scale * abs(found.gain_drift_per_s[0]) * found.level_um
    zone = _beyond(zone_of(value, error, DRIFT_PERCENT_MIN), value, leak, found)
    alone = not math.isfinite(found.gain_drift_per_s[1])
    facts = (
        f"{_where(found)} the {{output}} moves by {pm(value, error)} % of the stroke a minute"
        f"{'' if alone else ' whatever the command did'}"
    )
    text = {
        "yes": f"{facts}: drift.",
        "no": f"{_where(found)} nothing moves whatever the command did (under "
        f"{DRIFT_PERCENT_MIN:g} % of the stroke a minute): no drift.",
        "cannot tell": f"{facts}: too uncertain, or too little beside the rest, to call it drift.",
    }[zone]
    effects = ("thermal_drift", "gain_drift") if alone else ("thermal_drift",)
    return _check(1, value, DRIFT_PERCENT_MIN, "%/min", zone, text, _LONG, *effects)


def _gain_drift(found: RestFit) -> Check:
    value, error = (6000.0 * number for number in found.gain_drift_per_s)
    level_um = max(found.level_um, 1e-300)
    leak = _LEAK * 6000.0 * abs(found.drift_um_s[0]) / level_um
    zone = _beyond(zone_of(value, error, GAIN_DRIFT_PERCENT_MIN), value, leak, found)
    facts = f"{_where(found)} the {{output}} grows by {pm(value, error)} % of itself a minute"
    text = {
        "yes": f"{facts}: the gain drifts.",
        "no": f"{_where(found)} the {{output}} keeps its size (within "
        f"{GAIN_DRIFT_PERCENT_MIN:g} % a minute): the gain does not drift.",
        "cannot tell": f"{facts}: too uncertain, or too little beside the rest, to call it a drift "
        "of the gain.",
    }[zone]
    return _check(2, value, GAIN_DRIFT_PERCENT_MIN, "%/min", zone, text, _AGAIN, "gain_drift")


def _beyond(zone: Zone, value: float, leak: float, found: RestFit) -> Zone:
    """Take back a yes that another course, or creep that is not quite lg(t), may feign.

    A rest of a fraction of a second says nothing of what happens in a minute.
    """
    if zone == "yes" and found.longest_s < DRIFT_S:
        return "cannot tell"
    creep = _CREEP_LEAK * 100.0 * abs(found.creep_per_decade[0])
    return "cannot tell" if zone == "yes" and abs(value) < leak + creep else zone


def _check(
    which: int, value: float, threshold: float, unit: str, zone: Zone, text: str, step: str,
    *effects: str,
) -> Check:  # fmt: skip
    known = value if math.isfinite(value) else None
    needed = step if zone == "cannot tell" else ""
    return Check(_NAMES[which], known, threshold, unit, zone, text, needed, effects)


def _where(found: RestFit) -> str:
    return f"Over {found.rests} rest{'s' if found.rests > 1 else ''} of the command"
