"""Cost of generated code on a board: bytes, instructions of a step, distance from Python."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rdpi_gym.firmware.writing.source import Source, header_text, source_text
from rdpi_gym.firmware.writing.vectors import SAMPLES, vectors, vectors_text
from rdpi_gym.support.errors import InputError
from studies.bare_metal.boards import HERE, Board, linked_alone, object_of, program_of, ran, sizes

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
