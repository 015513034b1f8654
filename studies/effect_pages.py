"""A page and a picture for each effect of the catalogue, made from its file."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping
from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from baselines.extended import ExtendedInverse
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.identification import fit
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P10, Plant, PlantModel, named_plant
from rdpi_gym.plant.effects import CATALOGUE, Effect, Look, Picture
from rdpi_gym.plant.effects.description import PLACES, page
from rdpi_gym.report.chart import Axis, Panel, Series, side_by_side
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.report.style import FALLING, MODEL, PALETTE, REFERENCE, RESIDUAL, RISING
from rdpi_gym.report.traces import thin_index
from rdpi_gym.signals import Constant
from rdpi_gym.signals.experiments import Experiment, polyline
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.command import Options
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.markdown import table
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.virtual_lab import HIDEABLE, Truth, simulate_dataset
from rdpi_gym.virtual_lab.dataset import plant_displacement
from studies.chromium import small_png
from studies.runner import RESULTS, Files, Study

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


OUT = Path(__file__).parents[1] / "docs" / "effects"
CONTROLLER = "extended-inverse"
TABLE = RESULTS / "effect_tracking.csv"

# The longest look ahead that an inverse takes here is the delay's: 6 samples, and its filter's.
_PREVIEW = 17
_LEVELS_UM = (0.0, 20.0, -10.0, 30.0, -30.0, 0.0)
_HOLD_S, _RISE_S = 10.0, 0.1


@dataclass(frozen=True)
class Reference:
    """A reference to follow."""

    name: str
    ts_s: float
    samples_um: Array
    first: int  # sample at which scoring begins


@dataclass(frozen=True)
class Tracked:
    """RMS errors (µm) of one effect on one reference."""

    effect: str
    reference: str
    without_um: float  # on the plant without the effect
    # on the plant with it, where the inverse holds the bare plant, and the plant itself
    unknown_um: float
    known_um: float
    warning: str  # of the inverse that knows the effect, on what it cannot undo


def references() -> tuple[Reference, Reference]:
    """Return a fast reference and a slow one, both of 30 µm."""
    ts_s = 5e-5
    t = ts_s * np.arange(4000.0)
    sine = 30.0 * np.sin(2.0 * np.pi * 50.0 * t) * np.minimum(1.0, t / 0.02)
    slow_ts_s = 1e-3
    t = slow_ts_s * np.arange(_HOLD_S * len(_LEVELS_UM) / slow_ts_s)
    stairs, level_um = np.zeros(len(t)), 0.0
    for step, next_um in enumerate(_LEVELS_UM):
        place = np.clip((t - _HOLD_S * step) / _RISE_S, 0.0, 1.0)
        stairs += (next_um - level_um) * place * place * (3.0 - 2.0 * place)
        level_um = next_um
    return (
        Reference("sine of 50 Hz", ts_s, sine, first=800),
        Reference("staircase of a minute", slow_ts_s, stairs, first=0),
    )


def tracked(effect: Effect) -> Iterator[Tracked]:
    """Follow each reference with and without the effect, known and unknown.

    The plant is P10 with a rate low-passed as in the benchmark; the command is computed beforehand
    and applied open loop, and the error is that of the path that the effect is in.
    """
    bare = limit_band(P10)
    having = replace(bare, effects=(effect,))
    for reference in references():
        layout = ObservationLayout.for_plant(P10, reference.ts_s, preview=_PREVIEW)
        r = reference.samples_um[:, None]
        ignorant, knowing = ExtendedInverse(bare, layout), ExtendedInverse(having, layout)
        u, u_knowing = ignorant.command_block(r), knowing.command_block(r)
        yield Tracked(
            effect.name,
            reference.name,
            _rms_um(bare, u, reference),
            _rms_um(having, u, reference),
            _rms_um(having, u_knowing, reference),
            knowing.warning() or "",
        )


def _rms_um(plant: PlantModel, command_V: Array, reference: Reference) -> float:
    y = Plant(plant, reference.ts_s).simulate(command_V)[:, 0]
    # an inverse that looks ahead would need the reference to go on behind the last samples
    error = (y - reference.samples_um)[reference.first : -_PREVIEW]
    return float(np.sqrt(np.mean(error**2)))


def tracking_table() -> pd.DataFrame:
    """Return a row for each effect and reference, columns as :class:`Tracked`."""
    rows = [
        astuple(row)
        for name, picture in PICTURES.items()
        for row in tracked(CATALOGUE[name]().with_values(picture.values))
    ]
    return pd.DataFrame(rows, columns=list(Tracked.__dataclass_fields__))


def stored_rows(effect: str, table: Path = TABLE) -> list[Tracked]:
    """Return the rows of an effect from the committed table."""
    found = pd.read_csv(table, keep_default_na=False).query("effect == @effect")
    return [Tracked(*row) for row in found.itertuples(index=False, name=None)]


def tracking_text(effect: str) -> str:
    """Say in Markdown what an effect does to tracking, from the committed table."""
    rows = stored_rows(effect)
    lines = [
        "**What it does to tracking:**",
        "",
        table(
            [
                "reference (30 µm)",
                f"without {effect}",
                f"{effect} unknown to the inverse",
                f"{effect} known",
            ],
            [
                [
                    row.reference,
                    *(f"{um:.3g} µm" for um in (row.without_um, row.unknown_um, row.known_um)),
                ]
                for row in rows
            ],
            right=range(1, 4),
            rule="tight",
        ),
        "",
        f"RMS error of `{CONTROLLER}`, open loop, on P10 with the parameters of the picture "
        "([more about the table](README.md#what-the-table-of-tracking-errors-shows)).",
    ]
    if any("passed over" in row.warning for row in rows):
        lines[-1] += f" There is no inverse of `{effect}`, so knowing it changes nothing."
    return "\n".join(lines)


INDEX = "README.md"
_MAKER = "python -m studies.effect_pages"
_BELOW = "**Trace in a residual:**"
_REMEDY = "**What to do:**"


def page_texts() -> dict[str, str]:
    """Return the text of every page by its file name: one for each effect, and the index."""
    kinds = {name: kind for name, kind in CATALOGUE.items() if name in PICTURES}
    pages = {f"{name}.md": effect_text(kind, PICTURES[name].values) for name, kind in kinds.items()}
    return {**pages, INDEX: index_text(kinds)}


def effect_text(kind: type[Effect], values: Mapping[str, float]) -> str:
    """Return the page of one effect."""
    drawn = kind().with_values(values)
    sizes = ", ".join(f"`{name}` = {value:.6g}" for name, value in drawn.values.items())
    picture = (
        f"![{kind.name} on an experiment that shows it]({kind.name}.png)\n\n"
        f"*The plant {PLANT} with {sizes}, without noise ([more about the pictures]({INDEX}#pictures)).*\n\n"
    )
    text = page(kind, level=1)
    text = text.replace(_BELOW, picture + _BELOW, 1)
    text = text.replace(_REMEDY, f"{tracking_text(kind.name)}\n\n{_REMEDY}", 1)
    for name in kind.mistaken_for:
        text = text.replace(f"`{name}`", f"[`{name}`]({name}.md)")
    source = kind.__module__.replace(".", "/") + ".py"
    return (
        f"{text}\n[All effects]({INDEX}). Made from [`{source}`](../../{source}) by `{_MAKER}`.\n"
    )


def index_text(kinds: Mapping[str, type[Effect]]) -> str:
    """Return the index."""
    lines = [
        "# Effects",
        "",
        "The physical effects that a plant can have, in the order of its chain. `rdpi effects` prints "
        "them, `rdpi diagnose` looks for them, and [one of your own](../own-effect.md) is one file more.",
    ]
    places: dict[str, list[type[Effect]]] = {}
    for kind in kinds.values():
        places.setdefault(PLACES[kind.slot], []).append(kind)
    for place, members in places.items():
        lines += [
            "",
            f"## Acts {place}",
            "",
            table(
                ["effect", "trace in a residual", "best experiment"],
                [[f"[`{k.name}`]({k.name}.md)", k.signature, k.experiment] for k in members],
                rule="tight",
            ),
        ]
    lines += [
        "",
        "## Pictures",
        "",
        f"Blue is the plant {PLANT} with the effect, grey the plant without it, on the experiment of the "
        "standard protocol that shows the effect best. *What a refit leaves* is the part that the bare model cannot "
        "take up once it has been fitted to the whole protocol: less than the effect itself, and of another shape. "
        "Everything is simulated as `rdpi simulate` does and fitted as `rdpi fit` does, without noise, with an "
        "effect large enough to be seen.",
    ]
    lines += [
        "",
        "## What the table of tracking errors shows",
        "",
        f"RMS error (µm) of `{CONTROLLER}` on {PLANT} with the parameters of the picture, open loop and without noise. "
        "The command is computed beforehand, once by an inverse that holds the plant without the effect and once by "
        "one that holds the plant itself. The sine has 50 Hz, 30 µm and 0.05 ms between samples, and is scored "
        "from its third period on; the staircase goes to 20, -10, 30, -30 and 0 µm in steps of 10 s with rises of 0.1 s, "
        "at 1 ms, and is scored as a whole. The rate is low-passed at 800 Hz as in the benchmark. What is left without the effect "
        "is the inverse's own error: it takes the rate of the reference for that of the command. The displacement scored is the one that the effect acts on, so for a sensor's lag it is the reading. All rows: "
        "[`studies/results/effect_tracking.csv`](../../studies/results/effect_tracking.csv).",
    ]
    lines += ["", f"Made from the effects' files by `{_MAKER}`.", ""]
    return "\n".join(lines)


def _files(options: Namespace) -> Files:
    if not options.text_only:
        write_atomic(TABLE, tracking_table().to_csv(index=False, float_format="%.6g"))
    files: dict[str, str | bytes] = dict(page_texts())
    if not options.text_only:
        without = bare_records()
        with progress_bar() as show:
            for number, name in enumerate(PICTURES):
                show("drawing", number, len(PICTURES))
                files[f"{name}.png"] = effect_picture(name, without)
    return files


def _more(options: Options) -> None:
    meaning = "pages alone, from the committed table of tracking errors"
    options.add_argument("--text-only", action="store_true", help=meaning)


main = Study("effect_pages", __doc__, _files, OUT, more=_more)

if __name__ == "__main__":
    sys.exit(main())
