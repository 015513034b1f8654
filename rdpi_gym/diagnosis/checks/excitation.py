"""Coverage of the commands: amplitudes, frequencies, holds, reversals, repetitions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check
from rdpi_gym.diagnosis.features.cycles import HalfCycles, Periods
from rdpi_gym.diagnosis.features.recurrence import same_command
from rdpi_gym.diagnosis.features.rests import Rest
from rdpi_gym.diagnosis.notices import statement
from rdpi_gym.measurement import Record

AMPLITUDE_RATIO = 3.0
"""Largest over smallest amplitude that the data should have."""
FREQUENCY_RATIO = 5.0
"""Highest over lowest frequency that the data should have."""
HOLD_S = 10.0
"""Longest hold that the data should have (s)."""
REVERSALS = 8
"""Reversals of the command that the data should have."""
_TAIL = 2.0  # per cent of the half-cycles: a range rests on more


def excitation(
    records: Sequence[tuple[Record, HalfCycles]],
    rests: Sequence[Rest],
    stretches: Sequence[Periods],
) -> tuple[Check, ...]:
    """Say what the commands leave untested; ``yes`` means that something is missing."""
    amplitude = np.concatenate([np.empty(0), *(c.amplitude_V[c.whole] for _, c in records)])
    frequency = np.concatenate([np.empty(0), *(c.frequency_hz[c.whole] for _, c in records)])
    reversals = sum(c.edges.size - 2 for _, c in records)
    return (
        _reversals(reversals),
        _range("few amplitudes", amplitude, AMPLITUDE_RATIO),
        _range("few frequencies", frequency, FREQUENCY_RATIO),
        _holds(rests),
        _repetitions([r for r, _ in records], stretches),
    )


def _reversals(count: int) -> Check:
    few = count < REVERSALS
    found = statement(f"few reversals/{_yes(few)}", count=count, least=REVERSALS)
    advice = statement("fading triangle") if few else None
    return Check("few reversals", float(count), float(REVERSALS), "", _yes(few), found, advice)


def _yes(condition: bool) -> Literal["yes", "no"]:
    return "yes" if condition else "no"


def _range(
    name: Literal["few amplitudes", "few frequencies"], values: np.ndarray, wanted: float
) -> Check:
    advice = statement("fading triangle" if name == "few amplitudes" else "four frequencies")
    if not values.size:
        return Check(name, None, wanted, "", "yes", statement(f"{name}/none"), advice)
    low, high = np.percentile(values, [_TAIL, 100.0 - _TAIL])
    ratio = float(high / low)
    few = ratio < wanted
    found = statement(f"{name}/{_yes(few)}", low=low, high=high)
    return Check(name, ratio, wanted, "", _yes(few), found, advice if few else None)


def _holds(rests: Sequence[Rest]) -> Check:
    steps = [rest for rest in rests if rest.move_V != 0.0]
    longest = max((rest.duration_s for rest in steps), default=0.0)
    short = longest < HOLD_S
    found = statement(f"no long holds/{_yes(short)}", longest=longest)
    advice = statement("add holds") if short else None
    return Check("no long holds", longest, HOLD_S, "s", _yes(short), found, advice)


def _repetitions(records: Sequence[Record], stretches: Sequence[Periods]) -> Check:
    again = same_command(records)
    noted = [r.name for r in records if r.period is not None and np.unique(r.period).size > 1]
    count = float(len(again) + len(stretches) + len(noted))
    advice = None
    if again:
        found = statement("no repetition/record", first=again[0][0].name, second=again[0][1].name)
    elif stretches or noted:
        name = stretches[0].record.name if stretches else noted[0]
        found = statement("no repetition/period", record=name)
    else:
        found, advice = statement("no repetition/yes"), statement("repeat at the end")
    zone = _yes(advice is not None)
    return Check("no repetition", count, 1.0, "", zone, found, advice)
