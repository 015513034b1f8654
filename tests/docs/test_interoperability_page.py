"""The page on other libraries: its lines run as they stand; RLlib's in tests/envs/test_rllib.py."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer

from rdpi_gym.cli.export import export

PAGE = (Path(__file__).parents[2] / "docs" / "interoperability.md").read_text(encoding="utf-8")


def blocks(title):
    """Return the snippets of a section, each with its language."""
    (section,) = re.findall(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", PAGE, re.S | re.M)
    return re.findall(r"^```(\w+)\n(.*?)^```", section, re.S | re.M)


def run(code):
    names = {}
    exec(compile(code, "interoperability.md", "exec"), names)
    return names


def test_gymnasiums_wrappers():
    ((language, code),) = blocks("Gymnasium's vector wrappers")
    assert language == "python"
    names = run(code)
    np.testing.assert_array_equal(names["infos"]["episode"]["l"], [50] * 4)
    assert (names["infos"]["episode"]["r"] < 0.0).all()


def test_a_policy_from_scratch_is_exported_and_run(tmp_path, monkeypatch):
    pytest.importorskip("torch")
    pytest.importorskip("onnxscript")
    pytest.importorskip("onnxruntime")
    monkeypatch.chdir(tmp_path)
    ((_, training),) = blocks("PPO in plain torch")
    words = shlex.split(training)
    assert words[0] == "python"
    subprocess.run([sys.executable, *words[1:]], check=True, capture_output=True)
    assert (tmp_path / "results" / "scratch" / "training.csv").is_file()
    (_, exporting), (_, code) = blocks("ONNX")
    words = shlex.split(exporting)
    assert words[:2] == ["rdpi", "export"]
    app = typer.Typer()
    app.command(name="export")(export)
    app(args=words[2:], standalone_mode=False)
    names = run(code)
    assert names["action"].shape == (7, 1)
    assert names["about"]["layout"]["action"] == "correction"
