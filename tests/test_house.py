"""The house's plan: imports run down the floors, and no files stand in a circle."""

import ast
from functools import cache
from pathlib import Path

import pytest

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


def test_no_import_runs_up_a_floor():
    wrong = []
    for module, targets in imports().items():
        level, room = floor(module)
        for target in targets:
            above, other = floor(target)
            if other != room and above >= level:
                wrong.append(f"{module} -> {target}")
    assert sorted(wrong) == []


def test_strings_that_name_modules_are_imports():
    assert "baselines" in imports()["rdpi_gym"]  # provide("rdpi_gym.controllers", "baselines:...")
    assert "rdpi_gym.envs.tasks" in imports()["rdpi_gym"]  # f"rdpi_gym.envs.tasks.{...}"
    assert "rdpi_gym.laboratory.opening" in imports()["rdpi_gym"]  # of the stub
    assert "baselines.learned" in imports()["rdpi_gym.face.training"]


def test_no_files_stand_in_a_circle():
    graph = imports()
    state, stack, circles = {}, [], []

    def visit(module):
        state[module] = "open"
        stack.append(module)
        for target in sorted(graph[module]):
            if state.get(target) == "open":
                circles.append(" -> ".join([*stack[stack.index(target) :], target]))
            elif target not in state:
                visit(target)
        stack.pop()
        state[module] = "done"

    for module in sorted(graph):
        if module not in state:
            visit(module)
    assert circles == []


@pytest.mark.parametrize("package", ["rdpi_gym", "baselines", "benchmarks"])
def test_what_is_installed_knows_nothing_of_studies_or_tests(package):
    for module, path in modules().items():
        if module.split(".")[0] == package:
            text = path.read_text(encoding="utf-8")
            assert "import studies" not in text, path
            assert "from studies" not in text, path
            assert "from tests" not in text, path
