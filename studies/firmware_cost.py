"""Cost of generated code on a microcontroller: bytes, instructions of a step, distance from Python.

    python -m studies.firmware_cost

Controllers and plants are exported, compiled for a Cortex-M4F and a Cortex-M0+, the largest for a
Cortex-M7, at -O2 and -Os in double, float and, where they have it, Q31, and run over the vectors of their folder in QEMU, whose
clock goes by instructions. A loop of known length is counted along.
"""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from rdpi_gym.firmware.making import package_of
from rdpi_gym.firmware.writing.source import Source
from rdpi_gym.firmware.writing.vectors import SAMPLES
from rdpi_gym.plant import P10, PlantModel
from rdpi_gym.plant.effects import Effect, load_effect
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from studies.bare_metal import BOARDS, COMPILER, EMULATOR, cost, missing, write_sources
from studies.runner import Files, Study, names_of

RESULTS = Path(__file__).parent / "results"
TS_S = 5e-5
ASKED = {"code_bytes": 4096, "state_bytes": 512, "most_instructions": 1500}
"""Limits of a compensator of ten plays in float on the M4F."""
_CONTROLLERS = (
    "none", "classical-reference-rate", "classical-low-passed", "inversion-free-reference-rate",
    "static-inverse-multiplicative", "pi", "pi-classical-reference-rate", "core-inverse",
    "integral-resonant", "smith-predictor", "lqg-preview", "adaptive-feedforward",
    "model-predictive",
)  # fmt: skip
_BANK, _STUDENT = "adaptive-core-bank, 100 µs", "learned:imitation-stage, 100 µs"
"""Programs that ask for a Cortex-M7, whose unit computes in double: 48,000 cycles of 480 MHz a sample."""
_OPTIONS = ("-O2", "-Os")
# A network's steps are so much longer.
_LONGER = 20
_PRECISIONS = {64: "double", 32: "float", 31: "Q31"}


def stage() -> PlantModel[Any]:
    """Return P10 with creep, a resonance, a sensor's lag and a delay."""
    effect: Callable[[str], Callable[..., Effect]] = load_effect
    effects = (
        effect("creep")(),
        effect("resonance")(f0_hz=739.0, damping=0.03),
        effect("sensor_lag")(1.5e-4),
        effect("delay")(delay_s=1e-4),
    )
    return dataclasses.replace(P10, name="P10 with four effects", effects=effects)


def cases() -> Mapping[str, Callable[[], Source]]:
    """Return what is exported, by what the table calls it."""

    def made(model: PlantModel[Any], name: str | None, ts_s: float = TS_S) -> Callable[[], Source]:
        return lambda: package_of(model, ts_s, name).source

    found = {name: made(P10, name) for name in _CONTROLLERS}
    found["extended-inverse, four effects"] = made(stage(), "extended-inverse")
    found[_STUDENT] = made(P10, "learned:imitation-stage", 2.0 * TS_S)
    found[_BANK] = made(P10, "adaptive-core-bank", 2.0 * TS_S)
    found["plant P10"] = made(P10, None)
    found["plant, four effects"] = made(stage(), None)
    return found


