"""Studies of the project itself, by name.

    python -m studies                            # what there is
    python -m studies speed vector --rounds 3    # one of them; --help lists its options

Whatever a study writes lies in `studies/results` by default, and takes the place of what is there.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from rdpi_gym.support.command import run_command

_HERE = Path(__file__).parent


def studies() -> dict[str, str]:
    """Return the first line of each study's docstring by the study's name."""
    found = {}
    for path in (*_HERE.glob("[a-z]*.py"), *_HERE.glob("*/__main__.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        if any(_defines_main(item) for item in tree.body):
            inside = path.name == "__main__.py"
            said = path.with_name("__init__.py").read_text(encoding="utf-8") if inside else None
            name = path.parent.name if inside else path.stem
            doc = ast.get_docstring(tree if said is None else ast.parse(said)) or ""
            found[name] = doc.split("\n\n")[0].replace("\n", " ")
    return dict(sorted(found.items()))


def _defines_main(item: ast.stmt) -> bool:
    if isinstance(item, ast.Assign):
        return ast.unparse(item.targets[0]) == "main"
    return isinstance(item, ast.FunctionDef) and item.name == "main"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study that is named, or list them all."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    return run_command("studies", lambda: _run(words))


def _run(words: list[str]) -> int:
    known = studies()
    if not words or words[0] in ("-h", "--help"):
        print(*(f"{name}: {line}" for name, line in known.items()), sep="\n")
        return 0
    from studies.runner import names_of  # pandas, only where a study runs

    (name,) = names_of("study", [words[0].replace("-", "_")], known)
    place = f"studies.{name}.__main__" if (_HERE / name).is_dir() else f"studies.{name}"
    status: int = import_module(place).main(words[1:])
    return status


if __name__ == "__main__":
    sys.exit(main())
