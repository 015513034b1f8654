"""Share of right choices of the kind of hysteresis: `python -m studies.kind_choice --seed 1`.

Plants of every kind, with gains and shapes drawn at random, bare or with one effect, go through the
standard protocol or through two records of another one (loops within loops, a chirp). Noise is a
three-thousandth of the stroke. `rg.choose_kind` is right where it names the kind or lists it among
those that the records do not tell apart; it is falsely sure where it does neither.

With `--silence 100` as many bare plants of RDPI are asked whether a search prefers another core: by
default, before effects are named and at the end, and where it is told to choose (`--core auto`).

An interrupted run continues.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.diagnosis.search.plants import AUTO
from rdpi_gym.identification.kinds import choose_kind
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.measurement.record import Role
from rdpi_gym.plant import CORES, RDPI, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.signals.experiments import PAUSE_S
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.store import Row
from rdpi_gym.virtual_lab.dataset import Truth, plant_displacement, simulate_dataset
from studies.runner import Files, Study, study_rows

RESULTS = Path(__file__).parent / "results" / "kind_choice"
PROTOCOLS = ("standard", "loops and a chirp")
# Effects around the core, in the simplest form: those inside it are the RDPI model's own.
AROUND = (
    "actuator_lag", "backlash", "creep", "delay", "gain_drift", "mains_hum", "resonance",
    "sensor_lag", "thermal_drift",
)  # fmt: skip
_NOISE = 3e-4
_ROOMS = ("plant", "signals", "measurement", "identification", "virtual_lab")
_SCALE = DataScale(
    centre_V=0.0, span_V=30.0, stroke_um=20.0, fastest_V_s=400.0, shortest_s=1e-3, longest_s=4.0
)


@dataclass(frozen=True)
class Case:
    """One plant: its kind, its effect (or none), its protocol, its number and the seed."""

    kind: str
    effect: str
    protocol: str
    number: int
    seed: int

    @property
    def key(self) -> str:
        """Key of the case in a store."""
        return f"{self.kind}/{self.effect or 'bare'}/{self.protocol}/{self.number}/seed {self.seed}"


def cases(per: int, seed: int) -> list[Case]:
    """Return the plants: of each kind `per` bare ones and `per` with an effect, protocols in turn.

    Any beginning is a fair sample.
    """
    found = []
    for number in range(per):
        for half in range(2):
            for place, kind in enumerate(CORES):
                protocol = PROTOCOLS[(place + number) % len(PROTOCOLS)]
                effect = AROUND[(3 * place + number) % len(AROUND)]
                hides = (place + half) % 2 == 1
                found.append(Case(kind, effect if hides else "", protocol, number, seed))
    return found


def quiet_cases(plants: int, seed: int) -> list[Case]:
    """Return bare plants of RDPI, protocols in turn."""
    return [Case(RDPI.name, "", PROTOCOLS[n % len(PROTOCOLS)], n, seed) for n in range(plants)]


def drawn(case: Case) -> tuple[PlantModel[Any], Dataset]:
    """Draw the plant of a case and take its records."""
    kinds, effects = list(CORES), ["", *AROUND]
    words = (case.seed, kinds.index(case.kind), effects.index(case.effect), case.number)
    rng = np.random.default_rng(words)
    core = draw_core(CORES[case.kind], rng)
    own: tuple[Effect, ...] = (CATALOGUE[case.effect](),) if case.effect else ()
    plant: PlantModel[Any] = PlantModel(core, case.kind, (-30.0, 30.0), (0.0, 8.0), effects=own)
    if case.protocol == PROTOCOLS[0]:
        noise_um = _NOISE * 2.0 * plant.reference_um[1]
        truth = Truth(plant, (), noise_um=noise_um, seed=case.number, ts_factor=4.0)
        return plant, simulate_dataset(truth)
    return plant, Dataset(case.key, tuple(_records(plant, rng)))


def draw_core(kind: type[Core], rng: np.random.Generator) -> Core:
    """Draw a core of a kind for commands of 30 V either way: one of its starts, every number changed."""
    starts = kind.starts(_SCALE)
    core = starts[int(rng.integers(len(starts)))]
    shape = {p.name: float(getattr(core, p.name)) for p in core.shape if not p.fixed}
    core = core.with_shape({name: value * rng.uniform(0.6, 1.6) for name, value in shape.items()})
    gains = np.array(core.gains) * rng.uniform(0.3, 1.7, len(core.gains))
    return core.with_gains(gains.tolist())


def _records(plant: PlantModel[Any], rng: np.random.Generator) -> list[Record]:
    ts_s = 2e-3
    t: Array = ts_s * np.arange(5000, dtype=np.float64)
    swell = np.sin(np.pi * t / t[-1])
    loops = 24.0 * swell * (np.sin(2 * np.pi * 0.7 * t) + 0.35 * np.sin(2 * np.pi * 3.9 * t + 1.0))
    chirp = 20.0 * np.sin(2 * np.pi * (0.3 * t + 0.35 * t**2))
    nested = 12.0 * np.sin(2 * np.pi * 0.2 * t) + 9.0 * np.sin(2 * np.pi * 2.3 * t)
    found: list[Record] = []
    begins = 0.0
    for name, u in (("loops", loops), ("chirp", chirp), ("validation", nested)):
        clock: Array = begins + t
        y = plant_displacement(plant, list(plant.effects), clock, u)
        noise = _NOISE * float(np.ptp(y)) * rng.standard_normal(len(t))
        role: Role = "validation" if name == "validation" else "train"
        found.append(Record(name, clock, u, y + noise, ts_s=ts_s, role=role))
        begins += float(t[-1]) + PAUSE_S
    return found


def run_case(case: Case, code: str) -> Row:
    """Choose the kind of one plant and return the row."""
    row: Row = {
        "key": case.key,
        "code": code,
        "kind": case.kind,
        "effect": case.effect,
        "protocol": case.protocol,
    }
    began = time.process_time()
    try:
        _, data = drawn(case)
        found = choose_kind(data)
    except InputError as error:
        return row | {"status": "failed", "error": str(error)}
    chosen = found.chosen.plant.hysteresis.name
    return row | {
        "status": "done",
        "chosen": chosen,
        "alike": list(found.alike),
        "right": case.kind in (chosen, *found.alike),
        "exact": case.kind == chosen,
        "sure": not found.alike,
        "seconds": time.process_time() - began,
    }


def run_quiet(case: Case, code: str) -> Row:
    """Ask searches of one plant without effects which core they take, unasked and told to choose."""
    row: Row = {"key": case.key, "code": code, "protocol": case.protocol}
    began = time.process_time()
    try:
        _, data = drawn(case)
        kind = discover(data, seed=case.seed).core.kind
        told = discover(data, catalogue={}, seed=case.seed, core=AUTO).core
    except InputError as error:
        return row | {"status": "failed", "error": str(error)}
    return row | {
        "status": "done",
        "chosen": kind,
        "told": told.kind,
        "alike": list(told.alike),
        "seconds": time.process_time() - began,
    }


def _files(chosen: Namespace) -> Files:
    if chosen.silence:
        chosen.out /= "silence"
        asked = quiet_cases(chosen.silence, chosen.seed)
        rows = study_rows(asked, run_quiet, chosen, (*_ROOMS, "diagnosis"), [Path(__file__)])
        return {"silence.md": silence_report(rows, chosen.seed)}
    rows = study_rows(cases(chosen.per, chosen.seed), run_case, chosen, _ROOMS, [Path(__file__)])
    return {"kind_choice.md": report(rows, chosen.per, chosen.seed)}


def report(rows: Sequence[Row], per: int, seed: int) -> str:
    """Return the tables as Markdown."""
    frame = pd.DataFrame([row for row in rows if row["status"] == "done"])
    failed = sum(row["status"] != "done" for row in rows)
    frame["with"] = ["an effect" if effect else "none" for effect in frame["effect"]]
    frame["names"] = [1 + len(alike) for alike in frame["alike"]]
    grouped = frame.groupby(["kind", "with"])
    table = grouped.agg(
        plants=("right", "size"), right=("right", "sum"), exact=("exact", "sum"),
        names=("names", "mean"), seconds=("seconds", "median"),
    ).reset_index()  # fmt: skip
    taken = (
        frame[~frame["right"]]
        .groupby("kind")["chosen"]
        .agg(lambda names: ", ".join(sorted(set(names))))
    )
    table["taken for"] = [taken.get(kind, "") for kind in table["kind"]]
    right, wrong = int(frame["right"].sum()), int((~frame["right"] & frame["sure"]).sum())
    failures = f" {failed} failed." if failed else ""
    every = len(cases(per, seed))
    so_far = f"The first {len(rows)} of {every} plants. " if len(rows) < every else ""
    return (
        "# Which kind of hysteresis?\n\n"
        f"{so_far}The kind is named, or stands among those said to be alike, in {right} of {len(frame)} "
        f"({100 * right / len(frame):.0f} %); a wrong kind is named alone in {wrong}.{failures} "
        f"{frame['names'].mean():.1f} names a plant.\n\n"
        f"{frame_table(table.round(1))}\n\nMade by `python -m studies.kind_choice --per {per} --seed {seed}`.\n"
    )


def silence_report(rows: Sequence[Row], seed: int) -> str:
    """Return the table of plants of RDPI without effects as Markdown."""
    frame = pd.DataFrame([row for row in rows if row["status"] == "done"])
    failed = sum(row["status"] != "done" for row in rows)
    frame["silent"] = frame["chosen"] == RDPI.name
    frame["rdpi named"] = frame["told"] == RDPI.name
    frame["rdpi among the names"] = [
        RDPI.name in (told, *alike)
        for told, alike in zip(frame["told"], frame["alike"], strict=True)
    ]
    frame["names"] = [1 + len(alike) for alike in frame["alike"]]
    table = frame.groupby("protocol").agg(
        plants=("silent", "size"), silent=("silent", "sum"),
        **{name: (name, "sum") for name in ("rdpi named", "rdpi among the names")},
        names=("names", "mean"), seconds=("seconds", "median"),
    ).reset_index()  # fmt: skip
    failures = f" {failed} failed." if failed else ""
    return (
        "# Is another core preferred where RDPI is right?\n\n"
        f"No other core is preferred on {frame['silent'].sum()} of {len(frame)} plants of RDPI without "
        "effects; told to choose (`--core auto`), the\n"
        f"search names RDPI on {frame['rdpi named'].sum()}, and lists it among those that it does not tell "
        f"apart on {frame['rdpi among the names'].sum()}.{failures}\n\n"
        f"{frame_table(table.round(1))}\n\nMade by `python -m studies.kind_choice --silence {len(rows)} --seed {seed}`.\n"
    )


def _more(options: Options) -> None:
    options.add_number("--silence", 0, "bare plants of RDPI, in place of all kinds", least=0)


_MEANING = "bare plants, and plants with an effect, of each kind"
main = Study("kind_choice", __doc__, _files, RESULTS, 1, 2, (("--per", 15, _MEANING),), more=_more)

if __name__ == "__main__":
    sys.exit(main())
