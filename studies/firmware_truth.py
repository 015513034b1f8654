"""Generated C against Python: every controller, every effect and every core, over a million samples each.

    python -m studies.firmware_truth

Each is exported, compiled in every precision it has, and run over random records as `rdpi verify` makes
them, controllers against the ones that a benchmark makes and scores: controllers over a thousand of a thousand samples, plants over ten of a hundred thousand, since
what is slow in them shows late. Differences are in strokes (plants) or
in ranges of the command (controllers).
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd

from baselines.base import Baseline
from baselines.inverses.base import INVERSES
from baselines.lookup import make_controller
from baselines.registry import CONTROLLERS
from benchmarks.tracking.stages import make_stage
from rdpi_gym.envs.tasks.stages import STAGE
from rdpi_gym.firmware.making import ControllerTwin, package_of
from rdpi_gym.firmware.program import Program
from rdpi_gym.firmware.verify import compare
from rdpi_gym.firmware.writing.package import write_package
from rdpi_gym.plant import CORES, P10, PlantModel
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import forms_of
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from studies.runner import Files, Study, names_of

RESULTS = Path(__file__).parent / "results"
TS_S = 1e-4
SAMPLES = 1000
_LONGER = 100
"""Factor by which the records of a plant are longer, and fewer."""
_SCALE = DataScale(0.0, 40.0, 40.0, 2e4, TS_S, 1.0)
_POLICIES = ("ppo-increment", "imitation-stage")


@dataclass(frozen=True)
class Case:
    """One export."""

    group: str  # ``controller``, ``effect`` or ``core``
    name: str  # of it
    model: PlantModel[Any]  # the plant, or what the controller believes
    controller: str | None = None  # its name; None: the plant


def cases() -> Iterator[Case]:
    """Return what is verified."""
    stage = STAGE.nominal()
    plain = P10.with_hysteresis(CORES["duhem"].starts(_SCALE)[0])
    for name, kind in CONTROLLERS.items():
        if not hasattr(getattr(kind, "func", kind), "plan"):
            yield Case("controller", f"{name} on P10", P10, name)
    for name in ("extended-inverse", "pi-extended-inverse", "pi-preview", "integral-resonant",
                 "positive-position", "dual-loop", "smith-predictor", "lqg-preview", "h-infinity",
                 "model-predictive", "adaptive-feedforward", "adaptive-dual-loop", "adaptive-inverse",
                 "hybrid"):  # fmt: skip
        yield Case("controller", f"{name} on a stage", stage, name)
    for name in INVERSES:
        believed = replace(P10, effects=(CATALOGUE[name](),))
        yield Case("controller", f"extended-inverse, {name}", believed, "extended-inverse")
    for policy in _POLICIES:
        belief = stage if policy.endswith("stage") else P10
        yield Case("controller", f"learned:{policy}", belief, f"learned:{policy}")
    for core in CORES:
        model = P10 if core == "rdpi" else P10.with_hysteresis(CORES[core].starts(_SCALE)[0])
        yield Case("core", core, model)
        if core != "rdpi":
            yield Case("controller", f"core-inverse on {core}", model, "core-inverse")
    for name in CATALOGUE:
        for form in forms_of(CATALOGUE[name]):
            # a core without a sum whose order is free, where the effect may stand around one
            model = P10 if not form.fits_in(type(plain.hysteresis)) else plain
            yield Case("effect", form.full_name(), replace(model, effects=(form(),)))


def measure(chosen: Sequence[Case], records: int, seed: int, say: bool = False) -> pd.DataFrame:
    """Verify cases one after the other."""
    rows = []
    for case in chosen:
        row: dict[str, object] = {"group": case.group, "what": case.name}
        try:
            row |= _verified(case, records, seed)
        except InputError as error:
            row |= {"verdict": "no C", "remark": str(error)}
        rows.append(row)
        if say:
            print("  ".join(f"{key} {value}" for key, value in row.items()), flush=True)
    return pd.DataFrame(rows)


def as_scored(program: Program, case: Case) -> Program:
    """Return an exported program beside the controller that a benchmark makes and scores of the same sensor."""
    believed, own = replace(make_stage(case.model).belief, sensor=case.model.sensor), program.twin
    assert isinstance(own, ControllerTwin)
    layout = type(own.made.layout).for_plant(believed, program.ts_s, preview=program.preview)
    made = make_controller(case.controller or "", believed, layout)
    assert isinstance(made, Baseline)
    return replace(program, twin=ControllerTwin(made))


def _verified(case: Case, records: int, seed: int) -> dict[str, object]:
    with TemporaryDirectory(prefix="rdpi-truth-") as folder:
        package = package_of(case.model, TS_S, case.controller)
        written = write_package(package, Path(folder) / "out")
        program, longer = package.source.program, _LONGER
        if case.controller is not None:
            program, longer = as_scored(program, case), 1
        against = replace(package, source=replace(package.source, program=program))
        found = compare(against, written, max(records // longer, 1), SAMPLES * longer, seed)
    by = {row.precision: row for row in found.rows if row.what == "records"}
    wild = [row for row in found.rows if row.what == "wild inputs"]
    return {
        **{name: by[name].largest if name in by else None for name in ("double", "float", "Q31")},
        "bit_by_bit": "yes" if by["double"].largest == 0.0 else "no",
        "wild_stays": "yes" if all(row.passed for row in wild) else "NO",
        "verdict": _worst([row.verdict for row in found.rows]),
        "remark": program.inexact_because,
    }  # fmt: skip


def _worst(verdicts: Sequence[str]) -> str:
    """Return the worst of what is said of a program's comparisons."""
    order = ("ok", "roundings", "decisions", "FAILED")
    return max(verdicts, key=order.index)


