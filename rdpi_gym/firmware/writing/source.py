"""A program as a header and a source of C99: structs, tables, the body, and the wall around it.

Whatever comes in, the command stays in its range: inputs that are not finite or absurdly large are
not used, and what the body returns is clamped once more.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.firmware.fixed_point import FixedMemory, FixedPoint, FixedTable
from rdpi_gym.firmware.program import Memory, Program, Table
from rdpi_gym.firmware.values import literal
from rdpi_gym.firmware.writing.templating import filled, template

FARTHEST = 1000.0
"""Inputs farther than this many scales from their centre are out of range."""
_LONGEST_TITLE = 60
_LARGEST = 1e30  # a displacement (µm) above it is no answer

# What a text may ask for, callees first. Ours have no library behind them; of equal numbers the first
# is taken, as numba does.
_HELPERS: Mapping[str, str] = {
    "rdpi_min": "static rdpi_real rdpi_min(rdpi_real a, rdpi_real b)\n{\n    return (b < a) ? b : a;\n}\n",
    "rdpi_max": "static rdpi_real rdpi_max(rdpi_real a, rdpi_real b)\n{\n    return (b > a) ? b : a;\n}\n",
    "rdpi_min_int": "static int32_t rdpi_min_int(int32_t a, int32_t b)\n{\n    return (b < a) ? b : a;\n}\n",
    "rdpi_max_int": "static int32_t rdpi_max_int(int32_t a, int32_t b)\n{\n    return (b > a) ? b : a;\n}\n",
    # 0 - (-0) is +0: the magnitude of a zero has no sign
    "rdpi_abs": (
        "static rdpi_real rdpi_abs(rdpi_real x)\n{\n    return (x <= RDPI_C(0.0)) ? (RDPI_C(0.0) - x) : x;\n}\n"
    ),
    "rdpi_is_nan": "static int32_t rdpi_is_nan(rdpi_real x)\n{\n    return (x != x) ? 1 : 0;\n}\n",
    "rdpi_copysign": """\
#if RDPI_PRECISION == 64
typedef uint64_t rdpi_bits;
#define RDPI_SIGN ((rdpi_bits)1u << 63)
#else
typedef uint32_t rdpi_bits;
#define RDPI_SIGN ((rdpi_bits)1u << 31)
#endif

typedef union {
    rdpi_real number;
    rdpi_bits bits;
} rdpi_image;

