"""Pictures of the effects: the protocol with and without an effect, and the residual of a refit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.identification import fit
from rdpi_gym.measurement import Record
from rdpi_gym.plant import Plant, named_plant
from rdpi_gym.plant.effects import CATALOGUE, Effect, Look, Picture
from rdpi_gym.report.chart import Axis, Panel, Series, side_by_side
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.report.style import FALLING, MODEL, PALETTE, REFERENCE, RESIDUAL, RISING
from rdpi_gym.report.thin import thin_index
from rdpi_gym.signals import Constant
from rdpi_gym.signals.experiments import Experiment, polyline
from rdpi_gym.support.arrays import Array
from rdpi_gym.virtual_lab import HIDEABLE, Truth, simulate_dataset
from rdpi_gym.virtual_lab.dataset import plant_displacement
from studies.chromium import small_png

PLANT = "P10"
_ANY = Picture(
    {},
    Look("loops", "A large sine of 10 Hz", "sine-10hz"),
    Look("left_over_command", "What a refit leaves of it", "sine-10hz"),
)
PICTURES: Mapping[str, Picture] = {
    name: kind.picture or _ANY
    for name, kind in CATALOGUE.items()
    if kind.__module__.startswith("rdpi_gym.") and name in HIDEABLE
}
"""Pictures that the files of the package's effects declare, by effect."""
# Half as many samples as in the protocol show the same.
_TRUTH = Truth(named_plant(PLANT), (), noise_um=0.0, seed=0, ts_factor=2.0)


@dataclass(frozen=True, eq=False)
class Pair:
    """Records of the protocol by name, of the bare plant and of the plant with one effect, without noise."""

    effect: Effect
    without: Mapping[str, Record]
    having: Mapping[str, Record]
    # Residual (µm) of the RDPI model refitted to all training records of `having`, offset free.
    left_um: Mapping[str, Array]

    def respond(self, experiment: Experiment) -> tuple[Array, Array]:
        """Displacement (µm) in another experiment: of the bare plant, and with the effect."""
        t, u = experiment.times_s(), experiment.command_V()
        first, second = (
            plant_displacement(_TRUTH.plant, effects, t, u) for effects in ([], [self.effect])
        )
        return first, second


def bare_records() -> dict[str, Record]:
    """Take the protocol on the plant without any effect."""
    return {r.name: r for r in simulate_dataset(_TRUTH).records}


def pair_of(name: str, without: Mapping[str, Record]) -> Pair:
    """Take the protocol on the plant with an effect, and refit the RDPI model to it."""
    effect = CATALOGUE[name]().with_values(PICTURES[name].values)
    data = simulate_dataset(_TRUTH.with_hidden([effect]))
    model = fit(data, n=_TRUTH.plant.hysteresis.n).plant
    left = {}
    for record in data.records:
        error = record.y_um - Plant(model, record.ts_s).simulate(record.u_V)
        left[record.name] = error - np.mean(error)
    return Pair(effect, without, {r.name: r for r in data.records}, left)


WITHOUT, WITH, LEFT = "without it", "with it", "left after a refit"
_COLOURS = {WITHOUT: REFERENCE, WITH: MODEL, LEFT: RESIDUAL, "rising": RISING, "falling": FALLING}
_RECORDS = (RESIDUAL, PALETTE[4], PALETTE[2])
TIME, COMMAND, DISPLACEMENT = Axis("Time (s)"), Axis("Command (V)"), Axis("Displacement (µm)")
RESIDUAL_UM, FREQUENCY = Axis("Measured − model (µm)"), Axis("Frequency (Hz)")
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


def _line(name: str, x: Array, y: Array, colour: str | None = None) -> Series:
    k = thin_index(y, samples=1200)
    return Series(x[k], y[k], name, colour or _COLOURS[name])


def _both(title: str, x_axis: Axis, y_axis: Axis, bare: Array, having: Array, x: Array) -> Panel:
    return Panel([_line(WITHOUT, x, bare), _line(WITH, x, having)], x_axis, y_axis, title)


def loops(pair: Pair, title: str, name: str) -> Panel:
    """Displacement over the command of one record, with and without the effect."""
    u, records = pair.having[name].u_V, (pair.without[name], pair.having[name])
    return _both(title, COMMAND, DISPLACEMENT, records[0].y_um, records[1].y_um, u)


def over_time(pair: Pair, title: str, name: str, start_s: float, stop_s: float) -> Panel:
    """Displacement over a stretch of one record's time, with and without the effect."""
    bare, having = pair.without[name], pair.having[name]
    t = having.t_s - having.t_s[0]
    k = (t >= start_s) & (t <= stop_s)
    return _both(title, TIME, DISPLACEMENT, bare.y_um[k], having.y_um[k], t[k])


def response(pair: Pair, title: str, name: str) -> Panel:
    """Displacement over time in an experiment of its own, with and without the effect."""
    experiment = EXPERIMENTS[name]
    return _both(title, TIME, DISPLACEMENT, *pair.respond(experiment), experiment.times_s())


