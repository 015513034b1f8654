"""Generated code on a microcontroller without one: boards that QEMU emulates, and the cost of code on them."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from rdpi_gym.firmware.writing.source import Source, header_text, source_text
from rdpi_gym.firmware.writing.vectors import SAMPLES, vectors, vectors_text
from rdpi_gym.support.errors import InputError

HERE = Path(__file__).parent
COMPILER, EMULATOR = "arm-none-eabi-gcc", "qemu-system-arm"
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion",
          "-Werror")  # fmt: skip
# An instruction takes 2^6 ns of the emulator's time, more than a tick of any timer.
_SHIFT = 6
_LIMIT_S = 120
# Status of start.c after a fault.
_FAULT = 3


@dataclass(frozen=True)
class Board:
    """One of QEMU's boards."""

    core: str  # its processor, for people
    machine: str  # QEMU's name of it
    flags: Sequence[str]  # of the compiler, for its processor
    # sizes of its memories, as the linker takes them
    code: str
    data: str
    clock_hz: int  # of its system timer

    def instructions(self, ticks: float) -> float:
        """Return the instructions that its system timer counted."""
        return ticks * 1e9 / self.clock_hz / (1 << _SHIFT)


BOARDS: Mapping[str, Board] = {
    "M4F": Board(
        "Cortex-M4F", "mps2-an386",
        ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"), "4M", "4M", 25_000_000,
    ),
    "M7": Board(
        "Cortex-M7", "mps2-an500",
        ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard"), "4M", "4M", 25_000_000,
    ),
    "M0+": Board(
        "Cortex-M0+", "microbit", ("-mcpu=cortex-m0plus", "-mthumb"), "256K", "16K", 16_000_000
    ),
}  # fmt: skip
"""Boards by a short name; the emulator has the Cortex-M0, whose instructions are those of the M0+."""


@cache
def missing() -> str | None:
    """Return the tool that is not installed; None where all are."""
    for tool in (COMPILER, EMULATOR):
        if shutil.which(tool) is None:
            return tool
    # Without the C library the compiler answers with the name alone.
    specs = _ran([COMPILER, "-print-file-name=rdimon.specs"]).stdout.strip()
    return None if Path(specs).is_absolute() else "libnewlib-arm-none-eabi"


def object_of(board: Board, source: Path, target: Path, options: Sequence[str] = ()) -> Path:
    """Compile one file without a warning, and return the object."""
    return _compiled(board, [*STRICT, *options, "-c", str(source)], target)


def program_of(
    board: Board, sources: Sequence[Path], target: Path, options: Sequence[str] = ()
) -> Path:
    """Compile and link what the board runs, and return it."""
    sizes = (f"-Wl,--defsym=code_size={board.code}", f"-Wl,--defsym=data_size={board.data}")
    own = ["--specs=rdimon.specs", "-T", str(HERE / "link.ld"), *sizes, str(HERE / "start.c")]
    return _compiled(board, [*options, *own, *map(str, sources), "-lm"], target)


def linked_alone(board: Board, thing: Path, entries: Sequence[str], target: Path) -> Path:
    """Link an object with what its functions need of libraries, and nothing else."""
    wanted = [f"-Wl,-u,{entry}" for entry in entries]
    alone = ["-nostartfiles", "-Wl,--gc-sections", f"-Wl,-e,{entries[0]}", *wanted]
    return _compiled(board, [*alone, str(thing), "-lm"], target)


def ran(board: Board, program: Path) -> str:
    """Run a program on the emulated board and return what it prints."""
    done = _ran(
        [
            EMULATOR, "-M", board.machine, "-nographic", "-monitor", "none", "-serial", "none",
            "-semihosting-config", "enable=on,target=native", "-icount", f"shift={_SHIFT}",
            "-kernel", str(program),
        ]
    )  # fmt: skip
    if done.returncode == _FAULT:
        raise InputError(
            f"{program.name} on {board.core} ends in a fault; {board.data} of data may be too few"
        )
    if done.returncode:
        said = f"{done.stdout} {done.stderr}".strip()[-500:]
        raise InputError(f"{program.name} on {board.core} ends with {done.returncode}: {said}")
    return done.stdout


