"""A page and a picture for each effect of the catalogue, made from its file.

The picture shows the plant P10 with the effect on an experiment of the standard protocol, simulated
as `rdpi simulate` does, and what `rdpi fit` leaves of it: `python -m studies.effect_pages`.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Mapping
from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from baselines.extended import ExtendedInverse
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.plant import P10, Plant, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.plant.effects.description import PLACES, page
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.command_line import Options
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.markdown import table
from rdpi_gym.support.progress import progress_bar
from studies.effect_pictures import PICTURES, PLANT, bare_records, effect_picture
from studies.runner import RESULTS, Files, Study

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
