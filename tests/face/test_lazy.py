"""`import rdpi_gym` and `rdpi --help` are quick: what is heavy is loaded when it is used."""

import json
import subprocess
import sys

import pytest

import rdpi_gym as rg
from tests.looping import over

HEAVY = (
    "torch", "plotly", "matplotlib", "pandas", "scipy", "scipy.signal", "numba", "h5py", "joblib",
)  # fmt: skip


def loaded_by(statement):
    """Names of the heavy packages in a fresh process after a statement."""
    code = f"{statement}\nimport json, sys\nprint(json.dumps([m for m in {HEAVY!r} if m in sys.modules]))"
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    return json.loads(answer.stdout.splitlines()[-1])


@over(
    "statement",
    [
        "import rdpi_gym",
        "import rdpi_gym as rg; dir(rg); repr(rg.InputError)",
        "from rdpi_gym.cli import main; main(['--help'])",
        "from rdpi_gym.cli import main; main(['discover', '--help'])",
    ],
)
def test_nothing_heavy_is_loaded(statement):
    assert loaded_by(statement) == []


@pytest.mark.slow
def test_plots_alone_load_matplotlib():
    statement = "import rdpi_gym as rg; rg.make_controller('none', 'P5'); rg.plants['P5']"
    assert not {"matplotlib", "plotly", "torch"} & set(loaded_by(statement))


def test_environments_and_controllers_load_no_filters():
    assert loaded_by("import rdpi_gym.envs, baselines") == ["scipy", "numba"]


def test_every_name_is_there_and_listed():
    for name in rg.__all__:
        assert getattr(rg, name) is not None
        assert name in dir(rg)


def test_a_name_that_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'dicsover'"):
        rg.dicsover  # noqa: B018
