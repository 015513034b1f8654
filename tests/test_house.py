"""The house's plan: imports run down the floors, and no files stand in a circle."""

import pytest

from tests.conftest import SECOND_TIER, TESTS
from tests.house import circles, imports, modules, upward_imports


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
    assert [path for path in SECOND_TIER if not (TESTS / path).exists()] == []
