"""Share of the residual that follows from the input, with its interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis.features.cycles import half_cycles
from rdpi_gym.diagnosis.features.recurrence import Recurrence, Trace, recurrence, unrepeated_um2
from rdpi_gym.diagnosis.notices import statement
from rdpi_gym.diagnosis.results import Left
from rdpi_gym.diagnosis.search.learner import HeldOut, Part, learn_across, memory_features
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.residuals import model_output
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale
from rdpi_gym.support.arrays import Array

# Samples that are learned from: an effect of the input is as plain on every fourth sample.
_MOST_ROWS = 24_000
_SURE = 0.025  # chance that a number lies outside its interval, on either side
_DRAWS = 2000
_FEWEST_BLOCKS = 8  # with fewer no interval can be told
# Excess over the noise's variance up to which there is nothing to explain.
_NOTHING = 0.33
FOLLOWS = 0.3
"""Share of the excess from which on it may not be said that it does not follow from the input."""
FOUND = 0.05
"""Share above which something was found that follows from the input."""
_UNSURE = 0.1  # a lower end so far below what was predicted is no answer yet
_QUIET_PIECES = 8
# The noise may be so many times its estimate before what exceeds it is called a disturbance.
_DOUBT = 1.1
# Degrees of what is taken to follow the clock: one for every four strokes of the command.
_STROKES, _MOST_DEGREES = 4, 3
# Lines of the mains, in records of so many cycles, and of a command with less of its power there.
_MAINS_HZ = (50.0, 60.0, 100.0, 120.0, 150.0, 180.0)
_MAINS_CYCLES, _MAINS_SHARE = 20.0, 1e-3


@dataclass(frozen=True)
class Remainder(Left):
    """Share of the residual that follows from the input, in words too.

    Its `low` is what a learner or the recurrence of the input's history proves on data that were held
    out. Its `high` is 1 unless something proves that there is a disturbance: a learner that fails
    proves nothing.
    """

    sentence: str  # in words


def remainder(
    variant: Variant[Core],
    train: Sequence[Record],
    validation: Sequence[Record],
    scale: DataScale,
    noise_um: float,
    numerical_um: float = 0.0,
    still: Sequence[tuple[Array, str]] = (),
) -> Remainder:
    """Split what the final model leaves into what follows from the input and what does not.

    Notes
    -----
    Three tests, the first without a learner:

    - *Recurrence*. Where the recent history of the input comes again, the product of the residuals
      of both times is the mean square of what follows from it.
    - *A learner with memory*, cross-fitted in blocks with gaps. What it predicts follows from the
      input; its interval is that of a bootstrap over the blocks. What it does not predict may
      follow all the same, by a law that it cannot learn or from records too short to teach it.
    - *A positive test for a disturbance*. Repetitions of one input that differ, and quiet records
      that move, by more than the noise. This alone lowers the upper end, and it takes a
      disturbance to be as strong in all records as in those.

    What follows the clock (a slow curve over each record, its degree below a quarter of the number
    of strokes) is taken off before anything is learned: whether drift or a slow answer to the
    input makes it, such a record cannot tell, so it counts for neither end. A disturbance locked
    to the input, as hum under a command whose frequency divides the mains', is taken for an effect
    of it.
    """
    floor_um2 = noise_um**2 + numerical_um**2
    records = _whole(train, validation)
    outputs_um = [model_output(variant, record) for record, _ in records]
    traces = [
        Trace(record, record.y_um - output_um - _mains(record, record.y_um - output_um), asked)
        for (record, asked), output_um in zip(records, outputs_um, strict=True)
    ]
    parts, whole = _parts(traces, outputs_um, scale)
    held_out = learn_across(parts)
    squares = np.array([float(whole[k][rows] @ whole[k][rows]) for k, rows in held_out.blocks])
    counts = np.array([float(rows.stop - rows.start) for _, rows in held_out.blocks])
    excess = float(squares.sum() / counts.sum()) - floor_um2
    draws = _draws(len(counts))
    excesses = draws @ squares / (draws @ counts) - floor_um2
    most = max(float(np.quantile(excesses, 1.0 - _SURE)), 0.0)
    found = recurrence(traces)
    repeats = None if found is None else _repeats(found, noise_um)
    if excess <= 0.0:
        hidden_um = math.sqrt(most)
        return Remainder(
            0.0, 0.0, 1.0, repeats, hidden_um, 0.0, template("left", rest=statement("rest/noise"))
        )
    learned, learned_low = _learned(held_out, draws, counts, excesses, excess, numerical_um**2)
    again, again_low = 0.0, 0.0
    if found is not None and not _have_other_inputs(records):
        again, again_low = _found_again(found, excess, most, numerical_um**2)
    disturbed, origin = _disturbed(traces, still, noise_um**2, (excess, most))
    low = min(max(learned_low, again_low, 0.0), 1.0)
    high = max(1.0 - disturbed, 0.0)
    low, high = min(low, high), max(low, high)
    share = min(max(learned, again, low), high)
    left_um, hidden_um = math.sqrt(excess), math.sqrt(high * most)
    numbers = Remainder(share, low, high, repeats, hidden_um, left_um, "")
    return replace(
        numbers, sentence=_sentence(numbers, learned, excess <= _NOTHING * floor_um2, origin)
    )


def _whole(
    train: Sequence[Record], validation: Sequence[Record]
) -> list[tuple[Record, NDArray[np.bool_]]]:
    """Records with the samples to validate on; parts of one record are one again."""
    found: list[tuple[Record, NDArray[np.bool_]]] = []
    roles = [(record, False) for record in train] + [(record, True) for record in validation]
    for record, asked in roles:
        mask = record.error_mask if asked else np.zeros_like(record.error_mask)
        at = next((k for k, (other, _) in enumerate(found) if _parts_of_one(other, record)), None)
        if at is None:
            found.append((record, mask))
        else:
            other, before = found[at]
            both = other.error_mask | record.error_mask
            found[at] = replace(other, error_mask=both), before | mask
    return found


def _have_other_inputs(records: Sequence[tuple[Record, NDArray[np.bool_]]]) -> bool:
    """Whether other inputs move, which may recur together with this one."""
    return any(np.ptp(other) > 0.0 for record, _ in records for other in record.others.values())


def _parts_of_one(a: Record, b: Record) -> bool:
    return np.array_equal(a.t_s, b.t_s) and np.array_equal(a.y_um, b.y_um, equal_nan=True)


def _mains(record: Record, left_um: Array) -> Array:
    """Lines of the mains in a residual (µm), where the input has none: they are not its doing."""
    t, counted = record.t_s - record.t_s[0], record.error_mask
    columns = [np.ones_like(t)]
    for frequency_hz in _MAINS_HZ:
        if frequency_hz * record.ts_s < 0.45 and frequency_hz * t[-1] > _MAINS_CYCLES:
            wave = np.exp(2j * np.pi * frequency_hz * t)
            u = record.u_V - record.u_V.mean()
            if 2.0 * np.abs(np.mean(wave * u)) ** 2 < _MAINS_SHARE * np.mean(u**2):
                columns += [wave.real, wave.imag]
    lines = np.column_stack(columns)
    found, *_ = np.linalg.lstsq(lines[counted], left_um[counted], rcond=None)
    return np.asarray(lines[:, 1:] @ found[1:])


def _parts(
    traces: Sequence[Trace], outputs_um: Sequence[Array], scale: DataScale
) -> tuple[list[Part], list[Array]]:
    """Features and residual of each record for learners, and the residual less its mean (µm)."""
    samples = sum(int(np.count_nonzero(t.record.error_mask)) for t in traces)
    step = max(1, -(-samples // _MOST_ROWS))
    parts, whole = [], []
    for trace, output_um in zip(traces, outputs_um, strict=True):
        record = trace.record
        rows = np.flatnonzero(record.error_mask)[::step]
        groups = memory_features(record, output_um, scale, rows)
        residual_um, asked = trace.residual_um[rows], trace.asked[rows]
        strokes = len(half_cycles(record.u_V, record.ts_s).rising)
        degree = min(max(1, strokes // _STROKES), _MOST_DEGREES)
        clock = np.linspace(-1.0, 1.0, len(rows))
        slow, _ = np.linalg.qr(np.polynomial.legendre.legvander(clock, degree))
        left_um = (record.y_um - output_um)[rows]
        whole.append(left_um - (left_um[asked] if asked.any() else left_um).mean())
        parts.append(
            Part(
                {n: x - slow @ (slow.T @ x) for n, x in groups.items()},
                residual_um - slow @ (slow.T @ residual_um),
                asked,
            )
        )
    return parts, whole


def _draws(blocks: int) -> Array:
    """Bootstrap counts of each block, ``(DRAWS, B)``."""
    rng = np.random.default_rng(0)
    return rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=_DRAWS).astype(np.float64)


def _learned(
    held_out: HeldOut, draws: Array, counts: Array, excesses: Array, excess: float, lost_um2: float
) -> tuple[float, float]:
    """Share of the residual that learners predict, and its lower end."""
    gains = held_out.before - held_out.after
    gained = (draws @ gains) / (draws @ counts) - lost_um2
    shares = gained / np.maximum(excesses, 0.1 * excess)
    value = (float(gains.sum() / counts.sum()) - lost_um2) / excess
    if len(counts) < _FEWEST_BLOCKS:
        return value, 0.0
    return value, _wider(value, float(np.quantile(shares, _SURE)), len(counts))


def _wider(value: float, end: float, blocks: int) -> float:
    """End of an interval, as far out as so few blocks ask for (Student's for the normal quantile)."""
    from scipy.stats import norm, t

    factor = t.ppf(1.0 - _SURE, blocks - 1) / norm.ppf(1.0 - _SURE)
    return value + (end - value) * float(factor) * math.sqrt(blocks / (blocks - 1.0))


def _found_again(
    found: Recurrence, excess: float, most: float, lost_um2: float
) -> tuple[float, float]:
    """Share of the residual that recurs, and its lower end."""
    repeated = float(found.repeated.sum() / found.counts.sum())
    draws = _draws(len(found.counts))
    low = float(np.quantile(draws @ found.repeated / (draws @ found.counts), _SURE))
    # a product speaks for both of its times: there are half as many
    low = repeated - math.sqrt(2.0) * (repeated - _wider(repeated, low, len(found.counts)))
    return found.share * (repeated - lost_um2) / excess, found.share * (low - lost_um2) / most


def _repeats(found: Recurrence, noise_um: float) -> float:
    beyond = float(found.squares.sum() / found.counts.sum()) - noise_um**2
    repeated = float(found.repeated.sum() / found.counts.sum())
    return 0.0 if beyond <= 0.0 else min(max(repeated / beyond, 0.0), 1.0)


def _disturbed(
    traces: Sequence[Trace],
    still: Sequence[tuple[Array, str]],
    noise_um2: float,
    excess_um2: tuple[float, float],
) -> tuple[float, str]:
    """Share of the excess that is surely there without the input, and where it was seen.

    The excess is given with the upper end of its interval (µm²).
    """
    tests = [(unrepeated_um2(traces), "repetitions")]
    pieces = [float(np.mean(p**2)) for y, _ in still for p in np.array_split(y, _QUIET_PIECES)]
    tests.append((np.array(pieces), "stage"))
    excess, most = excess_um2
    noise_um2 *= _DOUBT**2
    surely = [(0.0, "")]
    for found, where in tests:
        value, error = _mean(found)
        if value - error > noise_um2:
            # both errors are of the share's, and have nothing to do with each other
            both = math.hypot(error / (value - noise_um2), (most - excess) / most)
            surely.append((min((value - noise_um2) / excess, 1.0) * (1.0 - min(both, 1.0)), where))
    return max(surely)


def _mean(pieces: Array) -> tuple[float, float]:
    """Mean of some pieces, and how far below it the truth may lie."""
    from scipy.stats import t

    if len(pieces) < 2:
        return 0.0, 0.0
    error = float(np.std(pieces, ddof=1)) / math.sqrt(len(pieces))
    return float(np.mean(pieces)), float(t.ppf(1.0 - _SURE, len(pieces) - 1)) * error


def _sentence(found: Remainder, learned: float, little: bool, origin: str) -> str:
    if little:
        return template("left", rest=statement("rest/noise"))

    def percent(share: float) -> float:
        return 100.0 * min(max(share, 0.0), 1.0)

    values = {"left": found.left_um, "hidden": found.hidden_um, "low": percent(found.low)}
    kind = "uneven" if found.low < FOUND and learned > found.low + _UNSURE else "even"
    if found.repeats is not None:
        kind += " repeats"
        values["repeats"] = percent(found.repeats)
    seen = statement(f"seen/{kind}", learned=percent(learned), **values)
    disturbed = (
        statement(f"disturbed/{origin}", percent=percent(1.0 - found.high)) if origin else ""
    )
    shown = found.high < 1.0 - FOUND
    if found.low >= FOUND:
        kind = "lacks" if found.low >= FOLLOWS else "follows"
        kind += " disturbed" if shown else ""
    elif found.high <= FOLLOWS and (found.repeats or 0.0) < FOLLOWS:
        kind = "nothing"
    else:
        kind = "open disturbed" if shown else "open"
    return template(f"residual/{kind}", seen=seen, disturbed=disturbed, **values)