static rdpi_real rdpi_copysign(rdpi_real size, rdpi_real sign)
{
    rdpi_image a;
    rdpi_image b;
    a.number = size;
    b.number = sign;
    a.bits = (a.bits & ~RDPI_SIGN) | (b.bits & RDPI_SIGN);
    return a.number;
}
""",
}
_ALIASES = {"RDPI_FABS": "rdpi_abs", "RDPI_ISNAN": "rdpi_is_nan", "RDPI_COPYSIGN": "rdpi_copysign",
            "RDPI_MIN": "rdpi_min", "RDPI_MAX": "rdpi_max"}  # fmt: skip
MATHEMATICS = ("EXP", "LOG", "SIN", "COS", "TANH", "POW", "SQRT", "EXPM1", "LOG1P", "FLOOR", "CEIL",
               "FMOD")  # fmt: skip
"""Functions of ``<math.h>`` that a text may ask for as ``RDPI_EXP`` and so on."""
_KEYWORDS = re.compile(
    "auto|break|case|char|const|continue|default|do|double|else|enum|extern|float|for|goto|if|inline|int|"
    "long|register|restrict|return|short|signed|sizeof|static|struct|switch|typedef|union|unsigned|void|"
    "volatile|while"
)


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
        return bool(_asked(self._text) & {f"RDPI_{name}" for name in MATHEMATICS})

    @property
    def _text(self) -> str:
        return self.program.functions + self.program.step


def safe(text: str) -> str:
    """Return words of a user as they may stand in a comment of C: none of them ends it."""
    plain = re.sub(r"[^A-Za-z0-9 _.,:;+()=-]+", "_", text)
    return plain if len(plain) <= _LONGEST_TITLE else f"{plain[: _LONGEST_TITLE - 3]}..."


def header_text(source: Source) -> str:
    """Return the header: types, the API, the limits of commands and references."""
    program = source.program
    name, upper = source.name, source.name.upper()
    low, high = program.command_range_V
    lines = [
        f"/* {_what(program)}, sampled every {program.ts_s:g} s.",
        " *",
        " * Generated by rdpi-gym; see README.md. C99 without allocation, without global variables. */",
        f"#ifndef {upper}_H",
        f"#define {upper}_H",
        "",
        "#include <stdint.h>",
        "",
        *_precision(source),
        "",
        "/* Flags. */",
        "#ifndef RDPI_CLAMPED",
        *(f"#define {line}" for line in _FLAGS[program.kind]),
        "#endif",
        "",
        f"#define {upper}_TS_S {program.ts_s!r}",
    ]
    if program.kind == "controller":
        lines.append(f"#define {upper}_PREVIEW {program.preview}")
    limits = {"LOW_V": low, "HIGH_V": high, "REST_V": program.rest_V}
    reals = [f"#define {upper}_{key} {literal(float(value))}" for key, value in limits.items()]
    fixed = source.fixed
    if fixed is None:
        lines += [*reals, "", *_structs(name, program.tables, program.memory)]
    else:
        codes = {"LOW_V": fixed.low, "HIGH_V": fixed.high, "REST_V": fixed.rest}
        lines += [
            "#if RDPI_PRECISION == 31",
            "/* Fractions of a scale in units of 2^-31. */",
            *(f"#define {upper}_{key} {_whole(value, 'int32_t')}" for key, value in codes.items()),
            "#else",
            *reals,
            "#endif",
            "",
            "#if RDPI_PRECISION == 31",
            *_structs(name, fixed.tables, fixed.memory),
            "#else",
            *_structs(name, program.tables, program.memory),
            "#endif",
        ]
    lines += ["", *_state(program.kind, name), "", *_api(program, name), "", *_conversions(source)]
    return "\n".join([*lines, "", f"#endif /* {upper}_H */", ""])


def source_text(source: Source) -> str:
    """Return the source: tables, the body, and what checks its inputs and its output."""
    program, fixed, name = source.program, source.fixed, source.name
    wall = _wall(source)
    own = _own_text(program.tables, program.memory, program.functions, program.step, source)
    asked = _asked(own + wall)
    reals = [*_macros(asked, own), own]
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


_FLAGS: Mapping[str, Sequence[str]] = {
    kind: (
        f"RDPI_CLAMPED 1u      /* {clamped} */",
        "RDPI_SATURATED 2u    /* the reference lies outside what the command range reaches */",
        f"RDPI_OUT_OF_RANGE 4u /* an input was not finite or absurdly large: {held} */",
    )
    for kind, clamped, held in (
        ("controller", "the command is at an end of its range", "the last command is held"),
        ("plant", "the command lies outside its range", "the last one is held"),
    )
}


def _what(program: Program) -> str:
    title, model = safe(program.title), safe(program.model)
    return f"Plant {model}" if program.kind == "plant" else f"Controller {title} for plant {model}"


def _precision(source: Source) -> list[str]:
    lines = [
        "/* RDPI_PRECISION: 64 double, 32 float, 31 whole numbers of 32 bits; -DRDPI_PRECISION=32. */",
        "#ifndef RDPI_PRECISION",
        "#define RDPI_PRECISION 64",
        "#endif",
        "#ifndef RDPI_REAL",
        "#define RDPI_REAL",
        "#if RDPI_PRECISION == 64",
        "typedef double rdpi_real;",
        "#define RDPI_C(x) (x)",
        "#elif RDPI_PRECISION == 32",
        "typedef float rdpi_real;",
        "#define RDPI_C(x) ((rdpi_real)(x))",
        "#elif RDPI_PRECISION == 31",
        "typedef int32_t rdpi_real;",
        "#else",
        '#error "RDPI_PRECISION has to be 64, 32 or 31"',
        "#endif",
        "#endif",
    ]
    if source.fixed is None:
        lines += [
            "#if RDPI_PRECISION == 31",
            '#error "this one has no form on whole numbers: RDPI_PRECISION has to be 64 or 32"',
            "#endif",
        ]
    return lines


def _fields(parts: Iterable[Table | Memory | FixedTable | FixedMemory]) -> Iterator[str]:
    known: set[str] = set()
    for part in parts:
        is_word = re.fullmatch(r"[a-z][a-z0-9_]*", part.name) and not _KEYWORDS.fullmatch(part.name)
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
) -> list[str]:
    return [
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


def _state(kind: str, name: str) -> list[str]:
    if kind == "plant":
        fields = [
            f"    {name}_memory memory;",
            "    rdpi_real command_V;       /* the last one that could be used */",
            "    rdpi_real displacement_um; /* the last answer */",
            "    uint8_t flags;",
        ]
    else:
        fields = [
            f"    {name}_memory memory[2]; /* one is current, a step works on the other */",
            "    rdpi_real applied_V;         /* the last command that was written */",
            "    uint8_t current;",
            "    uint8_t pending; /* a step waits to be acknowledged */",
            "    uint8_t flags;",
        ]
    return [
        "/* One instance; the caller owns it. */",
        "typedef struct {",
        *fields,
        f"}} {name}_state;",
    ]


def _api(program: Program, name: str) -> list[str]:
    state, const = f"{name}_state *s", f"const {name}_parameters *p"
    lines = ["#ifdef __cplusplus", 'extern "C" {', "#endif", "",
             f"extern const {name}_parameters {name}_default;", ""]  # fmt: skip
    if program.kind == "plant":
        lines += [
            "/* Begin at rest, with the plant's own memory of the past. */",
            f"void {name}_init({state}, {const});",
            "",
            "/* Take a command (V), go on by one sample, return the displacement (um). */",
            f"rdpi_real {name}_step({state}, {const}, rdpi_real command_V);",
        ]
    else:
        ahead = "r(k+1)" if program.preview == 1 else f"r(k+1) to r(k+{program.preview})"
        lines += [
            "/* Begin at rest, where the reference has been reference_um. */",
            f"void {name}_init({state}, {const}, rdpi_real reference_um);",
            "",
            f"/* Return the command u(k+1) (V) from r(k), preview_um: {ahead}, and what is measured at k.",
            " * Nothing is remembered before rdpi_controller_acknowledge: a step may be repeated. */",
            f"rdpi_real {name}_step({state}, {const}, rdpi_real reference_um,",
            f"                               const rdpi_real preview_um[{name.upper()}_PREVIEW],",
            "                               rdpi_real measured_um);",
            "",
            "/* The command was written, as written_V (V): memory advances. */",
            f"void {name}_acknowledge({state}, rdpi_real written_V);",
        ]
    lines += ["", "/* Flags of the last step. */", f"uint8_t {name}_flags(const {name}_state *s);"]
    return [*lines, "", "#ifdef __cplusplus", "}", "#endif"]


def _conversions(source: Source) -> list[str]:
    """Functions between units and ``rdpi_real``; a target that needs none compiles none."""
    name, fixed = source.name, source.fixed
    plain = [
        f"static inline rdpi_real {name}_from_um(double um)\n{{\n    return (rdpi_real)um;\n}}",
        f"static inline rdpi_real {name}_from_V(double V)\n{{\n    return (rdpi_real)V;\n}}",
        f"static inline double {name}_to_um(rdpi_real um)\n{{\n    return (double)um;\n}}",
        f"static inline double {name}_to_V(rdpi_real V)\n{{\n    return (double)V;\n}}",
    ]
    lines = ["/* Units, for hosts and tests. */"]
    if fixed is None:
        return [*lines, *plain]
    scale, centre, volts = fixed.displacement_scale_um, fixed.centre_um, fixed.voltage_scale_V
    one = "2147483648.0"
    codes = [
        f"static inline rdpi_real {name}_code(double fraction)\n{{\n"
        f"    const double code = fraction * {one};\n"
        "    if (!(code < 2147483647.0)) {\n        return INT32_MAX;\n    }\n"
        "    if (code <= -2147483648.0) {\n        return INT32_MIN;\n    }\n"
        "    return (rdpi_real)(code < 0.0 ? code - 0.5 : code + 0.5);\n}",
        f"static inline rdpi_real {name}_from_um(double um)\n{{\n"
        f"    return {name}_code((um - ({centre!r})) / {scale!r});\n}}",
        f"static inline rdpi_real {name}_from_V(double V)\n{{\n"
        f"    return {name}_code(V / {volts!r});\n}}",
        f"static inline double {name}_to_um(rdpi_real code)\n{{\n"
        f"    return {centre!r} + {scale!r} * ((double)code / {one});\n}}",
        f"static inline double {name}_to_V(rdpi_real code)\n{{\n"
        f"    return {volts!r} * ((double)code / {one});\n}}",
    ]
    return [*lines, "#if RDPI_PRECISION == 31", *codes, "#else", *plain, "#endif"]


def _asked(text: str) -> set[str]:
    """Return macros and functions of ours that a text calls, and what those call."""
    asked = identifiers(text)
    while True:
        more = {_ALIASES[each] for each in asked & _ALIASES.keys()}
        more |= {other for each in asked & _HELPERS.keys() for other in identifiers(_HELPERS[each])}
        if more <= asked:
            return asked
        asked |= more


def _macros(asked: set[str], own: str) -> list[str]:
    lines = []
    if "RDPI_NAN" in asked:
        lines += ["#define RDPI_NAN ((rdpi_real)NAN)"]
    if "RDPI_INFINITY" in asked:
        lines += ["#define RDPI_INFINITY ((rdpi_real)INFINITY)"]
    if "RDPI_OVER" in asked:
        lines += [
            "/* By a constant: divided in double, as Python does; else multiplied, which is faster. */",
            "#if RDPI_PRECISION == 64 && !defined(RDPI_NO_DIVISION)",
            "#define RDPI_OVER(x, d) ((x) / (d))",
            "#else",
            "#define RDPI_OVER(x, d) ((x) * (RDPI_C(1.0) / (d)))",
            "#endif",
        ]
    if "RDPI_WIDE" in asked:
        lines += [
            "/* What a float cannot hold: the first in double, the second in float. */",
            "#if RDPI_PRECISION == 64",
            "#define RDPI_WIDE(x, f) (x)",
            "#else",
            "#define RDPI_WIDE(x, f) (f)",
            "#endif",
        ]
    called = [each for each in MATHEMATICS if f"RDPI_{each}" in asked]
    for suffix, opening in (("", "#if RDPI_PRECISION == 64"), ("f", "#else")) if called else ():
        lines.append(opening)
        for each in called:
            two = each in ("POW", "FMOD")
            arguments = "x, y" if two else "x"
            lines.append(f"#define RDPI_{each}({arguments}) {each.lower()}{suffix}({arguments})")
    lines += ["#endif"] if called else []
    for alias, function in _ALIASES.items():
        if alias in identifiers(own):
            two = function in ("rdpi_min", "rdpi_max", "rdpi_copysign")
            arguments = "x, y" if two else "x"
            lines.append(f"#define {alias}({arguments}) {function}({arguments})")
    lines += [""] if lines else []
    return [*lines, *(text for each, text in _HELPERS.items() if each in asked)]


def _own_text(
    tables: Sequence[Table] | Sequence[FixedTable],
    memory: Sequence[Memory] | Sequence[FixedMemory],
    functions: str,
    step: str,
    source: Source,
) -> str:
    """Tables, what memory is at rest, the functions and the body, in one precision."""
    name, kind = source.name, source.program.kind
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
    begin = source.program.begin.strip("\n")
    if begin:
        used = identifiers(begin)
        lines += [
            f"static void rdpi_begin(const {name}_parameters *p, {name}_memory *m, rdpi_real reference_um)",
            "{",
            *(f"    (void){each};" for each in ("p", "m", "reference_um") if each not in used),
            *(f"    {line}".rstrip() for line in begin.splitlines()),
            "}",
            "",
        ]
    inputs = (
        ("reference_um", "ahead_um", "measured_um", "applied_V")
        if kind == "controller"
        else ("command_V",)
    )
    declared = [f"const {name}_parameters *p", f"{name}_memory *m"]
    declared += [
        f"{'const rdpi_real *' if each == 'ahead_um' else 'rdpi_real '}{each}" for each in inputs
    ]
    used = identifiers(step)
    lines += [
        f"static rdpi_real rdpi_run({', '.join(declared)})",
        "{",
        *(f"    (void){each};" for each in ("p", "m", *inputs) if each not in used),
        *(f"    {line}".rstrip() for line in step.strip("\n").splitlines()),
        "}",
        "",
    ]
    return "\n".join(lines)


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
