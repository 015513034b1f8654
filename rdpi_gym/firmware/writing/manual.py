"""The page that goes with generated code: what it is, how it is built and called, what it costs."""

from __future__ import annotations

from collections.abc import Sequence

from rdpi_gym.firmware.fixed_point import FixedPoint
from rdpi_gym.firmware.writing.counting import Operations, count
from rdpi_gym.firmware.writing.roundings import Roundings
from rdpi_gym.firmware.writing.source import Source, safe
from rdpi_gym.firmware.writing.templating import filled, template
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import table
from rdpi_gym.support.words import number

DEVIATIONS = {
    "2.2": "a step that has no effect for these numbers",
    "2.5": "macros for callers",
    "10.3": "tables hold counts as numbers",
    "10.8": "a sum of counts is made a number",
    "12.1": "precedence of operators as in the Python that was translated",
    "14.4": "flags are whole numbers",
    "15.5": "an input that is no number ends a step at once",
    "17.8": "an argument is changed, as in the Python that was translated",
    "18.4": "a pointer leads into a table",
    "19.2": "the sign of a number is taken from its bits",
}
"""Rules of MISRA C:2012 that the code does not keep, all of them required or advisory, and why."""
_NAMES = {64: "double", 32: "float", 31: "Q31"}
_FOLLOWS = 1e-2
_UNITS = {"controller": "the range of commands", "plant": "the stroke"}
_BYTES = {"int32_t": 4, "uint32_t": 4, "int64_t": 8}


def manual_text(
    source: Source, code: str, warnings: Sequence[str] = (), roundings: Roundings | None = None
) -> str:
    """Return the page."""
    program = source.program
    kind = program.kind
    low, high = program.command_range_V
    roundings = roundings or Roundings()
    limits = {p: f"{each:.0e}" for p, each in roundings.allowed.items()}
    exact = "equal to Python bit by bit in `double`, compiled without contraction"
    if not program.exact:
        why = _plain(program.inexact_because).rstrip(".")
        exact = f"within {limits[64]} of {_UNITS[kind]} of Python in `double` ({why})"
    notes = [*warnings, *program.notes]
    if source.fixed is not None:
        notes += source.fixed.notes
    if roundings.warning is not None:
        notes.insert(
            0, f"{roundings.warning} Look at what it does in float before it drives a stage."
        )
    reach = source.reach_um
    return filled(
        template(f"package/README_{kind}.md"),
        frozenset({"FIXED"} if source.fixed is not None else set())
        | frozenset({"MATH"} if source.has_mathematics else set()),
        TITLE=safe(program.title),
        MODEL=safe(program.model),
        TS=number(program.ts_s, 6),
        AHEAD="sample" if program.preview == 1 else f"{program.preview} samples",
        LOW=f"{low:g}",
        HIGH=f"{high:g}",
        REST=f"{program.rest_V:g}",
        REACH="" if reach is None else f" (slowly, {reach[0]:.4g} to {reach[1]:.4g} µm)",
        EXACT=exact,
        FLOAT=(
            f"within {limits[32]} of {_UNITS[kind]}"
            if roundings.allowed[32] < _FOLLOWS
            else "it does not follow Python (see below): use `double`"
        ),
        WHOLE=limits[31],
        MEMORY=_memory(source),
        OPERATIONS=_operations(source, code),
        SCALES="" if source.fixed is None else _scales(source.fixed),
        DEVIATIONS="; ".join(f"{rule}, {why}" for rule, why in DEVIATIONS.items()),
        NOTES="\n".join(f"- {_plain(note)}" for note in notes) or "- None.",
    )


def state_bytes(source: Source, precision: int) -> tuple[int, int]:
    """Return the bytes of a state and of the parameters, as common compilers lay them out."""
    fixed = source.fixed
    if precision == 31 and fixed is not None:
        memory = [(_BYTES[part.type], len(part.rest)) for part in fixed.memory]
        parameters = [(_BYTES[part.type], len(part.values)) for part in fixed.tables]
    else:
        program = source.program
        memory = [(precision // 8, len(part.rest)) for part in program.memory]
        parameters = [(precision // 8, len(part.values)) for part in program.tables]
    real = 8 if precision == 64 else 4
    inner, aligned = _laid_out(memory or [(1, 1)])
    if source.program.kind == "plant":
        outer, own = _laid_out([(aligned, inner // aligned), (real, 2), (1, 1)])
    else:
        outer, own = _laid_out([(aligned, 2 * inner // aligned), (real, 1), (1, 3)])
    assert own >= real
    return outer, _laid_out(parameters or [(1, 1)])[0]


def _laid_out(fields: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Return size and alignment of a struct of fields (bytes of an element, elements)."""
    at, widest = 0, 1
    for size, length in fields:
        at = -(-at // size) * size + size * length
        widest = max(widest, size)
    return -(-at // widest) * widest, widest


def _memory(source: Source) -> str:
    rows = []
    for precision in source.precisions:
        state, parameters = state_bytes(source, precision)
        rows.append([_NAMES[precision], f"{state:,}", f"{parameters:,}"])
    return table(["precision", "state (bytes)", "parameters (bytes)"], rows, right=[1, 2])


def _operations(source: Source, code: str) -> str:
    rows = []
    for precision in source.precisions:
        try:
            found = count(code, f"{source.name}_step", precision=precision)
        except InputError as error:
            return f"Not counted: {_plain(str(error))}"
        rows.append([_NAMES[precision], *_cells(found, precision)])
    head = [
        "precision",
        "additions",
        "multiplications",
        "comparisons",
        "divisions",
        "calls of math.h",
    ]
    return table(head, rows, right=range(1, len(head)))


def _cells(found: Operations, precision: int) -> list[str]:
    by = found.by_constants
    double = precision == 64
    counts = (
        found.additions, found.multiplications + (0 if double else by), found.comparisons,
        found.divisions + (by if double else 0), found.mathematics,
    )  # fmt: skip
    return [f"{each:,}" for each in counts]


def _scales(fixed: FixedPoint) -> str:
    return (
        f"displacement = {fixed.centre_um:g} + {fixed.displacement_scale_um:g} µm · code / 2^31, "
        f"command = {fixed.voltage_scale_V:g} V · code / 2^31"
    )


def _plain(text: str) -> str:
    """Return a sentence as a page may hold it: no mark of it is obeyed, and it ends."""
    kept = "".join(c if c.isprintable() and c not in "<>`*[]|\\&" else " " for c in text).strip()
    return kept if kept.endswith((".", "!", "?", ")")) else f"{kept}."
