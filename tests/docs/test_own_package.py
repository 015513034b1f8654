"""A laboratory's own package, installed as README.md beside it says: its effect and controller are found."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "own_package"
README = (EXAMPLE / "README.md").read_text(encoding="utf-8")


def commands():
    (block,) = re.findall(r"^```bash\n(.*?)^```$", README, re.M | re.S)
    return [shlex.split(line) for line in block.splitlines()]


def run(words, cwd, site=None):
    path = [str(ROOT), *([str(site)] if site else [])]
    own = {"PYTHONPATH": os.pathsep.join(path), "COLUMNS": "120", "NO_COLOR": "1"}
    done = subprocess.run(
        words, cwd=cwd, env=os.environ | own, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A copy of the package, installed without network into a folder of its own."""
    folder = tmp_path_factory.mktemp("own")
    source = shutil.copytree(
        EXAMPLE,
        folder / "source",
        ignore=shutil.ignore_patterns("*.egg-info", "__pycache__", "build"),
    )
    install, *_ = commands()
    assert install[:2] == ["pip", "install"]
    words = [
        sys.executable,
        "-m",
        *install,
        "--target",
        str(folder / "site"),
        "--no-index",
        "--quiet",
    ]
    # a target folder takes no editable install; everything else is as the README says
    run([word for word in words if word != "--editable"], source)
    return source, folder / "site"


def test_its_commands_show_effect_and_controller(installed):
    source, site = installed
    _, effect, bench = commands()
    rdpi = [sys.executable, "-m", "rdpi_gym"]
    assert "µm" in run([*rdpi, *effect[1:]], source, site)
    assert "self_heating" in run([*rdpi, "effects"], source, site)
    assert "lead" in run([*rdpi, *bench[1:]], source, site)
    assert (source / "results" / "lead" / "leaderboard.md").is_file()


def test_its_effect_is_a_candidate_and_a_saved_model_finds_it(installed, tmp_path):
    _, site = installed
    code = (
        "from dataclasses import replace\n"
        "from rdpi_gym.plant import P5, PlantModel\n"
        "from rdpi_gym.plant.effects import CATALOGUE\n"
        "replace(P5, effects=(CATALOGUE['self_heating'](),)).save('model.json')\n"
        "print(PlantModel.load('model.json').effects[0].name, len(CATALOGUE))\n"
    )
    name, count = run([sys.executable, "-c", code], tmp_path, site).split()
    assert (name, int(count)) == ("self_heating", 16)


def test_its_own_tests_pass(installed):
    source, site = installed
    said = run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"], source, site
    )
    assert "2 passed" in said
