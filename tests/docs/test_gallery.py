"""Every notebook of the gallery runs from start to end, in a process of its own."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "gallery").glob("*.py"))
LIMIT_S = 240


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS])
def test_notebook_runs(notebook, tmp_path):
    if "stable_baselines3" in notebook.read_text(encoding="utf-8"):
        pytest.importorskip("stable_baselines3", reason="the extra rl brings it")
    own = {
        "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", "COLUMNS": "100", "OMP_NUM_THREADS": "1",
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-W", "error::DeprecationWarning:__main__", str(notebook)],
        cwd=tmp_path, env=os.environ | own, capture_output=True, text=True, check=False,
        timeout=LIMIT_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    assert not list(tmp_path.iterdir()), "a notebook leaves no file behind"


def test_the_gallery_shows_each_of_the_uses():
    titles = {path.stem: path.read_text(encoding="utf-8").splitlines()[1] for path in NOTEBOOKS}
    assert {
        "score_a_controller", "fit_a_record", "find_a_missing_effect", "train_an_agent",
        "add_an_effect", "read_the_claim",
    } <= set(titles)  # fmt: skip
    for name, title in titles.items():
        underline = (
            (ROOT / "examples" / "gallery" / f"{name}.py").read_text("utf-8").splitlines()[2]
        )
        assert re.fullmatch("=+", underline), name
        assert len(underline) == len(title), name
