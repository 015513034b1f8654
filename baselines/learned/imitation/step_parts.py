"""The kernels of a student's controller on the signals of an ONNX graph.

Each does what the function does that it names, with a lane's memory as a row in place of a column,
and returns the memory in place of changing it.
"""

from __future__ import annotations

import numpy as np

from baselines.adaptive_feedforward import POWERS, PRODUCTS, AdaptiveFeedforward
from baselines.classical import ClassicalReferenceRate
from baselines.classical_inverse_kernels import pack_inverse
from baselines.learned.imitation.student import CORRECTIONS, ERRORS, MOST_UM, UNIT_UM, Student
from baselines.learned.onnx_graph import Signal
from baselines.least_squares import SOLVE_EVERY, ForgettingLeastSquares
from baselines.ringing import GROWTH, RingingMonitor


def watched(
    monitor: RingingMonitor, memory: Signal, error: Signal, asked: Signal
) -> tuple[Signal, Signal]:
    """Return the memory and whether it rings: :meth:`~baselines.ringing.RingingMonitor.watch`."""
    passes, fast, slow, withdraw, returns, small, large = monitor.numbers
    before = [memory[:, i : i + 1] for i in range(monitor.rows)]

    def moved(row: int, share: float, towards: Signal | float) -> Signal:
        return before[row] + share * (towards - before[row])

    errors, references = [], []
    for stage in range(2):
        errors.append(moved(stage, passes, error))
        references.append(moved(2 + stage, passes, asked))
        error, asked = error - errors[-1], asked - references[-1]
    squared = error * error
    quick, lasting = moved(4, fast, squared), moved(5, slow, squared)
    usual = moved(6, fast, asked * asked)
    grows = (quick > GROWTH * lasting) | (quick > large)
    ringing = (quick > small) & (quick > usual) & grows
    trust = memory.graph.where(ringing, withdraw * before[7], moved(7, returns, 1.0))
    return memory.graph.joined(*errors, *references, quick, lasting, usual, trust), ringing


def features(
    made: AdaptiveFeedforward, smooth: Signal, plays: Signal, slow: Signal
) -> tuple[Signal, Signal, Signal]:
    """Return what of φ has no derivatives, the plays and the low-passes: ``_features``."""
    layout = made.layout
    place = (smooth - layout.centre_um) / layout.scale_um
    plays = plays.clipped(smooth - made.thresholds_um, smooth + made.thresholds_um)
    slow = slow + (1.0 - made.slow) * (smooth - slow)
    products = place * (plays.picked(PRODUCTS) - layout.centre_um)
    powers = [layout.scale_um * place**power for power in POWERS]
    found = smooth.graph.joined(smooth, smooth.filled(1.0), plays, products, *powers, slow)
    return found, plays, slow


def learned(
    fit: ForgettingLeastSquares, memory: Signal, phi: Signal, z: Signal, counts: Signal
) -> Signal:
    """Return the memory: :meth:`~baselines.least_squares.ForgettingLeastSquares.learn`.

    The equations are solved at every sample: that costs less than a graph that branches.
    """
    where, joined = memory.graph.where, memory.graph.joined
    rows, columns = np.tril_indices(fit.size)
    forget, used = where(counts, fit.kept, 1.0), counts.numbered()
    new = joined(used * phi.picked(rows) * phi.picked(columns), used * phi * z)
    sums = forget * memory[:, 1 : -fit.size] + new
    count = memory[:, :1] + used
    due = counts & (count.remainder(SOLVE_EVERY) <= 0.0)
    theta = where(due, _solved(fit, sums), memory[:, -fit.size :])
    return joined(count, sums, theta)


def _solved(fit: ForgettingLeastSquares, sums: Signal) -> Signal:
    """``_solve`` of the least squares; the right side is eliminated as one more column."""
    joined, size = sums.graph.joined, fit.size
    place = np.zeros((size, size), dtype=np.int64)
    place[np.tril_indices(size)] = np.arange(size * (size + 1) // 2)
    left = sums.picked(np.maximum(place, place.T)) + np.diag(fit.precision)
    rest = joined(left, (sums[:, -size:] + fit.pull).raised(2))
    rows: list[Signal] = []
    for least in fit.precision:
        row = rest[:, :1, 1:]
        rows.append(row / rest[:, :1, :1].at_least(least))
        rest = rest[:, 1:, 1:] - rows[-1][:, :, :-1].turned() * row
    theta = rows.pop()
    for row in reversed(rows):
        theta = joined(row[:, :, -1:] - (row[:, :, :-1] * theta).total(), theta)
    return theta.lowered(1)


def unlearned(fit: ForgettingLeastSquares, memory: Signal, share: Signal) -> Signal:
    """Return the memory: :meth:`~baselines.least_squares.ForgettingLeastSquares.unlearn`."""
    theta = share * memory[:, -fit.size :] + (1.0 - share) * fit.prior
    return memory.graph.joined(memory[:, :1], share * memory[:, 1 : -fit.size], theta)


def driven(
    inverse: ClassicalReferenceRate, wanted: Signal, memory: Signal
) -> tuple[Signal, Signal]:
    """Return the command (V) and the memory: :meth:`~baselines.feedforward.Feedforward.next_command`."""
    model, ts_s = inverse.model, inverse.layout.ts_s
    gain, *numbers, shift, _, offset = pack_inverse([model], ts_s)[:, 0].tolist()
    weights, thresholds = np.array(numbers[: model.n]), np.array(numbers[model.n :])
    rate = (wanted - memory[:, -1:]) / (ts_s * model.A)
    x, reach = wanted - inverse.belief.offset_um, thresholds + shift * abs(rate)
    plays = memory[:, 2:-1].clipped(x - reach, x + reach)
    low, high, _ = inverse.limits
    command = (gain * x + offset + (weights * plays).total()).clipped(low, high)
    return command, wanted.graph.joined(command, memory[:, 1:2], plays, wanted)


def answered(
    student: Student, seen: Signal, error: Signal, memory: Signal
) -> tuple[Signal, Signal]:
    """Return the correction (µm) and the memory: :meth:`~baselines.learned.imitation.student.Student.answer_um`.

    Python rounds to single precision within; here nothing is.
    """
    joined, width = seen.graph.joined, student.width
    p = {name: array.astype(np.float64) for name, array in student.arrays.items()}
    scaled = (seen - p["middle"]) / p["spread"]
    before, errors, corrections = (
        memory[:, first : first + count]
        for first, count in ((0, width), (width, ERRORS - 1), (width + ERRORS, CORRECTIONS))
    )
    errors = joined(error / UNIT_UM, errors)
    past = joined(errors, corrections)
    given = scaled.asinh() @ p["into"].T + p["bias"] + past.asinh() @ p["past"].T
    back = before @ p["hidden"].T + p["hidden_bias"]
    gates = (given[:, : 2 * width] + back[:, : 2 * width]).sigmoid()
    reset, keep = gates[:, :width], gates[:, width:]
    fresh = (given[:, 2 * width :] + reset * back[:, 2 * width :]).tanh()
    after = fresh + keep * (before - fresh)
    weights = after @ p["head"].T + p["head_bias"]
    phi = joined(scaled[:, : student.weighted], error.filled(1.0), errors)
    most = MOST_UM / UNIT_UM
    correction = most * ((weights * phi).total() / most).tanh()
    return UNIT_UM * correction, joined(after, errors, correction, corrections[:, :-1])