def measure(
    names: Sequence[str] | None = None, samples: int = SAMPLES
) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return the costs, and why there are none by case."""
    tool = missing()
    if tool is not None:
        raise InputError(f"{tool} is not installed; apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm")  # fmt: skip
    rows: list[dict[str, Any]] = []
    without: dict[str, str] = {}
    known = cases()
    for name in known if names is None else names:
        print(name, file=sys.stderr)
        try:
            source = known[name]()
        except InputError as error:
            without[name] = str(error)
            continue
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            write_sources(source, folder, samples // _LONGER if "learned:" in name else samples)
            for board in ("M7",) if name in (_BANK, _STUDENT) else ("M4F", "M0+"):
                for precision in source.precisions:
                    for option in _OPTIONS:
                        what = {"program": name, "core": board, "numbers": _PRECISIONS[precision], "option": option}  # fmt: skip
                        try:
                            found = cost(source, folder, BOARDS[board], precision, option)
                        except InputError as error:
                            without[", ".join(what.values())] = str(error)
                            continue
                        rows.append({**what, **dataclasses.asdict(found)})
    return pd.DataFrame(rows), without


def as_markdown(table: pd.DataFrame, without: Mapping[str, str], samples: int) -> str:
    """Return the tables with what was measured and how."""
    lines = ["# What generated code costs on a microcontroller", ""]
    ten_plays = table[
        (table["core"] == "M4F")
        & (table["numbers"] == "float")
        & (table["program"] == "classical-reference-rate")
    ]
    if not ten_plays.empty:
        most = ten_plays.max(numeric_only=True)
        said = (f"{most[key]:.0f} {_ASKED[key]} of {limit} allowed" for key, limit in ASKED.items())
        lines += [
            f"A classical compensator of ten plays in float on a Cortex-M4F: {', '.join(said)}.",
            "",
        ]
    lines += [
        "Written by `python -m studies.firmware_cost`: each program is compiled by "
        f"{_version(COMPILER)} without a warning and runs {samples} vectors as its folder has them in "
        f"{_version(EMULATOR)}, whose clock goes by instructions; a loop of 2,000 is counted along. "
        "Instructions are of a step with its acknowledgement, the mean and the most; cycles are more. "
        "Code and constants are of the object, linked is with what they need of the compiler's "
        "libraries (software floating point, mathematics); state is an instance, with the memory that "
        "waits to be acknowledged. `away` is the largest difference from Python as a fraction of the "
        "command range, of a plant's stroke; 0: bit-equal. The M0+ has no floating-point unit, the M4F "
        f"one for float, the M7 one for double too. Sampling time {TS_S:g} s. A network runs a twentieth of the vectors.",
        "",
    ]
    for board, kind in BOARDS.items():
        rows = table[(table["core"] == board) & (table["option"] == "-O2")]
        if rows.empty:
            continue
        shown = rows.drop(columns=["core", "option"]).rename(columns=_WORDS)
        for name in ("instructions", "at most"):
            shown[name] = shown[name].round().astype(int)
        lines += [f"## {kind.core}, -O2", "", frame_table(shown), ""]
    if without:
        lines += ["## Without", "", *(f"- {name}: {why}" for name, why in without.items()), ""]
    return "\n".join(lines)


_WORDS = {
    "code_bytes": "bytes of code", "constant_bytes": "of constants", "linked_bytes": "linked",
    "state_bytes": "bytes of state", "instructions": "instructions", "most_instructions": "at most",
}  # fmt: skip

_ASKED = {
    "code_bytes": "bytes of code", "state_bytes": "bytes of state",
    "most_instructions": "instructions a step",
}  # fmt: skip


def _version(tool: str) -> str:
    said = subprocess.run([tool, "--version"], capture_output=True, text=True, check=True).stdout
    return said.splitlines()[0]


def _measure_all(chosen: Namespace) -> Files:
    names = names_of("program", chosen.only or (), cases())
    table, without = measure(names, chosen.samples)
    if table.empty:
        raise InputError("; ".join(f"{name}: {why}" for name, why in without.items()))
    known = chosen.out / "firmware_cost.csv"
    if chosen.only and known.exists() and known.with_suffix(".md").exists():
        kept = pd.read_csv(known).query("program not in @names")
        others = re.findall(r"^- (.*?): (.*)$", known.with_suffix(".md").read_text(), re.MULTILINE)
        without |= {name: why for name, why in others if name.split(", M")[0] not in names}
        order = {name: place for place, name in enumerate(cases())}
        table = pd.concat([kept, table], ignore_index=True)
        table = table.sort_values("program", key=lambda own: own.map(order), kind="stable")
    text = as_markdown(table, without, chosen.samples)
    return {"firmware_cost.csv": table, "firmware_cost.md": text}


def _more(options: Options) -> None:
    options.add_number("--samples", SAMPLES, "of the vectors", least=_LONGER)
    options.add_argument(
        "--only",
        nargs="+",
        metavar="PROGRAM",
        help="programs whose rows are measured again; all by default",
    )


main = Study("firmware_cost", __doc__, _measure_all, RESULTS, more=_more, csv="%.6g")

if __name__ == "__main__":
    sys.exit(main())
