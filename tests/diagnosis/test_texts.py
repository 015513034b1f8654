"""Statements and the table of texts: every code has its text, every field its value, nothing reads one."""

import ast
import re
from pathlib import Path
from string import Formatter

from rdpi_gym.diagnosis.texts import TEXTS
from rdpi_gym.measurement import Quantities

ROOT = Path(__file__).parents[2]
MAKERS = {"statement", "template", "of_record", "cannot_tell", "Statement"}
OF_RECORD = {"samples", "share", "record"}
DERIVED = re.compile(r"_(s|clause|sentence)$")
UNITS = set(Quantities()._fields)


def patterns(node):
    """What codes an expression can be, as regular expressions; none of a name."""
    if isinstance(node, ast.Constant):
        return [re.escape(node.value)] if isinstance(node.value, str) else []
    if isinstance(node, ast.IfExp):
        return [*patterns(node.body), *patterns(node.orelse)]
    if isinstance(node, ast.JoinedStr):
        parts = [
            re.escape(v.value) if isinstance(v, ast.Constant) else "[^/]*" for v in node.values
        ]
        return ["".join(parts)]
    return []


def statements():
    """Every place in the product that makes a statement.

    Returns file and line, patterns of codes, names of values, and whether those are all.
    """
    for path in sorted((ROOT / "rdpi_gym/diagnosis").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        inner = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        for function in inner:
            for call in ast.walk(function):
                if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.args:
                    yield from made(f"{path.name}:{call.lineno}", call, function)


def made(where, call, function):
    """The statements of one call."""
    name = call.func.id
    if name not in MAKERS:
        return
    values = {word.arg for word in call.keywords if word.arg}
    values |= OF_RECORD if name == "of_record" else set()
    known = all(word.arg for word in call.keywords) and name != "Statement"
    for code in call.args[1:3] if name == "cannot_tell" else call.args[:1]:
        if isinstance(code, ast.Name):
            yield where, assigned(code.id, function), values, known
        else:
            yield where, patterns(code), values, known


def assigned(name, function):
    """What a variable of a function is set to."""
    found = []
    for node in ast.walk(function):
        if isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                pairs = zip(target.elts, value.elts, strict=True)
            else:
                pairs = [(target, value)]
            for own, text in pairs:
                if isinstance(own, ast.Name) and own.id == name:
                    found += patterns(text)
    return found


def fields(text):
    """Fields of a text that its statement has to fill."""
    names = {name for _, name, _, _ in Formatter().parse(text) if name}
    return {DERIVED.sub("", name) for name in names - UNITS}


def test_every_statement_has_a_text_and_every_text_a_statement():
    used = set()
    for where, codes, _, _ in statements():
        for code in codes:
            found = {key for key in TEXTS if re.fullmatch(code, key)}
            assert found, f"{where}: no text has the code {code}"
            used |= found
    assert set(TEXTS) - used == set()


def test_every_field_of_a_text_has_a_value():
    for where, codes, values, known in statements():
        for code in codes if known else ():
            for key in TEXTS:
                if code[0] not in "[." and re.fullmatch(code, key):
                    assert fields(TEXTS[key]) <= values, f"{where}: {key}"


WRITERS = {"text_of", "template", "request_of", "headline", "experiment_for", "sentences_of"}
SENTENCES = {
    "sentence", "sentences", "next_step", "headline", "remainder", "noise_origin", "sampling",
    "undecided", "next_experiment", "evidence", "remarks", "limits", "left_out",
}  # fmt: skip
SEARCHES = {
    "startswith", "endswith", "split", "rsplit", "partition", "rpartition", "find", "index", "count",
    "removeprefix", "removesuffix", "replace", "match", "search", "fullmatch", "findall",
}  # fmt: skip


def is_text(node):
    """Whether an expression is what the renderer wrote, or a field of a result that holds it."""
    if isinstance(node, ast.Subscript):
        return is_text(node.value)
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and node.func.id in WRITERS
    return isinstance(node, ast.Attribute) and node.attr in SENTENCES


def is_reading(node):
    """Whether a text is compared, searched or cut."""
    if isinstance(node, ast.Compare):
        compared = any(isinstance(op, ast.In | ast.NotIn | ast.Eq | ast.NotEq) for op in node.ops)
        return compared and any(map(is_text, [node.left, *node.comparators]))
    searched = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    if not searched or node.func.attr not in SEARCHES:
        return False
    return any(map(is_text, [node.func.value, *node.args]))


def readings(tree):
    """Where a text is read."""
    return [node for node in ast.walk(tree) if is_reading(node)]


def test_nothing_reads_a_sentence():
    for room in ("diagnosis", "report", "face", "cli", "laboratory"):
        for path in (ROOT / "rdpi_gym" / room).rglob("*.py"):
            found = readings(ast.parse(path.read_text(encoding="utf-8")))
            assert found == [], f"{path}: {[ast.unparse(node) for node in found]}"
    assert len(readings(ast.parse("'rest' in a.sentence or text_of(b).split(':')[0]"))) == 2
