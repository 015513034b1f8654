"""The house's plan: imports run down the floors, no files stand in a circle, pages are short."""

import re
import tomllib

import pytest

from tests.conftest import BEGUN_FIRST, SECOND_TIER, TESTS
from tests.house import (
    ROOT,
    circles,
    imports,
    modules,
    upward_imports,
    word_counts,
)

LONGEST_PAGE_WORDS = 3000
"""Ten minutes of reading; what is longer is a table, and stands in a file beside its page."""


def test_no_import_runs_up_a_floor():
    assert upward_imports() == []


def test_strings_that_name_modules_are_imports():
    assert "baselines" in imports()["rdpi_gym"]  # provide("rdpi_gym.controllers", "baselines:...")
    assert "rdpi_gym.envs.tasks" in imports()["rdpi_gym"]  # f"rdpi_gym.envs.tasks.{...}"
    assert "rdpi_gym.laboratory.opening" in imports()["rdpi_gym"]  # of the stub
    # among modules whose source is hashed
    assert "baselines.learned.controller" in imports()["benchmarks.tracking.controllers"]


def test_an_import_inside_a_function_is_one():
    assert "baselines.learned.training" in imports()["rdpi_gym.face.training"]


def test_no_files_stand_in_a_circle():
    assert circles() == []


@pytest.mark.parametrize("package", ["rdpi_gym", "baselines", "benchmarks"])
def test_installed_packages_import_no_studies_and_no_tests(package):
    for module, path in modules().items():
        if module.split(".")[0] == package:
            text = path.read_text(encoding="utf-8")
            assert "import studies" not in text, path
            assert "from studies" not in text, path
            assert "from tests" not in text, path


def test_paths_of_the_second_tier_exist():
    assert [path for path in (*SECOND_TIER, *BEGUN_FIRST) if not (TESTS / path).exists()] == []


def test_no_page_is_longer_than_a_reader_reads():
    pages = word_counts()
    assert {"README.md", "docs/index.md", "studies/results/stages/tasks.md"} <= set(pages)
    assert {name: count for name, count in pages.items() if count > LONGEST_PAGE_WORDS} == {}


def test_pythons_of_the_matrix_are_those_that_the_package_names():
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    named = re.findall(r":: (3\.\d+)$", "\n".join(project["classifiers"]), flags=re.M)
    make = re.search(r"^PYTHONS \?= (.*)$", (ROOT / "Makefile").read_text("utf-8"), flags=re.M)
    hosted = re.search(
        r"^ +python: \[(.*)\]$", (ROOT / ".github/workflows/tests.yml").read_text("utf-8"), re.M
    )
    assert project["requires-python"] == f">={named[0]}"
    assert make[1].split() == re.findall(r'"(.*?)"', hosted[1]) == named
