"""A program as a header and a source of C99: structs, tables, the body, and the wall around it.

Whatever comes in, the command stays in its range: inputs that are not finite or absurdly large are
not used, and what the body returns is clamped once more.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.firmware.fixed_point import FixedMemory, FixedPoint, FixedTable
from rdpi_gym.firmware.program import C_KEYWORDS, Memory, Program, Table, literal
from rdpi_gym.firmware.writing.templating import filled, helpers, template

FARTHEST = 1000.0
"""Inputs farther than this many scales from their centre are out of range."""
_LONGEST_TITLE = 60
_LARGEST = 1e30  # a displacement (µm) above it is no answer

_ALIASES = {"RDPI_FABS": "rdpi_abs", "RDPI_ISNAN": "rdpi_is_nan", "RDPI_COPYSIGN": "rdpi_copysign",
            "RDPI_MIN": "rdpi_min", "RDPI_MAX": "rdpi_max"}  # fmt: skip
MATHEMATICS = ("EXP", "LOG", "SIN", "COS", "TANH", "POW", "SQRT", "EXPM1", "LOG1P", "FLOOR", "CEIL",
               "FMOD")  # fmt: skip
"""Functions of ``<math.h>`` that a text may ask for as ``RDPI_EXP`` and so on."""


@dataclass(frozen=True)
class Source:
    """What header and source are written from.

    Parameters
    ----------
    program
        The thing itself.
    reach_um
        Lowest and highest displacement (µm) that the command range of a controller reaches slowly;
        None: not known.
    fixed
        The same on integers; None: it has no such form.
    """

    program: Program
    reach_um: tuple[float, float] | None = None
    fixed: FixedPoint | None = None

    @property
    def name(self) -> str:
        """Name of its files, and what its identifiers begin with."""
        return f"rdpi_{self.program.kind}"

    @property
    def precisions(self) -> tuple[int, ...]:
        """Values of ``RDPI_PRECISION`` that it compiles with."""
        return (64, 32) if self.fixed is None else (64, 32, 31)

    @property
    def reached_um(self) -> tuple[float, float]:
        """The reach (µm), or how far an input may be."""
        far = FARTHEST * self.program.scale_um
        centre = self.program.centre_um
        return (centre - far, centre + far) if self.reach_um is None else self.reach_um

    @property
    def is_single(self) -> bool:
        """Whether Python itself has numbers of single precision in it, as a network's."""
        return "float32" in self.program.inexact_because

    @property
    def has_mathematics(self) -> bool:
        """Whether a call of the library of mathematics is compiled in."""
        called = identifiers(self.program.functions + self.program.step)
        return bool(called & {f"RDPI_{name}" for name in MATHEMATICS})


def safe(text: str) -> str:
    """Return words of a user as they may stand in a comment of C: none of them ends it."""
    plain = re.sub(r"[^A-Za-z0-9 _.,:;+()=-]+", "_", text)
    return plain if len(plain) <= _LONGEST_TITLE else f"{plain[: _LONGEST_TITLE - 3]}..."


def header_text(source: Source) -> str:
    """Return the header: types, the API, the limits of commands and references."""
    program, fixed, name = source.program, source.fixed, source.name
    ends = {
        "LOW_V": program.command_range_V[0],
        "HIGH_V": program.command_range_V[1],
        "REST_V": program.rest_V,
    }

    def defined(values: Iterable[str]) -> str:
        return "\n".join(
            f"#define {name.upper()}_{key} {value}" for key, value in zip(ends, values, strict=True)
        )

    values = {}
    if fixed is not None:
        codes = (_whole(value, "int32_t") for value in (fixed.low, fixed.high, fixed.rest))
        values = {
            "CODES": defined(codes),
            "WHOLE_STRUCTS": _structs(name, fixed.tables, fixed.memory),
            "CENTRE": repr(fixed.centre_um),
            "SCALE": repr(fixed.displacement_scale_um),
            "VOLTS": repr(fixed.voltage_scale_V),
        }
    is_plant = program.kind == "plant"
    return filled(
        template("header.h"),
        {program.kind.upper(), "FLOATING" if fixed is None else "FIXED"},
        NAME=name,
        UPPER=name.upper(),
        WHAT=_what(program),
        TS=f"{program.ts_s:g}",
        SAMPLING=repr(program.ts_s),
        PREVIEW="" if is_plant else f"#define {name.upper()}_PREVIEW {program.preview}",
        AHEAD="r(k+1)" if program.preview == 1 else f"r(k+1) to r(k+{program.preview})",
        REALS=defined(literal(float(value)) for value in ends.values()),
        STRUCTS=_structs(name, program.tables, program.memory),
        **values,
    )


