"""Words of the command line that name nothing harmless: refused in one line."""

from __future__ import annotations

import pytest

from rdpi_gym.cli import main


def refused(capsys, *words: str) -> str:
    assert main([*words]) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    return captured.err


@pytest.mark.parametrize("command", ["fit", "compare", "diagnose", "discover"])
def test_empty_data_are_not_the_current_folder(tmp_path, capsys, monkeypatch, command) -> None:
    rows = "".join(f"{0.01 * k},{k % 7},{k % 7}\n" for k in range(60))
    (tmp_path / "run.csv").write_text(f"t,u,y\n{rows}")
    monkeypatch.chdir(tmp_path)
    model = ["--model", "P5"] if command == "compare" else []
    line = refused(capsys, command, "", *model, "--out", str(tmp_path / "out"))
    assert "DATA is empty; give a data file or a folder" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["os:system", "os:abort", "os:getcwd", "math:pi", "sys:exit"])
def test_a_plant_that_is_none_is_not_called(tmp_path, capsys, name) -> None:
    line = refused(capsys, "bench", "--plant", name, "--out", str(tmp_path / "out"))
    assert f"{name!r} is " in line
    assert "give a rdpi_gym.plant.PlantModel" in line


@pytest.mark.parametrize("name", [".:x", "..:x", "a..b:x", ":x", "os:"])
def test_a_name_that_no_module_has(tmp_path, capsys, name) -> None:
    refused(capsys, "bench", "--plant", name, "--out", str(tmp_path / "out"))
