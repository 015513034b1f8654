"""Lines of the mains: 50 or 60 Hz and their harmonics, where the command does not move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, cannot_tell
from rdpi_gym.diagnosis.features.rests import Rest
from rdpi_gym.measurement import Record
from rdpi_gym.measurement.quantities import in_output
from rdpi_gym.support.arrays import Array

NAME = "mains hum"
SHARE = 0.25
"""Amplitude of a line over the roughness of the displacement (rms)."""
_MAINS_HZ = (50.0, 60.0)
_HARMONICS = (1, 2, 3)
_OFF = 0.01  # of its frequency: how far the mains may be off
_ABOVE = 2.5  # times what other lines nearby reach
_CHANCE = 2.6  # times the median: what noise reaches in one line of a hundred
_SMALLEST = 1e-6  # of the stroke
_CYCLES = 20  # of the mains that a stretch must hold
_LONGEST = 100_000
_QUIET = "Record two seconds at constant command, sampled at 500 Hz or more."


@dataclass(frozen=True)
class Line:
    """Amplitude at a frequency, and the largest at the frequencies around it (µm)."""

    frequency_hz: float
    amplitude_um: float
    around_um: float
    where: str


def mains_hum(
    rests: Sequence[Rest], records: Sequence[Record], noise_um: float, stroke_um: float
) -> Check:
    """Look for lines of the mains in rests, or else in moving records beside their neighbours."""
    lines = _resting(rests) or [line for r in records for line in _moving(r)]
    if not lines:
        return cannot_tell(
            NAME,
            "No stretch is sampled fast and long enough to show a line at 50 or 60 Hz.",
            _QUIET,
        )
    threshold = max(SHARE * noise_um, _SMALLEST * stroke_um)
    best = max(lines, key=lambda line: line.amplitude_um / max(line.around_um, 1e-300))
    clear = best.amplitude_um > _ABOVE * best.around_um
    amplitude = in_output(best.amplitude_um)
    if clear and best.amplitude_um >= threshold:
        text = f"In {best.where} there is a line of {amplitude} at {best.frequency_hz:.4g} Hz, while frequencies around it have {in_output(best.around_um)} at most: mains hum."
        return Check(
            NAME, best.amplitude_um, threshold, "{output_unit}", "yes", text, "", ("mains_hum",)
        )
    if clear or max(line.around_um for line in lines if line.where == best.where) < threshold:
        text = f"In {best.where} no line at 50 or 60 Hz or their harmonics stands out of the noise: no mains hum."
        return Check(NAME, best.amplitude_um, threshold, "{output_unit}", "no", text)
    text = f"In {best.where} a line at {best.frequency_hz:.4g} Hz has {amplitude}, which other frequencies nearby have too: nothing can be said about mains hum."
    return Check(NAME, best.amplitude_um, threshold, "{output_unit}", "cannot tell", text, _QUIET)


def _resting(rests: Sequence[Rest]) -> list[Line]:
    long = [rest for rest in rests if rest.duration_s * _MAINS_HZ[0] >= _CYCLES]
    fast = [rest for rest in long if rest.record.ts_s * _MAINS_HZ[1] < 0.45]
    if not fast:
        return []
    rest = max(fast, key=lambda each: min(each.last - each.first, 20_000) / each.record.ts_s**0.2)
    record = rest.record
    skip = min(rest.first + (rest.last - rest.first) // 10, rest.last - 2) if rest.first else 0
    where = f"the quiet record {record.name}" if record.is_quiet else f"a rest of {record.name}"
    return _lines(record.y_um[skip : rest.last], record.ts_s, where, noise_only=True)


def _moving(record: Record) -> list[Line]:
    """Lines that the displacement has and the command has not."""
    if record.ts_s * _MAINS_HZ[1] >= 0.45 or record.u_V.size * record.ts_s * _MAINS_HZ[0] < _CYCLES:
        return []
    of_u = {line.frequency_hz: line for line in _lines(record.u_V, record.ts_s, record.name)}
    return [
        line
        for line in _lines(record.y_um, record.ts_s, record.name)
        if (excited := of_u.get(line.frequency_hz)) is None
        or excited.amplitude_um < 2.0 * excited.around_um
    ]


def _lines(x: Array, ts_s: float, where: str, noise_only: bool = False) -> list[Line]:
    x = x[:_LONGEST]
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