def source_text(source: Source) -> str:
    """Return the source: tables, the body, and what checks its inputs and its output."""
    program, fixed, name = source.program, source.fixed, source.name
    wall = _wall(source)
    own = _own_text(program.tables, program.memory, program.functions, program.step, source)
    asked = identifiers(own + wall)
    reals = [*_macros(asked, identifiers(own)), own]
    lines = [
        f"/* {_what(program)}: see {name}.h. Generated by rdpi-gym. */",
        f'#include "{name}.h"',
        "",
    ]
    if asked & {*(f"RDPI_{each}" for each in MATHEMATICS), "RDPI_NAN", "RDPI_INFINITY"}:
        guarded = fixed is not None
        lines += [*(["#if RDPI_PRECISION != 31"] if guarded else []), "#include <math.h>",
                  *(["#endif"] if guarded else []), ""]  # fmt: skip
    lines += [
        "#ifdef __FAST_MATH__",
        '#error "this code tells NaN from numbers: compile it without -ffast-math"',
        "#endif",
        "",
    ]
    if fixed is None:
        lines += reals
    else:
        text = _own_text(fixed.tables, fixed.memory, fixed.functions, fixed.step, source)
        lines += ["#if RDPI_PRECISION == 31", "", text, "#else", "", *reals, "#endif", ""]
    return "\n".join([*lines, wall])


def identifiers(text: str) -> set[str]:
    """Return the identifiers of a text of C, those of comments among them."""
    return set(re.findall(r"(?<![\w.])[A-Za-z_]\w*", text))


def _what(program: Program) -> str:
    title, model = safe(program.title), safe(program.model)
    return f"Plant {model}" if program.kind == "plant" else f"Controller {title} for plant {model}"


def _fields(parts: Iterable[Table | Memory | FixedTable | FixedMemory]) -> Iterator[str]:
    known: set[str] = set()
    for part in parts:
        is_word = re.fullmatch(r"[a-z][a-z0-9_]*", part.name) and part.name not in C_KEYWORDS
        if not is_word or part.name in known:
            raise ValueError(f"{part.name!r} is no new identifier of C")
        known.add(part.name)
        kind = part.type if isinstance(part, FixedTable | FixedMemory) else "rdpi_real"
        yield f"    {kind} {part.name}[{_length(part)}];"
    if not known:
        yield "    uint8_t none;"


def _length(part: Table | Memory | FixedTable | FixedMemory) -> int:
    return len(part.values if isinstance(part, Table | FixedTable) else part.rest)


def _structs(
    name: str,
    tables: Sequence[Table] | Sequence[FixedTable],
    memory: Sequence[Memory] | Sequence[FixedMemory],
) -> str:
    return "\n".join(
        [
            "/* Numbers that are read. */",
            "typedef struct {",
            *_fields(tables),
            f"}} {name}_parameters;",
            "",
            "/* Numbers that are kept from sample to sample. */",
            "typedef struct {",
            *_fields(memory),
            f"}} {name}_memory;",
        ]
    )


