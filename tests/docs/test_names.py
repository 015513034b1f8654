"""Files, folders and modules that texts name are there."""

import re
from pathlib import Path

import rdpi_gym
from tests.looping import over

ROOT = Path(__file__).parents[2]
ROOMS = "rdpi_gym|baselines|benchmarks|studies|tests|docs|examples"
WRITTEN = {"effects.md"}
"""Pages that a command writes for the user."""
FORMER = ROOT / "rdpi_gym" / "support" / "renamed.py"
"""Names that are no longer there, by intention."""
BUILT = ("docs/api/generated", "docs/gallery", "docs/_build")
"""Folders that `make docs` makes."""

_PATH = re.compile(rf"(?<![\w/.])(?:{ROOMS})(?:/[\w-][\w.-]*)+(?![\w*{{])")
_PAGE = re.compile(r"[\w./-]*\w\.md\b")
_MODULE = re.compile(r"\b(?:rdpi_gym|baselines|benchmarks|studies)(?:\.[a-z]\w*)+(?![\w*{])")
_ENVIRONMENT = re.compile(r"rdpi_gym/\w+-v\d+")


def texts():
    """Everything that is read: pages, and the code of the package with its docstrings."""
    places = [
        ROOT / name
        for name in ("rdpi_gym", "baselines", "benchmarks", "studies", "docs", "examples")
    ]
    found = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "Makefile"]
    for place in places:
        found += [p for kind in ("*.py", "*.md", "*.toml") for p in place.rglob(kind)]
    return [
        path
        for path in found
        if path.exists()
        and path != FORMER
        and not path.relative_to(ROOT).as_posix().startswith(BUILT)
    ]


TEXTS = texts()
PAGES = {path.name for path in TEXTS if path.suffix == ".md"} | {"CHANGELOG.md"} | WRITTEN


def is_there(path):
    """Whether there is a file, a folder of files, or a module or page that lacks its ending."""
    if path.is_dir():
        return any(p.is_file() and p.parent.name != "__pycache__" for p in path.rglob("*"))
    return any(path.with_name(path.name + ending).is_file() for ending in ("", ".py", ".md"))


def missing_path(name, folder):
    """Whether a path is there neither from the project's folder nor from that of the text."""
    name = name.rstrip(".")
    if _ENVIRONMENT.fullmatch(name) or name.startswith(BUILT):
        return False
    return not (is_there(ROOT / name) or is_there(folder / name))


def missing_module(name):
    """Whether a dotted name leads to no module, or to one that does not know the next part."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        path = ROOT.joinpath(*parts[:count])
        for file in (path / "__init__.py", path.with_name(f"{path.name}.py")):
            if file.exists():
                text, rest = file.read_text(encoding="utf-8"), parts[count:]
                if parts[:count] == ["rdpi_gym"]:  # its names stand in stubs
                    text += " ".join(rdpi_gym.__all__)
                return bool(rest) and not re.search(rf"\b{rest[0]}", text)
    return True


def dangling(text, folder=ROOT):
    """Return the names in a text that lead nowhere."""
    found = {name for name in _PATH.findall(text) if missing_path(name, folder)}
    found |= {name for name in _PAGE.findall(text) if Path(name).name not in PAGES}
    return found | {name for name in _MODULE.findall(text) if missing_module(name)}


def test_every_name_leads_somewhere():
    found = {
        path.relative_to(ROOT).as_posix(): sorted(names)
        for path in TEXTS
        if (names := dangling(path.read_text(encoding="utf-8"), path.parent))
    }
    assert found == {}


@over(
    "text, names",
    [
        ("see docs/diagnosis.md and `docs/laboratory.md`", {"docs/diagnosis.md"}),
        ("theory.md, section 1", {"theory.md"}),
        ("integrated by `benchmarks/independent`", {"benchmarks/independent"}),
        ("`python -m benchmarks.vector_speed`", {"benchmarks.vector_speed"}),
        (":func:`rdpi_gym.diagnosis.comparison.compare`", set()),
        ("gym.make('rdpi_gym/PiezoTracking-v0')", set()),
        ("rdpi_gym/diagnosis/features/noise.py", set()),
    ],
)
def test_what_leads_nowhere_is_noticed(text, names):
    assert dangling(text) == names


def test_every_picture_of_a_page_has_alternative_text():
    pictures = re.compile(r"!\[([^\]]*)\]\(")
    found = [
        p
        for path in texts()
        if path.suffix == ".md"
        for p in pictures.findall(path.read_text("utf-8"))
    ]
    assert len(found) > 20
    assert all(text.strip() for text in found)
