"""From a blank file to a scored compensator on a discovered plant in twelve lines."""

import ast
import runpy
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / "examples" / "twelve_lines.py"


def test_it_is_twelve_lines_and_one_import():
    _, *statements = ast.parse(EXAMPLE.read_text(encoding="utf-8")).body
    assert sum(node.end_lineno - node.lineno + 1 for node in statements) <= 12
    assert sum(isinstance(node, ast.Import | ast.ImportFrom) for node in statements) == 1


def test_it_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    left = runpy.run_path(str(EXAMPLE))
    assert [effect.name for effect in left["found"].plant.effects] == ["creep"]
    assert left["scores"].order == ["extended-inverse", "none"]
    assert "Missing: creep (gain per decade" in capsys.readouterr().out
    assert (tmp_path / "results" / "twelve_lines.html").is_file()