def as_markdown(table: pd.DataFrame, records: int, seed: int) -> str:
    """Return the table with what it says, and how it was made."""
    counts = table["verdict"].value_counts()
    sums = ", ".join(f"{count} {name}" for name, count in counts.items())
    exact = int((table["bit_by_bit"] == "yes").sum())
    sections = [
        f"## {group}s\n\n{frame_table(rows.drop(columns='group').astype(object).fillna(''))}\n"
        for group, rows in table.groupby("group", sort=False)
    ]
    return (
        "# Generated C against Python\n\n"
        f"{len(table)} exports: {sums}; {exact} equal bit by bit in double.\n\n"
        f"Written by `python -m studies.firmware_truth --records {records} --seed {seed}`: controllers over {records:,} "
        f"random records of {SAMPLES:,} samples, plants over {max(records // _LONGER, 1):,} of {SAMPLES * _LONGER:,}, Ts "
        f"{TS_S:g} s; differences in strokes (plants) or ranges of "
        "the command (controllers). `roundings`: the loop makes so much of every rounding that two orders "
        "of the same sum part, in Python too (outside its stability limit, or estimating as it runs). `decisions`: in a precision that is "
        "not Python's own, up to a hundredth of the records part where a decision hangs on the last bit, a command "
        "just at its limit for one.\n\n" + "\n".join(sections)
    )


def _files(chosen: Namespace) -> Files:
    every = {case.name: case for case in cases()}
    names = names_of("export", chosen.only or (), every)
    table = measure([every[name] for name in names], chosen.records, chosen.seed, say=True)
    known = chosen.out / "firmware_truth.csv"
    if chosen.only and known.exists():
        table = pd.concat([pd.read_csv(known).query("what not in @names"), table])
        order = {name: place for place, name in enumerate(every)}
        table = table.sort_values("what", key=lambda own: own.map(order), ignore_index=True)
    text = as_markdown(table, chosen.records, chosen.seed)
    return {"firmware_truth.csv": table, "firmware_truth.md": text}


def _more(options: Options) -> None:
    options.add_argument(
        "--only",
        nargs="+",
        metavar="EXPORT",
        help="those that are verified again; all by default",
    )


_MEANING = "of a controller; a plant has a hundredth of them, a hundred times as long"
main = Study(
    "firmware_truth", __doc__, _files, RESULTS, seed=0,
    numbers=(("--records", 1000, _MEANING),), more=_more, csv="%.3g",
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
