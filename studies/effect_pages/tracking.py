"""Tracking with an effect: the error of an inverse without knowledge of it, and with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from baselines.extended import ExtendedInverse
from benchmarks.tracking.stages import RATE_BANDWIDTH_HZ
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.plant import P10, Plant, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.markdown import table
from studies.effect_pages.study import PICTURES

CONTROLLER = "extended-inverse"
TABLE = Path(__file__).parents[1] / "results" / "effect_tracking.csv"

# The longest look ahead that an inverse takes here is the delay's: 6 samples, and its filter's.
_PREVIEW = 17
_LEVELS_UM = (0.0, 20.0, -10.0, 30.0, -30.0, 0.0)
_HOLD_S, _RISE_S = 10.0, 0.1


@dataclass(frozen=True)
class Reference:
    """A reference to follow.

    Parameters
    ----------
    name
        In words.
    ts_s
        Sampling time (s).
    samples_um
        ``(T,)``.
    first
        Sample at which scoring begins.
    """

    name: str
    ts_s: float
    samples_um: Array
    first: int


@dataclass(frozen=True)
class Tracked:
    """RMS errors (µm) of one effect on one reference.

    Parameters
    ----------
    effect, reference
        Names.
    without_um
        On the plant without the effect.
    unknown_um, known_um
        On the plant with it, where the inverse holds the bare plant, and the plant itself.
    warning
        What the inverse that knows the effect says it cannot undo; empty if nothing.
    """

    effect: str
    reference: str
    without_um: float
    unknown_um: float
    known_um: float
    warning: str


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
    bare = limit_band(P10, RATE_BANDWIDTH_HZ)
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
