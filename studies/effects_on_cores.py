"""Results of the search on hysteresis of any kind: `python -m studies.effects_on_cores --seed 1`.

Plants of every kind, bare or with one effect, move through loops, a chirp and, held out, loops within
loops. The effects are those of the second study of hidden effects: in forms that the catalogue does
not begin with, made on a fine grid by code of their own, and large enough to show. Noise is a
three-thousandth of the stroke. The search is asked as a user would, without options. An interrupted
run continues.
"""

from __future__ import annotations

import sys
import time
import zlib
from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.effect_discovery.forms import (
    CORE,
    FORMS,
    Form,
    Grid,
    Mechanism,
    Scale,
    UnfitError,
    mechanism,
)
from benchmarks.effect_discovery.protocols import smooth
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.measurement.record import Role
from rdpi_gym.plant import CORES
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.signals.experiments import PAUSE_S
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.store import Row
from rdpi_gym.virtual_lab.dataset import core_deformation
from studies.kind_choice import draw_core
from studies.runner import Files, Study, study_rows

RESULTS = Path(__file__).parent / "results" / "effects_on_cores"
AROUND: tuple[Form, ...] = tuple(form for form in FORMS if form.place != CORE)
"""Forms that stand before or behind the hysteresis."""
_NOISE = 3e-4
_TS_S, _SAMPLES, _PARTS = 2e-3, 2500, 4
# Noise floors that an effect moves the displacement by, and how its size is found.
_SHOWS, _ATTEMPTS, _STEPS = (30.0, 120.0), 12, (0.3, 4.0)
_REDRAWS = 20
_ROOMS = ("plant", "signals", "measurement", "identification", "diagnosis", "virtual_lab")


@dataclass(frozen=True)
class Case:
    """One plant: its kind, whether an effect is hidden in it, its number and the seed."""

    kind: str
    hides: bool
    number: int
    seed: int

    @property
    def key(self) -> str:
        """Name of the case in the store."""
        return (
            f"{self.kind}/{'one effect' if self.hides else 'none'}/{self.number}/seed {self.seed}"
        )


def cases(per: int, seed: int) -> list[Case]:
    """Return `per` bare plants and `per` with an effect of each kind: any beginning is a fair sample."""
    return [
        Case(kind, (place + half) % 2 == 1, number, seed)
        for number in range(per)
        for half in range(2)
        for place, kind in enumerate(CORES)
    ]


def drawn(case: Case) -> tuple[Core, Mechanism | None, Dataset]:
    """Draw a plant and what is hidden in it, and take its records."""
    stream = zlib.crc32(case.key.encode())
    for redraw in range(_REDRAWS):
        rng = np.random.default_rng([stream, redraw])
        core, drives = draw_core(CORES[case.kind], rng), _drives()
        bare = _displacements(core, drives, None)
        noise_um = _NOISE * max(float(np.ptp(y)) for y in bare)
        hidden = None
        if case.hides:
            form = AROUND[int(rng.integers(len(AROUND)))]
            hidden = _visible_effect(core, drives, bare, form, noise_um, rng)
            if hidden is None:
                continue
        records = []
        for (name, fine), begins, y in zip(
            drives.items(), _begins(drives), _displacements(core, drives, hidden), strict=True
        ):
            role: Role = "validation" if name == "nested" else "train"
            t = begins + _TS_S * np.arange(_SAMPLES, dtype=np.float64)
            noisy = y + noise_um * rng.standard_normal(_SAMPLES)
            records.append(Record(name, t, fine[::_PARTS], noisy, ts_s=_TS_S, role=role))
        return core, hidden, Dataset(case.key, tuple(records))
    raise InputError(f"{case.key}: no effect shows")


def _drives() -> dict[str, Array]:
    """Commands (V) on the fine grid, by record."""
    end_s = _TS_S * (_SAMPLES - 1)
    curves: dict[str, Callable[[Array], Array]] = {
        "loops": lambda t: (
            24.0 * np.sin(np.pi * t / end_s)
            * (np.sin(2 * np.pi * 0.9 * t) + 0.35 * np.sin(2 * np.pi * 4.7 * t + 1.0))
        ),
        "chirp": lambda t: 20.0 * np.sin(2 * np.pi * (0.5 * t + 0.7 * t**2)),
        "nested": lambda t: 12.0 * np.sin(2 * np.pi * 0.4 * t) + 9.0 * np.sin(2 * np.pi * 2.9 * t),
    }  # fmt: skip
    return {name: smooth(curve, _SAMPLES, _TS_S, _PARTS) for name, curve in curves.items()}


def _begins(drives: dict[str, Array]) -> list[float]:
    return [k * (_TS_S * _SAMPLES + PAUSE_S) for k in range(len(drives))]


def _displacements(core: Core, drives: dict[str, Array], hidden: Mechanism | None) -> list[Array]:
    """Displacement at the samples (µm), without noise, by record."""
    found = []
    for begins, u in zip(_begins(drives), drives.values(), strict=True):
        step_s = _TS_S / _PARTS
        at = Grid(begins + step_s * np.arange(u.size, dtype=np.float64), step_s)
        x = _passed(hidden, u, at) if hidden is not None and hidden.form.place < CORE else u
        x = core_deformation(core, step_s, _PARTS)(x)
        x = _passed(hidden, x, at) if hidden is not None and hidden.form.place > CORE else x
        found.append(x[::_PARTS])
    return found


