"""Experiments on a stage: the command records that show its physical effects apart.

Here signals are commands: their numbers are volts, `amplitude_um` included.
"""

from __future__ import annotations

from collections.abc import Sequence as Values
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rdpi_gym.signals.base import Signal
from rdpi_gym.signals.broadband import BandLimitedNoise, Chirp, DecayingSine, Multisine
from rdpi_gym.signals.measured import Measured
from rdpi_gym.signals.periodic import Sine
from rdpi_gym.signals.steps import Constant
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

# Time for which the stage rests between two records of a protocol.
PAUSE_S = 1.0
# Steps rise this long: a corner between two samples of a slow record is no experiment.
_RISE_S = 0.05


@dataclass(frozen=True)
class Experiment:
    """One record to take: which command, for how long, sampled how often.

    Parameters
    ----------
    name
        Name of the record; one that begins with ``validation`` is held out.
    purpose
        What it shows.
    signal
        Command (V) over time.
    ts_s, duration_s
        Sampling time and length (s).
    slowness
        Factor on the times of the signal.

    Examples
    --------
    >>> tone = Experiment("tone", "gain", Sine(amplitude_um=2.0, frequency_hz=5.0), 0.05, 0.2)
    >>> tone.command_V().round(2).tolist()
    [0.0, 2.0, 0.0, -2.0]
    """

    name: str
    purpose: str
    signal: Signal
    ts_s: float
    duration_s: float
    slowness: float = 1.0

    @property
    def role(self) -> Literal["train", "validation"]:
        """Whether a fit may use it."""
        return "validation" if self.name.startswith("validation") else "train"

    def times_s(self) -> Array:
        """Times of the samples from the record's start (s), float64[T]."""
        samples = round(self.duration_s / self.ts_s)
        return np.arange(samples, dtype=np.float64) * self.ts_s

    def command_V(self, ts_s: float | None = None) -> Array:
        """Command (V) at its own sampling time or another one, float64[T]."""
        step_s = self.ts_s if ts_s is None else ts_s
        times_s = np.arange(round(self.duration_s / step_s), dtype=np.float64) * step_s
        return self.signal(times_s / self.slowness)


def polyline(values_V: Values[float], rate_V_s: float) -> Measured:
    """Command through turning points at a constant rate."""
    steps = np.abs(np.diff(values_V)) / rate_V_s
    times = np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1e-9))])
    return Measured(times_s=times, values_um=values_V)


def _decaying(centre: float, span: float, turns: int) -> list[float]:
    sizes = span * np.linspace(1.0, 0.0, turns + 1)[:-1]
    return [centre, *(centre + s * (-1.0) ** i for i, s in enumerate(sizes)), centre]


def _stairs(centre: float, span: float, levels: Values[float], holds_s: Values[float]) -> Measured:
    times, values, now = [0.0], [centre], 0.0
    for level, hold in zip(levels, holds_s, strict=True):
        times += [now + _RISE_S, now + hold]
        values += [centre + level * span] * 2
        now += hold
    return Measured(times_s=times, values_um=values)


def _minor_loops(centre: float, span: float) -> list[float]:
    points = [centre, centre + span, centre - span]
    for bias in (-0.55, 0.0, 0.55):
        middle = centre + bias * span
        points += [middle + 0.3 * span, middle - 0.3 * span] * 3
    return [*points, centre + span, centre]


def standard_protocol(
    centre_V: float, span_V: float, first_threshold_V: float, seed: int = 0, slowness: float = 1.0
) -> tuple[Experiment, ...]:
    """Return ten records to fit, a quiet one, and five of other kinds to validate on.

    `slowness` is a factor on all times, which the names do not state.
    """
    if not (span_V > 0 and first_threshold_V > 0):
        raise InputError(
            f"span_V is {span_V} and first_threshold_V {first_threshold_V}; both lie above 0 V"
        )
    c, s = centre_V, span_V
    slow = polyline(_decaying(c, s, 20), rate_V_s=40.0 * s / 19.0)
    small = Multisine(
        amplitude_um=0.7 * min(first_threshold_V, s), offset_um=c, frequency_hz=20.0, lines=50,
        odd=True, seed=seed + 1,
    )  # fmt: skip
    wide = Multisine(amplitude_um=s, offset_um=c, frequency_hz=4.0, lines=60, odd=True, seed=seed)
    up_down = (0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.5, 0.0)
    records = (
        Experiment("triangle-slow", "hysteresis at every depth", slow, 1e-3, 10.0),
        Experiment("sine-10hz", "rate", _sine(c, s, 10.0), 1e-4, 1.0),
        Experiment("sine-50hz", "rate", _sine(c, s, 50.0), 5e-5, 0.3),
        Experiment("sine-100hz-half", "iso-rate partner of 50 Hz", _sine(c, s / 2, 100.0), 5e-5, 0.2),
        Experiment("sine-200hz-quarter", "iso-rate partner", _sine(c, s / 4, 200.0), 5e-5, 0.15),
        Experiment("multisine", "dynamics", wide, 2.5e-5, 0.5),
        Experiment("multisine-small", "lags: every play sticks", small, 5e-5, 0.4),
        Experiment(
            "stairs", "creep and drift over three decades of time",
            _stairs(c, s, up_down, (0.1, 0.2, 1.0, 0.5, 5.0, 15.0, 2.0, 30.0, 6.2)), 5e-3, 60.0,
        ),
        Experiment("minor-loops", "congruency", polyline(_minor_loops(c, s), 4.9 * s), 5e-4, 4.0),
        Experiment("triangle-slow-again", "drift: the first record once more", slow, 1e-3, 10.0),
        Experiment("quiet", "noise, drift, hum", Constant(offset_um=c), 5e-4, 2.0),
        Experiment(
            "validation-noise", "another kind",
            BandLimitedNoise(
                amplitude_um=0.8 * s, offset_um=c + 0.1 * s, low_hz=0.0, high_hz=200.0,
                repeat_s=0.5, smooth_start_s=0.02, seed=seed + 2,
            ), 5e-5, 0.5,
        ),
        Experiment(
            "validation-stairs", "another kind",
            _stairs(
                c, s, (-0.8, 0.3, 0.7, -0.2, 0.9, -0.6, 0.1),
                (0.5, 4.0, 0.2, 10.0, 1.0, 20.0, 4.3),
            ), 5e-3, 40.0,
        ),
        Experiment(
            "validation-decaying-sine", "another kind",
            DecayingSine(
                amplitude_um=s, offset_um=c, frequency_hz=30.0, decay_s=0.4,
            ), 1e-4, 1.0,
        ),
        Experiment(
            "validation-loops", "another kind",
            polyline([c, c - 0.9 * s, c + 0.8 * s, c - 0.2 * s, c + 0.5 * s, c - 0.7 * s, c], 1.8 * s),
            1e-3, 5.0,
        ),
        Experiment(
            "validation-chirp", "another kind",
            Chirp(
                amplitude_um=0.3 * s, offset_um=c, start_hz=20.0, stop_hz=400.0, duration_s=0.5,
            ), 5e-5, 0.5,
        ),
    )  # fmt: skip
    return tuple(
        replace(e, ts_s=slowness * e.ts_s, duration_s=slowness * e.duration_s, slowness=slowness)
        for e in records
    )


def _sine(centre: float, span: float, frequency_hz: float) -> Sine:
    return Sine(amplitude_um=span, offset_um=centre, frequency_hz=frequency_hz)