def _macros(asked: set[str], own: set[str]) -> list[str]:
    parts = {each for each in ("NAN", "INFINITY", "OVER", "WIDE") if f"RDPI_{each}" in asked}
    lines = filled(template("macros.c"), parts).strip("\n").splitlines()
    called = [each for each in MATHEMATICS if f"RDPI_{each}" in asked]
    for suffix, opening in (("", "#if RDPI_PRECISION == 64"), ("f", "#else")) if called else ():
        lines.append(opening)
        for each in called:
            arguments = "x, y" if each in ("POW", "FMOD") else "x"
            lines.append(f"#define RDPI_{each}({arguments}) {each.lower()}{suffix}({arguments})")
    lines += ["#endif"] if called else []
    aliases = {alias: function for alias, function in _ALIASES.items() if alias in own}
    for alias, function in aliases.items():
        arguments = "x" if function in ("rdpi_abs", "rdpi_is_nan") else "x, y"
        lines.append(f"#define {alias}({arguments}) {function}({arguments})")
    lines += [""] if lines else []
    return [*lines, *helpers("helpers.c", " ".join([*asked, *aliases.values()]))]


def _own_text(
    tables: Sequence[Table] | Sequence[FixedTable],
    memory: Sequence[Memory] | Sequence[FixedMemory],
    functions: str,
    step: str,
    source: Source,
) -> str:
    """Tables, what memory is at rest, the functions and the body, in one precision."""
    name = source.name
    lines = [f"const {name}_parameters {name}_default = {{"]
    lines += [braced(_values(table)) for table in tables]
    lines += ["    0"] if not tables else []
    lines += ["};", ""]
    first = ", rdpi_real reference_um" if _takes_reference(source) else ""
    rest = [*_rest(memory)]
    if first and not any("reference_um" in line for line in rest):
        rest.insert(0, "    (void)reference_um;")
    lines += [f"static void rdpi_rest({name}_memory *m{first})", "{", *rest, "}", ""]
    if functions.strip():
        lines += [functions.strip(), ""]
    if source.program.begin:
        lines += _function("void rdpi_begin", name, ["reference_um"], source.program.begin)
    inputs = ["reference_um", "ahead_um", "measured_um", "applied_V"]
    inputs = inputs if source.program.kind == "controller" else ["command_V"]
    lines += _function("rdpi_real rdpi_run", name, inputs, step)
    return "\n".join(lines)


def _function(head: str, name: str, inputs: Sequence[str], body: str) -> list[str]:
    """Return a function of tables, memory and inputs; arguments that it does not read are named."""
    declared = [f"const {name}_parameters *p", f"{name}_memory *m"]
    declared += [
        f"{'const rdpi_real *' if each == 'ahead_um' else 'rdpi_real '}{each}" for each in inputs
    ]
    used = identifiers(body)
    return [
        f"static {head}({', '.join(declared)})",
        "{",
        *(f"    (void){each};" for each in ("p", "m", *inputs) if each not in used),
        *(f"    {line}".rstrip() for line in body.strip("\n").splitlines()),
        "}",
        "",
    ]


def _takes_reference(source: Source) -> bool:
    """Whether what is remembered at rest hangs on the first reference, in some precision."""
    fixed = () if source.fixed is None else source.fixed.memory
    begins = bool(source.program.begin) or any(part.from_reference for part in fixed)
    return begins or any(bool(np.any(part.by_reference)) for part in source.program.memory)


def _values(table: Table | FixedTable) -> list[str]:
    if isinstance(table, FixedTable):
        return [_whole(value, table.type) for value in table.values]
    return [literal(float(value)) for value in table.values]


def braced(values: Sequence[str], across: int = 4) -> str:
    """Return numbers between braces, a few a line."""
    rows = [", ".join(values[k : k + across]) for k in range(0, len(values), across)]
    return "    {" + ",\n     ".join(rows) + "},"