def _passed(hidden: Mechanism, x: Array, at: Grid) -> Array:
    assert hidden.form.apply is not None
    return hidden.form.apply(x, at, hidden.numbers)


def _visible_effect(
    core: Core,
    drives: dict[str, Array],
    bare: Sequence[Array],
    form: Form,
    noise_um: float,
    rng: np.random.Generator,
) -> Mechanism | None:
    """Return a form of a size that shows; None where no size does."""
    stroke = 0.5 * max(float(np.ptp(y)) for y in bare)
    spans = [0.5 * float(np.ptp(u)) for u in drives.values()]
    fastest = max(float(np.quantile(np.abs(np.diff(u)), 0.99)) for u in drives.values())
    length, rate = _TS_S * _SAMPLES, fastest * _PARTS / _TS_S
    total = _begins(drives)[-1] + length
    scale = Scale(0.0, max(spans), stroke, rate, _TS_S, _TS_S, length, total, False, False)
    low, high = np.log(_SHOWS)
    wanted, seed = float(np.exp(rng.uniform(low, high))), int(rng.integers(2**31))
    size = 1.0
    for _ in range(_ATTEMPTS):
        try:
            made = mechanism(form, scale, seed, size)
        except UnfitError:
            return None
        moved = _displacements(core, drives, made)
        floors = max(float(np.std(m - b)) for m, b in zip(moved, bare, strict=True)) / noise_um
        if 0.5 * wanted <= floors <= 2.0 * wanted:
            return made
        size *= float(np.clip(wanted / max(floors, 1e-9), *_STEPS))
    return None


def run_case(case: Case, code: str) -> Row:
    """Search on one plant and return the row."""
    row: Row = {"key": case.key, "code": code, "kind": case.kind, "hides": case.hides}
    try:
        _, hidden, data = drawn(case)
        row |= {
            "effect": hidden.effect if hidden else "",
            "form": hidden.form.form if hidden else "",
        }
        began = time.process_time()
        found = discover(data, seed=case.seed)
    except InputError as error:
        return row | {"status": "failed", "error": str(error)}
    seconds = time.process_time() - began
    first = found.named[0] if found.named else None
    names = (first.effect, *first.indistinguishable) if first else ()
    return row | {
        "status": "done",
        "chosen": found.core.kind,
        "alike": list(found.core.alike),
        "exact": found.core.kind == case.kind,
        "right": case.kind in (found.core.kind, *found.core.alike),
        "added": [step.effect for step in found.named],
        "first": row["effect"] in names if case.hides else first is None,
        "verdict": found.verdict,
        "floors": found.final.validation_rmse_um / max(found.noise_floor_um, 1e-300),
        "seconds": seconds,
    }


def _files(chosen: Namespace) -> Files:
    rows = study_rows(cases(chosen.per, chosen.seed), run_case, chosen, _ROOMS, [Path(__file__)])
    return {"effects_on_cores.md": report(rows, chosen.per, chosen.seed)}


def report(rows: Sequence[Row], per: int, seed: int) -> str:
    """Return the tables as Markdown."""
    done = [row for row in rows if row["status"] == "done"]
    single, none = ([r for r in done if r["hides"] is hides] for hides in (True, False))
    failed, every = len(rows) - len(done), len(cases(per, seed))
    so_far = f"The first {len(rows)} of {every} plants. " if len(rows) < every else ""
    lines = (
        f"{so_far}The kind is named, or stands among those said to be alike, in {_share(done, 'right')}. "
        f"The effect that is hidden comes first in {_share(single, 'first')}; nothing is added to "
        f"{_share(none, 'first')} bare plants.{f' {failed} failed.' if failed else ''}"
    )
    columns: dict[str, Callable[[Row], Any]] = {
        "kind": lambda r: r["kind"],
        "hidden": lambda r: f"{r['effect']} ({r['form']})" if r.get("form") else r["effect"],
        "kind found": lambda r: ", ".join((r["chosen"], *r["alike"])),
        "added": lambda r: ", ".join(r["added"]),
        "verdict": lambda r: r["verdict"],
        "noise floors left": lambda r: round(r["floors"], 2),
        "seconds": lambda r: round(r["seconds"], 1),
    }
    frame = pd.DataFrame([{name: of(row) for name, of in columns.items()} for row in done])
    return (
        f"# The search on every kind of hysteresis\n\n{lines}\n\n{frame_table(frame)}\n\n"
        f"Made by `python -m studies.effects_on_cores --per {per} --seed {seed}`.\n"
    )


def _share(rows: Sequence[Row], of: str) -> str:
    return f"{sum(bool(row[of]) for row in rows)} of {len(rows)}"


_MEANING = "bare plants, and plants with an effect, of each kind"
main = Study("effects_on_cores", __doc__, _files, RESULTS, 1, 1, numbers=(("--per", 1, _MEANING),))

if __name__ == "__main__":
    sys.exit(main())
