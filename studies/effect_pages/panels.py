"""Panels of a picture: one way to look at an effect each, as ``rdpi_gym.plant.effects.Look`` names it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.plant.effects import Picture
from rdpi_gym.signals import Constant
from rdpi_gym.signals.experiments import Experiment, polyline
from rdpi_gym.support.arrays import Array
from studies.effect_pages.picture import LEFT, WITH, WITHOUT, Line, Panel
from studies.effect_pages.study import Study

Complex = NDArray[np.complex128]

TIME, COMMAND, DISPLACEMENT = "Time (s)", "Command (V)", "Displacement (µm)"
RESIDUAL = "Measured − model (µm)"

# Odd lines of the small multisine that are excited: the first, and how far apart (Hz).
_FIRST_HZ, _APART_HZ = 20.0, 40.0


# Voltage below the first threshold of the plant, where every play sticks.
_SMALL_V = 0.8
_SMALL = polyline([0.0, *[_SMALL_V, -_SMALL_V] * 3, 0.0], rate_V_s=4.0 * _SMALL_V)
EXPERIMENTS: dict[str, Experiment] = {
    experiment.name: experiment
    for experiment in (
        Experiment("small-triangle", "reversals while every play sticks", _SMALL, 1e-3, 3.0),
        Experiment("step", "ringing", polyline([0.0, 0.0, 5.0], rate_V_s=1e4), 2e-5, 0.02),
        Experiment("at-rest", "drift", Constant(offset_um=0.0), 0.1, 300.0),
    )
}
"""Experiments besides those of the standard protocol."""


def loops(study: Study, title: str, name: str) -> Panel:
    """Displacement over the command of one record, with and without the effect."""
    bare, having = study.without[name], study.having[name]
    lines = (Line(WITHOUT, bare.u_V, bare.y_um), Line(WITH, having.u_V, having.y_um))
    return Panel(title, COMMAND, DISPLACEMENT, lines)


def over_time(study: Study, title: str, name: str, start_s: float, stop_s: float) -> Panel:
    """Displacement over a stretch of one record's time, with and without the effect."""
    bare, having = study.without[name], study.having[name]
    t = having.t_s - having.t_s[0]
    k = (t >= start_s) & (t <= stop_s)
    lines = (Line(WITHOUT, t[k], bare.y_um[k]), Line(WITH, t[k], having.y_um[k]))
    return Panel(title, TIME, DISPLACEMENT, lines)


def response(study: Study, title: str, name: str) -> Panel:
    """Displacement over time in an experiment of its own, with and without the effect."""
    experiment = EXPERIMENTS[name]
    t = experiment.times_s()
    bare, having = study.respond(experiment)
    return Panel(title, TIME, DISPLACEMENT, (Line(WITHOUT, t, bare), Line(WITH, t, having)))


def small_loop(study: Study, title: str, name: str, start_s: float) -> Panel:
    """Displacement over the command in an experiment of its own, from a time (s) on."""
    experiment = EXPERIMENTS[name]
    k = experiment.times_s() >= start_s
    u = experiment.command_V()[k]
    bare, having = (y[k] for y in study.respond(experiment))
    return Panel(title, COMMAND, DISPLACEMENT, (Line(WITHOUT, u, bare), Line(WITH, u, having)))


def left_over_time(
    study: Study, title: str, name: str, start_s: float = 0.0, stop_s: float = np.inf
) -> Panel:
    """Residual of a refit over the time of one record."""
    record = study.having[name]
    t = record.t_s - record.t_s[0]
    k = (t >= start_s) & (t <= stop_s)
    return Panel(title, TIME, RESIDUAL, (Line(LEFT, t[k], study.left_um[name][k]),))


