"""A program as a header and a source of C99: structs, tables, the body, and the wall around it.

Whatever comes in, the command stays in its range: inputs that are not finite or absurdly large are
not used, and what the body returns is clamped once more.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.firmware.fixed_point import FixedPoint
from rdpi_gym.firmware.program import C_KEYWORDS, Memory, Program, Table, literal, words
from rdpi_gym.firmware.writing.templating import filled, helpers, template
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

_LONGEST_PREFIX = 40
_PREFIX = re.compile(rf"[A-Za-z][A-Za-z0-9_]{{0,{_LONGEST_PREFIX - 1}}}")
_HEADERS = words("math simstruc simulink stdint stdio stdlib string cg_sfun rdpi_vectors")
_TAKEN = C_KEYWORDS | _HEADERS | {"main", "rdpi", "step"}
"""Prefixes that are names of C, of files beside the code, or those of the code's own functions."""
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
    """The content of header and source."""

    program: Program
    reach_um: tuple[float, float] | None = None
    fixed: FixedPoint | None = None
    prefix: str | None = None  # of its files and identifiers; None: rdpi_controller or rdpi_plant

    def __post_init__(self) -> None:
        prefix = self.prefix
        if prefix is None:
            return
        if not _PREFIX.fullmatch(prefix) or prefix.lower() in _TAKEN:
            raise InputError(
                f"prefix is {quoted(prefix)}; give an identifier of C of {_LONGEST_PREFIX} letters, digits "
                "and _ at most that begins with a letter, such as x_axis, and is no name of C, main, rdpi or step"
            )

    @property
    def usual(self) -> str:
        """Prefix in the templates, and in an export that names no other."""
        return f"rdpi_{self.program.kind}"

    @property
    def name(self) -> str:
        """Name of its files, and prefix of its identifiers."""
        return self.prefix or self.usual

    def named(self, text: str) -> str:
        """Return a text with its own prefix in place of the usual one."""
        own = re.sub(rf"\b{self.usual}(?![a-z0-9])", self.name, text)
        return re.sub(rf"\b{self.usual.upper()}(?![A-Z0-9])", self.name.upper(), own)

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
    plain = re.sub(r"[^A-Za-z0-9 _.,:;+()=/-]+", "_", text.replace("µ", "u"))
    return plain if len(plain) <= _LONGEST_TITLE else f"{plain[: _LONGEST_TITLE - 3]}..."


def header_text(source: Source) -> str:
    """Return the header: types, the API, the limits of commands and references."""
    program, fixed, name = source.program, source.fixed, source.usual
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
    text = filled(
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
    return source.named(text)


def source_text(source: Source) -> str:
    """Return the source: tables, the body, and what checks its inputs and its output."""
    program, fixed, name = source.program, source.fixed, source.usual
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
    return source.named("\n".join([*lines, wall]))


def identifiers(text: str) -> set[str]:
    """Return the identifiers of a text of C, those of comments among them."""
    return set(re.findall(r"(?<![\w.])[A-Za-z_]\w*", text))


def _what(program: Program) -> str:
    title, model = safe(program.title), safe(program.model)
    return f"Plant {model}" if program.kind == "plant" else f"Controller {title} for plant {model}"


def _fields(parts: Iterable[Table | Memory]) -> Iterator[str]:
    known: set[str] = set()
    for part in parts:
        is_word = re.fullmatch(r"[a-z][a-z0-9_]*", part.name) and part.name not in C_KEYWORDS
        if not is_word or part.name in known:
            raise ValueError(f"{part.name!r} is no new identifier of C")
        known.add(part.name)
        count = len(part.values if isinstance(part, Table) else part.rest)
        about = f" /* {safe(part.about)} */" if part.about else ""
        yield f"    {part.type} {part.name}[{count}];{about}"
    if not known:
        yield "    uint8_t none;"


def _structs(
    name: str,
    tables: Sequence[Table],
    memory: Sequence[Memory],
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
            *_places(name, [*tables, *memory]),
        ]
    )


def _places(name: str, fields: Iterable[Table | Memory]) -> Iterator[str]:
    """First places of the parts of fields, by name."""
    for kept in (field for field in fields if field.parts):
        kind = "parameters" if isinstance(kept, Table) else "memory"
        stem = "_".join(dict.fromkeys((name, kind, kept.name)))
        yield from ["", f"/* Places in {kept.name} of the {kind}. */"]
        at = 0
        for part in kept.parts:
            count = f"{part.count} numbers" if part.count > 1 else ""
            about = safe(", ".join(filter(None, (count, part.unit))))
            comment = f" /* {about} */" if about else ""
            yield f"#define {f'{stem}_{part.name}'.upper()} {at}{comment}"
            at += part.count


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
    tables: Sequence[Table],
    memory: Sequence[Memory],
    functions: str,
    step: str,
    source: Source,
) -> str:
    """Tables, what memory is at rest, the functions and the body, in one precision."""
    name = source.usual
    lines = [f"const {name}_parameters {name}_default = {{"]
    lines += [braced([_number(value, table.type) for value in table.values]) for table in tables]
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
    """Whether the memory at rest depends on the first reference, in some precision."""
    memory = [*source.program.memory, *(() if source.fixed is None else source.fixed.memory)]
    return bool(source.program.begin) or any(np.any(part.by_reference) for part in memory)


def _number(value: float, kind: str) -> str:
    return literal(float(value)) if kind == "rdpi_real" else _whole(int(value), kind)


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


def _rest(memory: Sequence[Memory]) -> Iterator[str]:
    """Statements that set memory to where an episode begins."""
    if not memory:
        yield "    m->none = 0;"
    for part in memory:
        pairs = zip(part.rest, part.by_reference, strict=True)
        rest = [_begin(value, slope, part.type) for value, slope in pairs]
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


def _begin(rest: float, by_reference: float, kind: str) -> str:
    if by_reference == 0.0:
        return _number(rest, kind)
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