def small_loop(pair: Pair, title: str, name: str, start_s: float) -> Panel:
    """Displacement over the command in an experiment of its own, from a time (s) on."""
    experiment = EXPERIMENTS[name]
    k = experiment.times_s() >= start_s
    bare, having = (y[k] for y in pair.respond(experiment))
    return _both(title, COMMAND, DISPLACEMENT, bare, having, experiment.command_V()[k])


def left_over_time(
    pair: Pair, title: str, name: str, start_s: float = 0.0, stop_s: float = np.inf
) -> Panel:
    """Residual of a refit over the time of one record."""
    record = pair.having[name]
    t = record.t_s - record.t_s[0]
    k = (t >= start_s) & (t <= stop_s)
    return Panel([_line(LEFT, t[k], pair.left_um[name][k])], TIME, RESIDUAL_UM, title)


def left_over_command(pair: Pair, title: str, *names: str) -> Panel:
    """Residual of a refit over the command: of one record by direction, of several by record."""
    lines = []
    for name, colour in zip(names, _RECORDS, strict=False):
        u, left = pair.having[name].u_V, pair.left_um[name]
        rising = np.gradient(u) > 0
        if len(names) > 1:
            lines.append(_line(name, u, left, colour))
            continue
        for direction, of in (("rising", rising), ("falling", ~rising)):
            lines.append(_line(direction, u, np.where(of, left, np.nan)))
    return Panel(lines, COMMAND, RESIDUAL_UM, title)


def gain(pair: Pair, title: str) -> Panel:
    """Gain over frequency, where every play sticks."""
    f, bare, having = _transfer(pair)
    y = Axis("Gain (µm/V)", from_zero=True)
    return _both(title, FREQUENCY, y, np.abs(bare), np.abs(having), f)


def phase(pair: Pair, title: str) -> Panel:
    """Phase over frequency, where every play sticks."""
    f, *transfer = _transfer(pair)
    bare, having = (np.degrees(np.unwrap(np.angle(g))) for g in transfer)
    return _both(title, FREQUENCY, Axis("Phase (degrees)"), bare, having, f)


def _transfer(pair: Pair) -> tuple[Array, NDArray[np.complex128], NDArray[np.complex128]]:
    name = "multisine-small"
    bare, having = pair.without[name], pair.having[name]
    period = round(1.0 / (_FIRST_HZ * having.ts_s))  # the last one has settled
    f = np.fft.rfftfreq(period, having.ts_s).astype(np.float64)
    lines = np.flatnonzero(np.isclose((f - _FIRST_HZ) % _APART_HZ, 0.0) & (f < 2e3))
    u = np.fft.rfft(having.u_V[-period:])[lines]
    found = [np.fft.rfft(r.y_um[-period:])[lines] / u for r in (bare, having)]
    return f[lines], found[0], found[1]


def onward(pair: Pair, title: str, name: str, moved_s: float, stop_s: float) -> Panel:
    """Displacement since the end of a move, over the logarithm of the time since then."""
    lines = []
    for label, record in ((WITHOUT, pair.without[name]), (WITH, pair.having[name])):
        t = record.t_s - record.t_s[0] - moved_s
        k = np.flatnonzero((t > 0.5 * record.ts_s) & (t <= stop_s - moved_s))
        lines.append(_line(label, t[k], record.y_um[k] - record.y_um[k[0]]))
    return Panel(lines, Axis("Time since the move (s)", log=True), Axis("Onward (µm)"), title)


def spectrum(pair: Pair, title: str, name: str, highest_hz: float) -> Panel:
    """Amplitudes of the residual of a refit to one record."""
    record, left = pair.having[name], pair.left_um[name]
    f = np.fft.rfftfreq(left.size, record.ts_s).astype(np.float64)
    window = np.hanning(left.size)
    amplitude = np.abs(np.fft.rfft(window * left)) * (2.0 / float(np.sum(window)))
    k = f <= highest_hz
    return Panel([_line(LEFT, f[k], amplitude[k])], FREQUENCY, Axis("Amplitude (µm)"), title)


def repeats(pair: Pair, title: str, first: str, again: str) -> Panel:
    """Change of the displacement when the same command is repeated, over displacement."""
    lines = []
    for label, records in ((WITHOUT, pair.without), (WITH, pair.having)):
        before, after = records[first].y_um, records[again].y_um
        lines.append(_line(label, before, after - before))
    return Panel(lines, DISPLACEMENT, Axis("Repeat − first (µm)"), title)


PANELS: dict[str, Callable[..., Panel]] = {
    panel.__name__: panel
    for panel in (
        *(loops, over_time, response, small_loop, left_over_time, left_over_command),
        *(gain, phase, onward, spectrum, repeats),
    )
}
"""Panels by the name that an effect's picture gives."""


def panels_of(name: str, pair: Pair) -> list[Panel]:
    """Return the left and the right half of an effect's picture."""
    looks = PICTURES[name].left, PICTURES[name].right
    return [PANELS[look.kind](pair, look.title, *look.arguments) for look in looks]


def effect_picture(name: str, without: Mapping[str, Record]) -> bytes:
    """Draw the picture of an effect as a small PNG file."""
    panels = panels_of(name, pair_of(name, without))
    return small_png(chart_png(side_by_side(panels), (7.6, 3.2), 110))