def left_over_command(study: Study, title: str, *names: str) -> Panel:
    """Residual of a refit over the command: of one record by direction, of several by record."""
    lines = []
    for name in names:
        u, left = study.having[name].u_V, study.left_um[name]
        rising = np.gradient(u) > 0
        if len(names) > 1:
            lines.append(Line(name, u, left))
            continue
        for direction, of in (("rising", rising), ("falling", ~rising)):
            lines.append(Line(direction, u, np.where(of, left, np.nan)))
    return Panel(title, COMMAND, RESIDUAL, tuple(lines))


def gain(study: Study, title: str) -> Panel:
    """Gain over frequency, where every play sticks."""
    f, bare, having = _transfer(study)
    lines = (Line(WITHOUT, f, np.abs(bare)), Line(WITH, f, np.abs(having)))
    return Panel(title, "Frequency (Hz)", "Gain (µm/V)", lines, from_zero=True)


def phase(study: Study, title: str) -> Panel:
    """Phase over frequency, where every play sticks."""
    f, bare, having = _transfer(study)
    degrees = [np.degrees(np.unwrap(np.angle(g))) for g in (bare, having)]
    lines = (Line(WITHOUT, f, degrees[0]), Line(WITH, f, degrees[1]))
    return Panel(title, "Frequency (Hz)", "Phase (degrees)", lines)


def _transfer(study: Study) -> tuple[Array, Complex, Complex]:
    name = "multisine-small"
    bare, having = study.without[name], study.having[name]
    period = round(1.0 / (_FIRST_HZ * having.ts_s))  # the last one has settled
    f = np.fft.rfftfreq(period, having.ts_s).astype(np.float64)
    lines = np.flatnonzero(np.isclose((f - _FIRST_HZ) % _APART_HZ, 0.0) & (f < 2e3))
    u = np.fft.rfft(having.u_V[-period:])[lines]
    found = [np.fft.rfft(r.y_um[-period:])[lines] / u for r in (bare, having)]
    return f[lines], found[0], found[1]


def onward(study: Study, title: str, name: str, moved_s: float, stop_s: float) -> Panel:
    """Displacement since the end of a move, over the logarithm of the time since then."""
    lines = []
    for label, record in ((WITHOUT, study.without[name]), (WITH, study.having[name])):
        t = record.t_s - record.t_s[0] - moved_s
        k = np.flatnonzero((t > 0.5 * record.ts_s) & (t <= stop_s - moved_s))
        lines.append(Line(label, t[k], record.y_um[k] - record.y_um[k[0]]))
    return Panel(title, "Time since the move (s)", "Onward (µm)", tuple(lines), log_x=True)


def spectrum(study: Study, title: str, name: str, highest_hz: float) -> Panel:
    """Amplitudes of what a refit leaves of one record."""
    record, left = study.having[name], study.left_um[name]
    f = np.fft.rfftfreq(left.size, record.ts_s).astype(np.float64)
    window = np.hanning(left.size)
    amplitude = np.abs(np.fft.rfft(window * left)) * (2.0 / float(np.sum(window)))
    k = f <= highest_hz
    return Panel(title, "Frequency (Hz)", "Amplitude (µm)", (Line(LEFT, f[k], amplitude[k]),))


def repeats(study: Study, title: str, first: str, again: str) -> Panel:
    """Change of the displacement when the same command is repeated, over displacement."""
    lines = []
    for label, records in ((WITHOUT, study.without), (WITH, study.having)):
        before, after = records[first].y_um, records[again].y_um
        lines.append(Line(label, before, after - before))
    return Panel(title, DISPLACEMENT, "Repeat − first (µm)", tuple(lines))


PANELS: dict[str, Callable[..., Panel]] = {
    panel.__name__: panel
    for panel in (
        *(loops, over_time, response, small_loop, left_over_time, left_over_command),
        *(gain, phase, onward, spectrum, repeats),
    )
}
"""By the name that an effect's picture gives."""


def panels_of(picture: Picture, study: Study) -> tuple[Panel, Panel]:
    """Return the left and the right half of an effect's picture, of a study of the effect."""
    looks = picture.left, picture.right
    left, right = (PANELS[look.kind](study, look.title, *look.arguments) for look in looks)
    return left, right
