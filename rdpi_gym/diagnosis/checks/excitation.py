"""What the commands of a data set cover: amplitudes, frequencies, holds, reversals, repetitions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check
from rdpi_gym.diagnosis.features.cycles import HalfCycles, Periods
from rdpi_gym.diagnosis.features.recurrence import same_command
from rdpi_gym.diagnosis.features.rests import Rest
from rdpi_gym.measurement import Record
from rdpi_gym.support.words import digits

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
        _range(
            "few amplitudes", amplitude, AMPLITUDE_RATIO, "{input_unit}",
            "thresholds and weights are known at these amplitudes only, and a gain that changes "
            "with amplitude cannot be seen",
            "Add a slow triangle whose amplitude decays from the full range to nothing.",
        ),
        _range(
            "few frequencies", frequency, FREQUENCY_RATIO, "Hz",
            "delay, lags, the rate law and δ2 cannot be told apart",
            "Add sines at four frequencies over a decade or more, and pairs of the same largest "
            "rate (A at f, A/4 at 4 f).",
        ),
        _holds(rests),
        _repetitions([r for r, _ in records], stretches),
    )  # fmt: skip


def _reversals(count: int) -> Check:
    few = count < REVERSALS
    text = f"The command reverses {count} times" + (
        f"; with fewer than {REVERSALS} reversals the loops are hardly seen." if few else "."
    )
    step = (
        "Add a slow triangle whose amplitude decays from the full range to nothing." if few else ""
    )
    return Check(
        "few reversals", float(count), float(REVERSALS), "", "yes" if few else "no", text, step
    )


def _range(
    name: str, values: np.ndarray, wanted: float, unit: str, lost: str, experiment: str
) -> Check:
    if not values.size:
        text = f"No stretch of the command runs from one reversal to the next: {lost}."
        return Check(name, None, wanted, "", "yes", text, experiment)
    low, high = np.percentile(values, [_TAIL, 100.0 - _TAIL])
    ratio = float(high / low)
    facts = (
        f"Stretches from reversal to reversal cover {digits(low, 3)} to {digits(high, 3)} {unit}"
    )
    if ratio < wanted:
        return Check(name, ratio, wanted, "", "yes", f"{facts}: {lost}.", experiment)
    return Check(name, ratio, wanted, "", "no", f"{facts}.")


def _holds(rests: Sequence[Rest]) -> Check:
    steps = [rest for rest in rests if rest.move_V != 0.0]
    longest = max((rest.duration_s for rest in steps), default=0.0)
    if longest >= HOLD_S:
        text = f"After a move the command rests for up to {digits(longest, 3)} s."
        return Check("no long holds", longest, HOLD_S, "s", "no", text)
    text = (
        f"The longest rest after a move takes {digits(longest, 3)} s: creep and drift show over tens of "
        "seconds."
    )
    step = "Add steps up and down with holds from 0.05 to 50 s."
    return Check("no long holds", longest, HOLD_S, "s", "yes", text, step)


def _repetitions(records: Sequence[Record], stretches: Sequence[Periods]) -> Check:
    again = same_command(records)
    noted = [r.name for r in records if r.period is not None and np.unique(r.period).size > 1]
    count = float(len(again) + len(stretches) + len(noted))
    if again:
        first, second = again[0]
        text = f"{second.name} has the command of {first.name}: noise and drift can be told from the actuator."
    elif stretches or noted:
        name = stretches[0].record.name if stretches else noted[0]
        text = f"{name} repeats its period: noise can be told from the actuator."
    else:
        text = "No command is repeated: noise, drift and what the actuator does cannot be told apart without a model."
        step = "Repeat the first record at the end."
        return Check("no repetition", count, 1.0, "", "yes", text, step)
    return Check("no repetition", count, 1.0, "", "no", text)
