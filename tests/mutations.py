"""Which planted faults the default tier finds: ``python -m tests.mutations``.

Each fault of ``mutations.toml`` is planted alone in a copy of the checkout, and the default tier's tests
of its room run until one fails; with ``--whole`` the rest of the tier runs where none did. What found it
is a row of ``mutations.csv``. A fault whose place is gone is stated, and fails the command.
"""

import argparse
import ast
import csv
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.copied import copied, failures
from tests.house import PACKAGES, ROOT, imports, modules

HERE = Path(__file__).parent
TABLE = HERE / "mutations.csv"
NOTHING = "-"


@dataclass(frozen=True)
class Fault:
    """A text of a function in another form; `group/name` is what the table calls it."""

    group: str
    name: str
    old: str
    new: str
    function: str | None = None

    @property
    def key(self) -> str:
        return f"{self.group}/{self.name}"


def declared() -> tuple[dict[str, list[str]], list[Fault]]:
    """Rooms by group, and the faults."""
    document = tomllib.loads((HERE / "mutations.toml").read_text(encoding="utf-8"))
    rooms = document.pop("rooms")
    return rooms, [
        Fault(group, name, **fields)
        for group, faults in document.items()
        for name, fields in faults.items()
    ]


def places(fault: Fault, root: Path) -> list[Path]:
    """Files in which the text stands once, in the function of that name where one is stated."""
    held = [
        path for path in _sources(root) if path.read_text(encoding="utf-8").count(fault.old) > 0
    ]
    if fault.function is not None:
        held = [path for path in held if _holds(path, fault)]
    return [path for path in held if path.read_text(encoding="utf-8").count(fault.old) == 1]


def _sources(root: Path) -> Iterator[Path]:
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*")):
            if path.suffix in (".py", ".c", ".h"):
                yield path


def _holds(path: Path, fault: Fault) -> bool:
    source = path.read_text(encoding="utf-8")
    return any(
        isinstance(node, ast.FunctionDef)
        and node.name == fault.function
        and fault.old in (ast.get_source_segment(source, node) or "")
        for node in ast.walk(ast.parse(source))
    )


def plant(fault: Fault, root: Path) -> Path:
    """Write the fault into a copy, without the compiled code of what imports its file."""
    found = places(fault, root)
    if len(found) != 1:
        where = f" ({', '.join(str(path.relative_to(root)) for path in found)})" if found else ""
        raise LookupError(f"{fault.key}: its text stands in {len(found)} places{where}")
    path = found[0]
    path.write_text(
        path.read_text(encoding="utf-8").replace(fault.old, fault.new), encoding="utf-8"
    )
    if path.suffix == ".py" and "njit" in path.read_text(encoding="utf-8"):
        for module in _importers(path.relative_to(root)):
            for cached in (root / module).parent.glob(f"__pycache__/{module.stem}.*.nb[ci]"):
                cached.unlink()
    return path


def _importers(file: Path) -> set[Path]:
    """The file and all that import it, at any remove, relative to the root."""
    names = {path.relative_to(ROOT): name for name, path in modules().items()}
    found, waiting = set[str](), {names[file]}
    while waiting:
        found |= waiting
        waiting = {name for name, targets in imports().items() if targets & waiting} - found
    return {modules()[name].relative_to(ROOT) for name in found}


def files_of(rooms: list[str], near: Path, first: str, root: Path) -> list[str]:
    """Test files of rooms: that which found the fault before, then by words shared with its file."""
    words = set(re.findall(r"[a-z]+", near.with_suffix("").as_posix()))
    files = [path for room in rooms for path in (root / "tests" / room).rglob("test_*.py")]
    own = [path.relative_to(root).as_posix() for path in files]
    return sorted(own, key=lambda f: (f != first, -len(words & set(re.findall(r"[a-z]+", f))), f))


def finder(root: Path, clean: Path, files: list[str]) -> str:
    """The first test that fails, again alone, and not in a clean copy; or NOTHING."""
    passed_over: list[str] = []
    try:
        while found := failures(root, files, "-x", *passed_over, may_be_none=True):
            if failures(root, found) and not failures(clean, found):
                return found[0]
            passed_over += ["--deselect", found[0]]
    except subprocess.TimeoutExpired:
        return "the time"
    return NOTHING


def read_table(path: Path) -> dict[str, str]:
    """What found each fault, as it was written down."""
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as stream:
        return {row["fault"]: row["found_by"] for row in csv.DictReader(stream)}


def write_table(path: Path, found: dict[str, str]) -> None:
    """Write the table in the order of the declarations."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("fault", "found_by"))
        writer.writerows((f.key, found[f.key]) for f in declared()[1] if f.key in found)


def main() -> int:
    """Plant the faults that are asked for, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="faults whose name holds this text")
    parser.add_argument("--near", type=int, help="of the room, so many test files alone")
    parser.add_argument("--whole", action="store_true", help="then the rest of the default tier")
    parser.add_argument("--check", action="store_true", help="look for the places alone")
    parser.add_argument("--table", type=Path, help="where rows are written; found ones stay")
    arguments = parser.parse_args()
    rooms, faults = declared()
    faults = [fault for fault in faults if arguments.only in fault.key]
    before, found = read_table(TABLE), read_table(arguments.table) if arguments.table else {}
    gone = [fault for fault in faults if len(places(fault, ROOT)) != 1]
    for fault in gone:
        print(f"gone: {fault.key}: {fault.old!r} stands in {len(places(fault, ROOT))} places")
    if arguments.check:
        return int(bool(gone))
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        whole, copy = Path(folder) / "whole", Path(folder) / "copy"
        copied(whole)
        for fault in faults:
            if fault in gone or found.get(fault.key, NOTHING) != NOTHING:
                continue
            shutil.rmtree(copy, ignore_errors=True)
            copied(copy, source=whole)
            near = plant(fault, copy).relative_to(copy)
            first = before.get(fault.key, "").partition("::")[0]
            by = finder(
                copy, whole, files_of(rooms[fault.group], near, first, copy)[: arguments.near]
            )
            if by == NOTHING and arguments.whole:
                others = {path.name for path in (copy / "tests").iterdir() if path.is_dir()}
                rest = sorted(others - {*rooms[fault.group]})
                by = finder(copy, whole, files_of(rest, near, first, copy))
            found[fault.key] = by
            if arguments.table:
                write_table(arguments.table, found)
            print(f"{fault.key:58} {by}", flush=True)
    missed = [key for key, by in found.items() if by == NOTHING]
    print(f"{len(found) - len(missed)} of {len(found)} found")
    return int(bool(gone))


if __name__ == "__main__":
    sys.exit(main())
