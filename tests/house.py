"""The house's plan, and its size: ``python -m tests.house`` prints the table of sizes.

Lines and statements are those of the product (docstrings are lines and no statements). A module with
one importer is imported by exactly one other module of the product; folders' own files are left out.
"""

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("rdpi_gym", "baselines", "benchmarks", "studies")

# Lowest first; rooms in one line are neighbours that do not know each other.
FLOORS = (
    ("rdpi_gym.support",),
    ("rdpi_gym.plant", "rdpi_gym.signals"),
    ("rdpi_gym.measurement",),
    ("rdpi_gym.identification", "rdpi_gym.envs"),
    ("rdpi_gym.virtual_lab", "rdpi_gym.diagnosis", "rdpi_gym.torch_plant"),
    ("rdpi_gym.report", "baselines"),
    ("benchmarks", "rdpi_gym.firmware"),
    ("rdpi_gym.face",),
    ("rdpi_gym.laboratory",),
    ("rdpi_gym",),
    ("rdpi_gym.cli",),
    ("rdpi_gym.__main__",),
    ("studies",),
)


@cache
def modules():
    """Every module of the project by its dotted name."""
    found = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def imports():
    """The project's modules that each module names in an import, wherever the import stands."""
    graph = {}
    for name, path in modules().items():
        graph[name] = set()
        for node in [node for tree in _trees(path) for node in ast.walk(tree)]:
            if isinstance(node, ast.Import):
                graph[name] |= {_module(alias.name) for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{name}: an import that is relative"
                graph[name] |= {_module(f"{node.module}.{a.name}") for a in node.names}
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                graph[name] |= {_named(node.value, name)}
            elif isinstance(node, ast.JoinedStr) and isinstance(node.values[0], ast.Constant):
                graph[name] |= {_named(node.values[0].value.rpartition(".")[0] + ":", name)}
        graph[name] -= {None, name}
    return graph


def _trees(path):
    """The syntax trees of a module and of its stub."""
    files = (path, path.with_suffix(".pyi"))
    return [ast.parse(file.read_text(encoding="utf-8")) for file in files if file.exists()]


def _named(text, module):
    """The module that a string names, as `dotted.module` or `module:attribute`.

    A package that reads the files of its own folder is no import of itself.
    """
    found, colon, _ = text.partition(":")
    if not colon and "." not in found:  # a word
        return None
    return None if found not in modules() or f"{module}.".startswith(f"{found}.") else found


def _module(dotted):
    while dotted and dotted not in modules():
        dotted = dotted.rpartition(".")[0]
    return dotted or None


def floor(module):
    """The floor of a module: that of the room with the longest name that holds it."""
    levels = {room: level for level, rooms in enumerate(FLOORS) for room in rooms}
    room = module
    while room not in levels:
        room = room.rpartition(".")[0]
        assert room, f"{module} stands in no room of the plan"
    return levels[room], room


def upward_imports():
    """Imports of a room on the same floor or above, as `module -> target`."""
    found = []
    for module, targets in imports().items():
        level, room = floor(module)
        for target in targets:
            above, other = floor(target)
            if other != room and above >= level:
                found.append(f"{module} -> {target}")
    return sorted(found)


def circles():
    """Chains of imports that come back to a module."""
    graph = imports()
    state, stack, found = {}, [], []

    def visit(module):
        state[module] = "open"
        stack.append(module)
        for target in sorted(graph[module]):
            if state.get(target) == "open":
                found.append(" -> ".join([*stack[stack.index(target) :], target]))
            elif target not in state:
                visit(target)
        stack.pop()
        state[module] = "done"

    for module in sorted(graph):
        if module not in state:
            visit(module)
    return found


def imported_once():
    """Modules that exactly one other module imports."""
    importers = {name: set() for name in modules()}
    for module, targets in imports().items():
        for target in targets:
            importers[target].add(module)
    return sorted(
        name
        for name, found in importers.items()
        if len(found) == 1 and modules()[name].name != "__init__.py"
    )


@cache
def word_counts():
    """Words of every page by its path: marks of tables and rules are none."""
    pages = [*ROOT.glob("*.md")]
    for folder in ("docs", "examples", "studies"):
        pages += (ROOT / folder).rglob("*.md")
    made = (ROOT / "docs" / "api" / "generated", ROOT / "docs" / "gallery")  # by `make docs`
    return {
        path.relative_to(ROOT).as_posix(): sum(
            re.search(r"\w", word) is not None for word in path.read_text(encoding="utf-8").split()
        )
        for path in pages
        if not any(map(path.is_relative_to, made))
    }


def sizes():
    """The table of sizes by name."""
    trees = {name: _trees(path) for name, path in modules().items()}
    lines = {
        name: sum(
            file.read_text(encoding="utf-8").count("\n")
            for file in (path, path.with_suffix(".pyi"))
            if file.exists()
        )
        for name, path in modules().items()
    }
    statements = sum(
        isinstance(node, ast.stmt)
        and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
        for parts in trees.values()
        for tree in parts
        for node in ast.walk(tree)
    )
    tests = list((ROOT / "tests").rglob("*.py"))
    return {
        "product lines": sum(lines.values()),
        "product statements": statements,
        "product files": len(modules()),
        "modules with one importer": len(imported_once()),
        "circles": len(circles()),
        "upward imports": len(upward_imports()),
        "test lines": sum(path.read_text(encoding="utf-8").count("\n") for path in tests),
        "words of the longest page": max(word_counts().values()),
        "tests of the first tier": _collected("not slow", "tests"),
        "tests of the second tier": _collected("slow"),
    }


def _collected(tier, *paths):
    """How many tests pytest collects of a tier."""
    words = ["-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider", "-m", tier, *paths]
    run = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True)
    counts = re.findall(r"^(?:(\d+)/\d+|(\d+)) tests collected", run.stdout, re.MULTILINE)
    return int(next(filter(None, counts[-1])))


if __name__ == "__main__":
    for name, value in sizes().items():
        print(f"{name:28}{value:>8}")
