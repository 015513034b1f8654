"""Boards that QEMU emulates, and what compiles for them and runs on them."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from rdpi_gym.support.errors import InputError

HERE = Path(__file__).parent
COMPILER, EMULATOR = "arm-none-eabi-gcc", "qemu-system-arm"
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion",
          "-Werror")  # fmt: skip
# An instruction takes 2^6 ns of the emulator's time, more than a tick of any timer.
_SHIFT = 6
_LIMIT_S = 120
# What start.c ends with.
_FAULT = 3


@dataclass(frozen=True)
class Board:
    """One of QEMU's boards."""

    core: str  # its processor, for people
    machine: str  # QEMU's name of it
    flags: Sequence[str]  # what the compiler is told of its processor
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
    "M0+": Board(
        "Cortex-M0+", "microbit", ("-mcpu=cortex-m0plus", "-mthumb"), "256K", "16K", 16_000_000
    ),
}  # fmt: skip
"""By a short name; the emulator has the Cortex-M0, whose instructions are those of the M0+."""


@cache
def missing() -> str | None:
    """Return what has to be installed before anything is compiled and run, else None."""
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
