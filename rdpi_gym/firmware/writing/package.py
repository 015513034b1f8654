"""The folder that an export writes: code, vectors that test it, examples, and a page to read."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

from rdpi_gym.firmware.fixed_point import FixedPoint
from rdpi_gym.firmware.program import Program
from rdpi_gym.firmware.writing.source import (
    MATHEMATICS,
    Source,
    header_text,
    safe,
    source_text,
)
from rdpi_gym.firmware.writing.templating import filled, template
from rdpi_gym.firmware.writing.vectors import SAMPLES, Roundings, vectors, vectors_text
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, replaced_folder, write_atomic, write_json
from rdpi_gym.support.markdown import table
from rdpi_gym.support.words import number, some


def sfunction_text(program: Program) -> str:
    """Return ``rdpi_controller_sfunction.c`` or ``rdpi_plant_sfunction.c``, to be compiled with ``mex``."""
    if program.kind == "plant":
        return filled(template("sfunction_plant.c"), WHAT=f"Plant {safe(program.model)}")
    what = f"Controller {safe(program.title)} for plant {safe(program.model)}"
    return filled(template("sfunction_controller.c"), WHAT=what, PREVIEW=str(program.preview))


FORMAT, VERSION = "rdpi-firmware", 1
DESCRIPTION = "program.json"
BUILD, EXAMPLES = "build", "examples"
"""Folders: of what the Makefile makes, which an export that replaces another takes away; of loops."""


@dataclass(frozen=True)
class Package:
    """All that a folder is written from."""

    source: Source
    recipe: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def files(self) -> dict[str, str]:
        """Return the texts by their names in the folder, ``program.json`` left out."""
        source = self.source
        made = vectors(source)
        roundings = Roundings.of(source, made)
        name, kind = source.name, source.program.kind
        values = {
            "NAME": name,
            "LIBRARY": source.prefix or "rdpi",
            "VECTORS": f"{source.prefix}_vectors" if source.prefix else "vectors",
            "KIND": kind,
            "UPPER": name.upper(),
            "TITLE": safe(source.program.title),
            "PRECISIONS": " ".join(map(str, source.precisions)),
            "MATH": " -lm" if source.has_mathematics else "",
            "MATH_LIBRARY": "m" if source.has_mathematics else "",
            "SAMPLES": str(SAMPLES),
            **{f"ALLOWED_{_WORDS[p]}": f"{each:.0e}" for p, each in roundings.allowed.items()},
            "CENTRE": repr(float(source.program.centre_um)),
            "THIRD": repr(float(source.program.scale_um / 3.0)),
        }
        parts = frozenset({"FIXED"} if source.fixed is not None else set())
        c_files = {"main.c": f"main_{kind}.c", f"{EXAMPLES}/timer_interrupt.c": f"timer_{kind}.c",
                   f"{EXAMPLES}/desktop.c": f"desktop_{kind}.c", "Makefile": "Makefile",
                   "CMakeLists.txt": "CMakeLists.txt"}  # fmt: skip
        texts = {
            f"{name}.h": header_text(source),
            f"{name}.c": source_text(source),
            f"{name}_sfunction.c": source.named(sfunction_text(source.program)),
            "rdpi_vectors.h": vectors_text(source, made),
            **{
                to: source.named(filled(template(f"package/{of}"), parts, **values))
                for to, of in c_files.items()
            },
        }
        plain = replace(source, prefix=None)
        code = header_text(plain) + source_text(plain)
        texts["README.md"] = manual_text(source, code, (*self.warnings, *self.notes), roundings)
        return texts


def write_package(package: Package, out: Path) -> Path:
    """Write the folder, whole or not at all."""
    texts = package.files()
    known = {DESCRIPTION, BUILD, *texts}
    check_out(out, known)
    with replaced_folder(out) as fresh:
        for name, text in texts.items():
            write_atomic(fresh / name, text)
        write_json(fresh / DESCRIPTION, {"format": FORMAT, "version": VERSION, **package.recipe})
    return out


_WORDS = {64: "DOUBLE", 32: "FLOAT", 31: "WHOLE"}
_ENDS = (".h", ".c", "_sfunction.c")


def check_out(out: Path, known: set[str] | None = None) -> None:
    """Refuse a folder that an export may not replace, before anything is computed."""
    if not out.exists():
        return
    if not out.is_dir():
        raise InputError(f"{out} is a file; name a folder for the export")
    if not any(out.iterdir()):
        return
    try:
        earlier = read_json(out / DESCRIPTION, FORMAT, VERSION)
    except InputError:
        raise InputError(
            f"{out} holds files and no export of C; name a new folder, or an empty one"
        ) from None
    if known is not None:
        names = earlier.get("prefix"), *(f"rdpi_{kind}" for kind in _UNITS)
        known = known | {f"{name}{end}" for name in names for end in _ENDS}
        places = (path.relative_to(out) for path in sorted(out.rglob("*")) if not path.is_dir())
        others = [str(p) for p in places if p.as_posix() not in known and p.parts[0] != BUILD]
        if others:
            raise InputError(
                f"{out} holds {some(others)} beside an export, which would be lost; name another folder"
            )


# The page, and the operations that it counts.

_TOKEN = re.compile(
    r"""(?P<number>0[xX][0-9a-fA-F]+\w*|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\w*)
    |(?P<name>[A-Za-z_]\w*)|(?P<text>"[^"\n]*"|'[^'\n]*')
    |(?P<sign>->|\+\+|--|<<=|>>=|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/%&|^]=|.)""",
    re.VERBOSE,
)
_TYPE = re.compile(
    r"rdpi_real|u?int(8|32|64)_t|double|float|int|unsigned|void|const|rdpi_\w+_(state|parameters|memory)"
)
_DEFINITION = re.compile(r"^(?:static )?(?:inline )?\w+ (?P<name>\w+)\([^;{]*\)\s*\{", re.MULTILINE)


Operations: TypeAlias = Counter[str]
"""Numbers of operations of one step in the worst case, by kind: ``additions`` (and subtractions),
``multiplications``, ``comparisons`` (minimum and maximum are one each), ``divisions`` in every precision,
``by_constants`` (divisions by a constant, multiplications but in double), calls of ``mathematics``."""


def count(text: str, function: str, *, precision: int = 64) -> Operations:
    """Count what one call of a function does at most."""
    return _Counter(_preprocessed(text, precision)).function(function)


def _preprocessed(text: str, precision: int) -> str:
    """Return what is compiled, without comments; constants that are defined in place."""
    text = re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL)
    kept: list[str] = []
    branches: list[tuple[bool, bool]] = []  # open ones: whether this is compiled, or one before it
    constants: dict[str, str] = {}
    for line in text.splitlines():
        word = re.match(r"\s*#\s*(\w+)\s*(.*)", line)
        directive, rest = ("", "") if word is None else (word[1], word[2].strip())
        if directive in ("if", "ifdef", "ifndef"):
            branches.append((_holds(directive, rest, precision), False))
        elif directive in ("else", "elif"):
            before = any(branches.pop())
            holds = directive == "else" or _holds("if", rest, precision)
            branches.append((holds and not before, before))
        elif directive == "endif":
            branches.pop()
        elif all(compiled for compiled, _ in branches):
            if word is None:
                kept.append(line)
            elif constant := re.fullmatch(r"(\w+)\s+(\d+)", rest):
                constants[constant[1]] = constant[2]
    joined = "\n".join(kept)
    lengths = dict(re.findall(r"^ +\w+_t (\w+)\[(\d+)\];", joined, re.MULTILINE))
    whole = r"sizeof m->(\w+) / sizeof m->\1\[0\]"
    joined = re.sub(whole, lambda found: lengths.get(found[1], found[0]), joined)
    return re.sub(r"\b[A-Z]\w*\b", lambda found: constants.get(found[0], found[0]), joined)


def _holds(directive: str, condition: str, precision: int) -> bool:
    if directive == "ifdef":
        return False  # of the compiler's own names
    if directive == "ifndef":
        return True
    found = re.fullmatch(r"RDPI_PRECISION (==|!=) (\d+)(.*)", condition)
    return found is not None and (int(found[2]) == precision) == (found[1] == "==")


@dataclass
class _Counter:
    """Walks over the tokens of functions, statement by statement."""

    text: str
    _done: dict[str, Operations] = field(default_factory=dict)

    def function(self, name: str) -> Operations:
        if name not in self._done:
            found = next((f for f in _DEFINITION.finditer(self.text) if f["name"] == name), None)
            if found is None:
                return Operations()
            tokens = _tokens(self.text[found.end() - 1 :])
            self._done[name], _ = self._statement(tokens, 0, {})
        return self._done[name]

    def _statement(
        self, tokens: list[str], at: int, bounds: Mapping[str, int]
    ) -> tuple[Operations, int]:
        """Count a statement; return with where the next one begins."""
        token = tokens[at]
        if token == "{":
            total, at = Operations(), at + 1
            inside = dict(bounds)
            while tokens[at] != "}":
                bound = _whole(tokens, at, inside)
                inside |= bound
                more, at = self._statement(tokens, at, inside)
                total += Operations() if bound else more
            return total, at + 1
        if token == "if":
            end = _closed(tokens, at + 1)
            test = self._expression(tokens[at + 2 : end - 1])
            one, at = self._statement(tokens, end, bounds)
            other = Operations()
            if at < len(tokens) and tokens[at] == "else":
                other, at = self._statement(tokens, at + 1, bounds)
            return test + (one | other), at
        if token == "for":
            end = _closed(tokens, at + 1)
            variable, turns, last = _loop(tokens[at + 2 : end - 1], bounds)
            body, at = self._statement(tokens, end, {**bounds, variable: last})
            return Operations({kind: number * turns for kind, number in body.items()}), at
        if token in ("while", "do", "switch", "goto"):
            raise InputError(f"a loop whose turns cannot be counted: {token}")
        end = tokens.index(";", at)
        return self._expression(tokens[at:end]), end + 1

    def _expression(self, tokens: list[str]) -> Operations:
        """Count an expression or a declaration."""
        total, depth = Operations(), 0
        for at, token in enumerate(tokens):
            depth += (token == "[") - (token == "]")
            if depth:
                continue  # an index
            before = tokens[at - 1] if at else "("
            follows = tokens[at + 1] if at + 1 < len(tokens) else ""
            if follows == "(" and re.match(r"[A-Za-z_]", token):
                total += self._call(token)
            elif _is_binary(token, before, tokens[:at]):
                total[_OPERATORS[token]] += 1
        return total

    def _call(self, name: str) -> Operations:
        if name == "RDPI_OVER":
            return Operations(by_constants=1)
        if name.removeprefix("RDPI_") in MATHEMATICS:
            return Operations(mathematics=1)
        return self.function(_SAME.get(name, name))


_SAME = {"RDPI_FABS": "rdpi_abs", "RDPI_ISNAN": "rdpi_is_nan", "RDPI_COPYSIGN": "rdpi_copysign",
         "RDPI_MIN": "rdpi_min", "RDPI_MAX": "rdpi_max"}  # fmt: skip
_OPERATORS: Mapping[str, str] = {
    **dict.fromkeys(("+", "-", "+=", "-="), "additions"),
    **dict.fromkeys(("*", "*="), "multiplications"),
    **dict.fromkeys(("/", "/=", "%", "%="), "divisions"),
    **dict.fromkeys(("<", ">", "<=", ">=", "==", "!="), "comparisons"),
}


def _tokens(text: str) -> list[str]:
    """Return the tokens of one block, from its brace to the one that closes it."""
    found, depth = [], 0
    for match in _TOKEN.finditer(text):
        token = match[0]
        if token.isspace():
            continue
        found.append(token)
        depth += (token == "{") - (token == "}")
        if depth == 0:
            break
    return found


def _closed(tokens: list[str], at: int) -> int:
    """Return where what follows the parenthesis at a place begins."""
    depth = 0
    for place in range(at, len(tokens)):
        depth += (tokens[place] == "(") - (tokens[place] == ")")
        if depth == 0:
            return place + 1
    raise ValueError("a parenthesis that is never closed")


def _loop(head: list[str], bounds: Mapping[str, int]) -> tuple[str, int, int]:
    """Return a loop's variable, how often it turns at most, and the variable's largest value."""
    pattern = re.fullmatch(
        r"(?:u?int32_t )?(\w+) = (.+) ; (\w+) (<=?|>=?) (.+) ; (.+)", " ".join(head)
    )
    if pattern is None:
        raise InputError(f"a loop whose turns cannot be counted: for ({' '.join(head)})")
    variable, start, end = (
        pattern[1],
        _largest(pattern[2], bounds, 0),
        _largest(pattern[5], bounds, 1),
    )
    if pattern[4].startswith("<"):
        last = end - (pattern[4] == "<")
        return variable, max(last - start + 1, 0), last
    first = _largest(pattern[2], bounds, 1)
    lowest = _largest(pattern[5], bounds, 0) + (pattern[4] == ">")
    return variable, max(first - lowest + 1, 0), first


def _whole(tokens: list[str], at: int, bounds: Mapping[str, int]) -> dict[str, int]:
    """Return the largest value of a whole number that is stated here and never changed."""
    if tokens[at : at + 2] != ["const", "int32_t"] or tokens[at + 3] != "=":
        return {}
    value = " ".join(tokens[at + 4 : tokens.index(";", at)])
    try:
        return {tokens[at + 2]: _largest(value, bounds, 1)}
    except InputError:
        return {}


def _largest(text: str, bounds: Mapping[str, int], sign: int) -> int:
    """Return the largest (1) or the smallest (0) value of a bound: a sum of whole numbers and variables.

    A variable of an outer loop runs from 0 on.
    """
    chosen = re.search(r"\? (\d+) : (\d+)", text)
    if chosen:
        return (max if sign else min)(int(chosen[1]), int(chosen[2]))
    total, factor = 0, 1
    for word in text.replace("(", " ").replace(")", " ").split():
        if word in "+-":
            factor = 1 if word == "+" else -1
        elif word.rstrip("u").isdigit():
            total, factor = total + factor * int(word.rstrip("u")), 1
        elif word in bounds:
            reaches = bounds[word] if (sign == 1) == (factor == 1) else 0
            total, factor = total + factor * reaches, 1
        else:
            raise InputError(f"a loop whose turns cannot be counted: its bound is {text}")
    return total


def _is_binary(token: str, before: str, earlier: list[str]) -> bool:
    if token not in _OPERATORS:
        return False
    if token not in "+-*":
        return True
    if _TYPE.fullmatch(before) or before in ("return", "?", ":"):
        return False  # a pointer, a sign
    if before == ")":  # of a cast
        return not (len(earlier) > 2 and _TYPE.fullmatch(earlier[-2]))
    return bool(re.fullmatch(r"[\w.]+|\]", before))


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
    page = filled(
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
    return source.named(page)


def state_bytes(source: Source, precision: int) -> tuple[int, int]:
    """Return the bytes of a state and of the parameters, as common compilers lay them out."""
    real = 8 if precision == 64 else 4
    bytes_of = {"rdpi_real": real, "int32_t": 4, "uint32_t": 4, "int64_t": 8}
    own_form = source.fixed if precision == 31 and source.fixed is not None else source.program
    memory = [(bytes_of[part.type], len(part.rest)) for part in own_form.memory]
    parameters = [(bytes_of[part.type], len(part.values)) for part in own_form.tables]
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
            found = count(code, f"{source.usual}_step", precision=precision)
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
    kinds = ("additions", "multiplications", "comparisons", "divisions", "mathematics")
    by_constants = "divisions" if precision == 64 else "multiplications"
    return [f"{found[k] + (found['by_constants'] if k == by_constants else 0):,}" for k in kinds]


def _scales(fixed: FixedPoint) -> str:
    return (
        f"displacement = {fixed.centre_um:g} + {fixed.displacement_scale_um:g} µm · code / 2^31, "
        f"command = {fixed.voltage_scale_V:g} V · code / 2^31"
    )


def _plain(text: str) -> str:
    """Return a sentence as a page may hold it: no mark of it is obeyed, and it ends."""
    kept = "".join(c if c.isprintable() and c not in "<>`*[]|\\&" else " " for c in text).strip()
    return kept if kept.endswith((".", "!", "?", ")")) else f"{kept}."