def sizes(binary: Path) -> dict[str, int]:
    """Return the bytes of code and of constants of an object or a program."""
    done = _ran(["arm-none-eabi-size", "-A", str(binary)])
    found = {"code": 0, "constants": 0}
    for line in done.stdout.splitlines():
        name, size, *_ = [*line.split(), "", ""]
        for kind, start in (("code", ".text"), ("constants", ".rodata")):
            if name.startswith(start):
                found[kind] += int(size)
    return found


def _ran(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=_LIMIT_S,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{command[0]} does not end within {_LIMIT_S} s") from error


def _compiled(board: Board, arguments: Sequence[str], target: Path) -> Path:
    done = _ran([COMPILER, *board.flags, *arguments, "-o", str(target)])
    if done.returncode:
        raise InputError(f"{target.name} for {board.core}: {done.stderr.strip()[:500]}")
    return target


_LOOP = 2000
_ENTRY = {
    "controller": ("init", "step", "acknowledge", "flags"),
    "plant": ("init", "step", "flags"),
}


@dataclass(frozen=True)
class Cost:
    """Cost of one piece of code."""

    # of the object; what it calls of the compiler's library comes on top in `linked_bytes`
    code_bytes: int
    constant_bytes: int
    linked_bytes: int  # code and constants with all that they need of libraries
    state_bytes: int  # of an instance
    # of a step with its acknowledgement: the mean of the vectors, and the most
    instructions: float
    most_instructions: float
    # largest difference from Python as a fraction of the command range, or of the stroke
    away: float


def write_sources(source: Source, folder: Path, samples: int = SAMPLES) -> None:
    """Write header, source and vectors of generated code."""
    made = vectors(source, samples)
    (folder / f"{source.name}.h").write_text(header_text(source), encoding="ascii")
    (folder / f"{source.name}.c").write_text(source_text(source), encoding="ascii")
    (folder / "rdpi_vectors.h").write_text(vectors_text(source, made), encoding="ascii")


def cost(
    source: Source, folder: Path, board: Board, precision: int, optimised: str = "-O2"
) -> Cost:
    """Compile what :func:`write_sources` wrote, run it, and return what it costs."""
    program = source.program
    low, high = program.command_range_V
    span = 2.0 * program.scale_um if program.kind == "plant" else high - low
    options = (
        optimised, "-ffp-contract=off", f"-DRDPI_PRECISION={precision}", f"-DRDPI_SPAN={span!r}",
        f"-I{folder}",
    )  # fmt: skip
    generated = folder / f"{source.name}.c"
    thing = object_of(board, generated, folder / "step.o", options)
    entries = [f"{source.name}_{each}" for each in _ENTRY[program.kind]]
    linked = linked_alone(board, thing, entries, folder / "linked.elf")
    plant = ("-DRDPI_COUNT_PLANT",) if program.kind == "plant" else ()
    whole = program_of(
        board, [generated, HERE / "count.c"], folder / "count.elf", ("-std=gnu99", *options, *plant)
    )
    said = {line.split()[0]: line.split()[1:] for line in ran(board, whole).splitlines()}
    loop = board.instructions(float(said["loop"][0]))
    if abs(loop / _LOOP - 1.0) > 0.01:
        raise InputError(f"{board.core}: a loop of {_LOOP} instructions is counted as {loop:g}")
    steps, most, count = map(float, said["steps"])
    own, all_of_it = sizes(thing), sizes(linked)
    return Cost(
        code_bytes=own["code"],
        constant_bytes=own["constants"],
        linked_bytes=all_of_it["code"] + all_of_it["constants"],
        state_bytes=int(said["state"][0]),
        instructions=board.instructions(steps / count),
        most_instructions=board.instructions(most),
        away=float(said["away"][0]) * 1e-12,
    )