def _whole(value: int, kind: str) -> str:
    if kind == "uint32_t":
        return f"UINT32_C({value})"
    text = f"{'INT64_C' if kind == 'int64_t' else 'INT32_C'}"
    # the lowest of all has no literal of its own
    lowest = {"int32_t": -(2**31), "int64_t": -(2**63)}[kind]
    return f"({text}({value + 1}) - 1)" if value == lowest else f"{text}({value})"


def _rest(memory: Sequence[Memory] | Sequence[FixedMemory]) -> Iterator[str]:
    """Statements that set memory to where an episode begins."""
    if not memory:
        yield "    m->none = 0;"
    for part in memory:
        if isinstance(part, FixedMemory):
            rest = [
                "reference_um" if part.from_reference else _whole(value, part.type)
                for value in part.rest
            ]
        else:
            rest = [_begin(*pair) for pair in zip(part.rest, part.by_reference, strict=True)]
        at = 0
        while at < len(rest):  # equal neighbours by a loop
            end = at
            while end < len(rest) and rest[end] == rest[at]:
                end += 1
            if end - at > 2:
                yield f"    for (int32_t i = {at}; i < {end}; ++i) {{"
                yield f"        m->{part.name}[i] = {rest[at]};"
                yield "    }"
            else:
                yield from (f"    m->{part.name}[{i}] = {rest[at]};" for i in range(at, end))
            at = end


def _begin(rest: float, by_reference: float) -> str:
    if by_reference == 0.0:
        return literal(float(rest))
    slope = (
        "reference_um" if by_reference == 1.0 else f"{literal(float(by_reference))} * reference_um"
    )
    return slope if rest == 0.0 else f"{literal(float(rest))} + {slope}"


def _wall(source: Source) -> str:
    program = source.program
    low, high = program.command_range_V
    text = template(f"wall_{program.kind}.c")
    if source.fixed is not None:
        text = text.replace("@IF_REAL@\n", "#if RDPI_PRECISION != 31\n").replace(
            "@END_REAL@\n", "#endif\n"
        )
    if program.kind == "plant":
        return filled(
            text,
            MIDDLE=literal(0.5 * (low + high)),
            FAR=literal(FARTHEST * (high - low)),
            LARGEST=literal(_LARGEST),
        )
    takes = _takes_reference(source)
    check = (
        "    if (rdpi_is_usable(measured_um) == 0) {\n        usable = 0;\n    }"
        if "measured_um" in identifiers(program.step)
        else ""
    )
    return filled(
        text,
        frozenset({"REAL", "FIRST"} if takes else {"REAL"}),
        BEGIN="    rdpi_begin(p, &s->memory[0], first_um);" if program.begin else "",
        CENTRE=literal(program.centre_um),
        CHECK_MEASURED=check,
        FAR=literal(FARTHEST * program.scale_um),
        FIRST="    rdpi_real first_um = reference_um;\n" if takes else "",
        LARGEST=literal(_LARGEST),
        REACH=_reach(source),
        REST_ARGUMENT=", first_um" if takes else "",
        UNUSED_FIRST="" if source.fixed is None or takes else "    (void)reference_um;",
    )


def _reach(source: Source) -> str:
    reals = [literal(float(value)) for value in source.reached_um]
    names = ("RDPI_LOWEST_UM", "RDPI_HIGHEST_UM")
    lines = ["/* What the command range reaches, slowly. */"]
    lines += [f"#define {name} {text}" for name, text in zip(names, reals, strict=True)]
    if source.fixed is not None:
        codes = source.fixed.displacement_codes(source.reached_um).tolist()
        whole = [_whole(int(code), "int32_t") for code in codes]
        lines = [
            lines[0],
            "#if RDPI_PRECISION == 31",
            *(f"#define {name} {text}" for name, text in zip(names, whole, strict=True)),
            "#else",
            *lines[1:],
            "#endif",
        ]
    return "\n".join([*lines, ""])
