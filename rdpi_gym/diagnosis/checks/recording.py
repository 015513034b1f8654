"""Quality of the data: coverage of the commands, and faults of the measurement itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, Zone, cannot_tell, zone_of
from rdpi_gym.diagnosis.features.cycles import HalfCycles, Periods, smallest_step
from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.diagnosis.features.recurrence import Rest, same_command
from rdpi_gym.diagnosis.notices import Statement, statement
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

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


CLIPPED_SAMPLES = 5
"""Samples at one extreme value in a row, while the command moves."""
STEP_RATIO = 3.0
"""Smallest step of the displacement over its noise (rms)."""
FEEDBACK = 0.1
"""Correlation of the displacement with later noise of the command."""
SKEW_PPM = 50.0
"""Difference of the clocks of command and displacement (millionths)."""
_MOVES = 0.03  # of the swing
_ORDER = 12  # of the predictor that leaves the noise of a command
_LAGS = 10
_NOISELESS = 1e-5  # of the swing: a command that is computed, not measured
_ROUGH = 0.03  # of the swing, what is new from sample to sample
_GAUSSIAN = 0.6745  # median of the modulus of noise over its standard deviation
_LONGEST = 10_000
_FEWEST_PERIODS = 6


def clipping(records: Sequence[Record]) -> Check:
    """Displacement that stands at its largest or smallest value while the command moves."""
    worst, values = 0, dict[str, object]()
    for record in records:
        for extreme in (record.y_um.max(), record.y_um.min()):
            length = _longest_stand(record, float(extreme))
            if length > worst:
                worst = length
                values = {"record": record.name, "extreme": extreme, "count": length}
    least = float(CLIPPED_SAMPLES)
    if worst >= CLIPPED_SAMPLES:
        found = statement("clipping/yes", **values)
        return Check(
            "clipping", float(worst), least, "samples", "yes", found, statement("widen range")
        )
    return Check("clipping", float(worst), least, "samples", "no", statement("clipping/no"))


def _longest_stand(record: Record, extreme: float) -> int:
    at = np.flatnonzero(record.y_um == extreme)
    if at.size < CLIPPED_SAMPLES:
        return 0
    longest = 0
    swing = float(np.ptp(record.u_V))
    for run in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1):
        if run.size > longest and np.ptp(record.u_V[run]) > _MOVES * swing:
            longest = run.size
    return longest


def resolution(records: Sequence[Record]) -> Check:
    """Smallest step of the displacement, beside its noise."""
    name = "coarse resolution"
    worst = (0.0, 0.0, "")
    for record in records:
        steps = np.abs(np.diff(record.y_um))
        if np.count_nonzero(steps == 0.0) < 0.02 * steps.size:
            continue
        smallest = smallest_step(record.y_um)
        if smallest == 0.0:
            continue
        ratio = smallest / max(rough_part(record.y_um), 0.29 * smallest)
        if ratio > worst[0]:
            worst = (ratio, smallest, record.name)
    ratio, smallest, where = worst
    if ratio >= STEP_RATIO:
        found = statement("coarse resolution/yes", record=where, step=smallest)
        return Check(name, ratio, STEP_RATIO, "", "yes", found, statement("finer range"))
    lost = statement("coarse resolution/no", record=where, step=smallest)
    return Check(
        name, ratio, STEP_RATIO, "", "no", lost if where else statement("coarse resolution/none")
    )


def feedback(records: Sequence[Record]) -> Check:
    """Noise of the command that follows the displacement: the loop was closed.

    Notes
    -----
    Command and displacement go through the predictor of the command, which leaves what is new in
    it; in an open loop that has nothing to do with displacements before it.
    """
    name = "closed loop"
    worst: tuple[float, float, str] | None = None
    for record in records:
        if record.u_V.size < 40 * _ORDER:
            continue
        found = _follows(record.u_V[:_LONGEST], record.y_um[:_LONGEST])
        if found is not None and (worst is None or found[0] > worst[0]):
            worst = (*found, record.name)
    if worst is None:
        return Check(name, 0.0, FEEDBACK, "", "no", statement("closed loop/noiseless"))
    value, error, where = worst
    if zone_of(value, error, FEEDBACK) == "yes":
        closed = statement("closed loop/yes", record=where, correlation=value)
        return Check(name, value, FEEDBACK, "", "yes", closed, statement("open the loop"))
    opened = statement("closed loop/no", record=where, correlation=value)
    return Check(name, value, FEEDBACK, "", "no", opened)


def _follows(u: Array, y: Array) -> tuple[float, float] | None:
    """Largest correlation of what is new in u with y before it, and its error."""
    x = u - u.mean()
    swing = float(np.ptp(x))
    if swing == 0.0:
        return None
    columns = np.lib.stride_tricks.sliding_window_view(x, _ORDER + 1)[:, ::-1]
    past = columns[:, 1:]
    gram = past.T @ past
    weights = np.linalg.solve(
        gram + 1e-12 * np.trace(gram) * np.eye(_ORDER), past.T @ columns[:, 0]
    )
    new = columns[:, 0] - past @ weights
    # a command that is rough by design tells nothing of noise
    if float(np.std(new)) > _ROUGH * swing:
        return None
    # what is new at corners and jumps only is no noise
    if float(np.median(np.abs(new))) / _GAUSSIAN < max(
        _NOISELESS * swing, 0.3 * float(np.std(new))
    ):
        return None
    along = np.lib.stride_tricks.sliding_window_view(y - y.mean(), _ORDER + 1)[:, ::-1]
    of_y = along[:, 0] - along[:, 1:] @ weights
    new, of_y = new - new.mean(), of_y - of_y.mean()
    power = float(np.sqrt(np.sum(new * new) * np.sum(of_y * of_y)))
    if power == 0.0:
        return None
    values = [abs(float(np.sum(new[lag:] * of_y[:-lag]))) / power for lag in range(1, _LAGS + 1)]
    return max(values), 1.0 / float(np.sqrt(new.size))


def clocks(stretches: Sequence[Periods]) -> Check:
    """Lag of the displacement that grows with time: two clocks."""
    name = "two clocks"
    found = [skew for p in stretches if p.count >= _FEWEST_PERIODS and (skew := _skew(p))]
    if not found:
        return cannot_tell(name, "two clocks/none", "twenty periods")
    value, error, where = min(found, key=lambda entry: entry[1])
    zone = zone_of(value, error, SKEW_PPM)
    text = statement(f"two clocks/{zone}", record=where, skew=value, measured=(value, error))
    advice = {
        "yes": statement("one clock"),
        "no": None,
        "cannot tell": statement("twenty periods"),
    }[zone]
    return Check(name, value, SKEW_PPM, "µs/s", zone, text, advice)


def _skew(periods: Periods) -> tuple[float, float, str] | None:
    u, y = (
        np.fft.rfft(periods.folded(x), axis=1)[1:, 1]
        for x in (periods.record.u_V, periods.record.y_um)
    )
    if np.min(np.abs(u)) <= 1e-3 * np.max(np.abs(u)) or not np.all(np.abs(y) > 0.0):
        return None
    angle = np.unwrap(np.angle(y / u))
    if angle.size < 3:
        return None
    t = np.arange(angle.size) / periods.frequency_hz
    t -= t.mean()
    slope = float(t @ angle) / float(t @ t)
    left = angle - angle.mean() - slope * t
    error = float(np.sqrt(left @ left / max(angle.size - 2, 1) / (t @ t)))
    scale = 1e6 / (2.0 * np.pi * periods.frequency_hz)
    return -scale * slope, scale * error, periods.record.name


HUM_SHARE = 0.25
"""Amplitude of a line over the roughness of the displacement (rms)."""
_MAINS_HZ = (50.0, 60.0)
_HARMONICS = (1, 2, 3)
_OFF = 0.01  # of its frequency: how far the mains may be off
_ABOVE = 2.5  # times what other lines nearby reach
_CHANCE = 2.6  # times the median: what noise reaches in one line of a hundred
_SMALLEST = 1e-6  # of the stroke
_CYCLES = 20  # of the mains that a stretch must hold
_MOST_SAMPLES = 100_000


@dataclass(frozen=True)
class Line:
    """Amplitude at a frequency, and the largest at the frequencies around it (µm)."""

    frequency_hz: float
    amplitude_um: float
    around_um: float
    where: Statement


def mains_hum(
    rests: Sequence[Rest], records: Sequence[Record], noise_um: float, stroke_um: float
) -> Check:
    """Look for lines of the mains in rests, or else in moving records beside their neighbours."""
    lines = _lines_at_rest(rests) or [line for r in records for line in _lines_in_motion(r)]
    if not lines:
        return cannot_tell("mains hum", "mains hum/none", "two quiet seconds")
    threshold = max(HUM_SHARE * noise_um, _SMALLEST * stroke_um)
    best = max(lines, key=lambda line: line.amplitude_um / max(line.around_um, 1e-300))
    clear = best.amplitude_um > _ABOVE * best.around_um
    zone: Zone = "cannot tell"
    if clear and best.amplitude_um >= threshold:
        zone = "yes"
    elif clear or max(line.around_um for line in lines if line.where == best.where) < threshold:
        zone = "no"
    found = statement(
        f"mains hum/{zone}", where=best.where, amplitude=best.amplitude_um,
        frequency_hz=best.frequency_hz, around=best.around_um,
    )  # fmt: skip
    advice = statement("two quiet seconds") if zone == "cannot tell" else None
    effects = ("mains_hum",) if zone == "yes" else ()
    return Check("mains hum", best.amplitude_um, threshold, "µm", zone, found, advice, effects)


def _lines_at_rest(rests: Sequence[Rest]) -> list[Line]:
    long = [rest for rest in rests if rest.duration_s * _MAINS_HZ[0] >= _CYCLES]
    fast = [rest for rest in long if rest.record.ts_s * _MAINS_HZ[1] < 0.45]
    if not fast:
        return []
    rest = max(fast, key=lambda each: min(each.last - each.first, 20_000) / each.record.ts_s**0.2)
    record = rest.record
    skip = min(rest.first + (rest.last - rest.first) // 10, rest.last - 2) if rest.first else 0
    where = statement("the quiet record" if record.is_quiet else "a rest", record=record.name)
    return _lines(record.y_um[skip : rest.last], record.ts_s, where, noise_only=True)


def _lines_in_motion(record: Record) -> list[Line]:
    """Lines that the displacement has and the command has not."""
    if record.ts_s * _MAINS_HZ[1] >= 0.45 or record.u_V.size * record.ts_s * _MAINS_HZ[0] < _CYCLES:
        return []
    where = statement("a name", record=record.name)
    of_u = {line.frequency_hz: line for line in _lines(record.u_V, record.ts_s, where)}
    return [
        line
        for line in _lines(record.y_um, record.ts_s, where)
        if (excited := of_u.get(line.frequency_hz)) is None
        or excited.amplitude_um < 2.0 * excited.around_um
    ]


def _lines(x: Array, ts_s: float, where: Statement, noise_only: bool = False) -> list[Line]:
    x = x[:_MOST_SAMPLES]
    t = np.linspace(-1.0, 1.0, x.size)
    flat = x - np.polynomial.polynomial.polyval(t, np.polynomial.polynomial.polyfit(t, x, 3))
    window = np.hanning(x.size)
    amplitude = 2.0 * np.abs(np.fft.rfft(flat * window)) / window.sum()
    step = 1.0 / (x.size * ts_s)
    frequency = np.arange(amplitude.size) * step
    found = []
    for mains in _MAINS_HZ:
        for harmonic in _HARMONICS:
            f = mains * harmonic
            if f > 0.45 / ts_s:
                continue
            off = np.abs(frequency - f)
            reach = max(_OFF * f, step)
            here = off <= reach
            # the main lobe of the window is two steps wide to either side
            around = (off > reach + 2.0 * step) & (off <= max(0.12 * f, reach + 20.0 * step))
            around &= frequency > 4.0 * step
            if here.any() and np.count_nonzero(around) >= 8:
                at = np.flatnonzero(here)[np.argmax(amplitude[here])]
                # among other lines of a wave the largest counts, in noise the typical one
                others = amplitude[around]
                reached = _CHANCE * np.median(others) if noise_only else others.max()
                found.append(Line(f, float(amplitude[at]), float(reached), where))
    return found
