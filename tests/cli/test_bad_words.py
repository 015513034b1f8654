"""Words of the command line that name nothing harmless: refused in one line."""

from __future__ import annotations

from rdpi_gym.cli import main
from tests.looping import over


def refused(capsys, *words: str) -> str:
    assert main([*words]) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    return captured.err


def test_no_command_names_one_to_begin_with(capsys):
    assert "no command; give one, as in fit --example picma" in refused(capsys)


def test_empty_data_are_not_the_current_folder(tmp_path_factory, capsys, monkeypatch, subtests):
    for command in ["fit", "compare", "diagnose", "discover"]:
        with subtests.test(command=command):
            tmp_path = tmp_path_factory.mktemp("case")
            rows = "".join(f"{0.01 * k},{k % 7},{k % 7}\n" for k in range(60))
            (tmp_path / "run.csv").write_text(f"t,u,y\n{rows}")
            monkeypatch.chdir(tmp_path)
            model = ["--model", "P5"] if command == "compare" else []
            line = refused(capsys, command, "", *model, "--out", str(tmp_path / "out"))
            assert "DATA is empty; give a data file or a folder" in line
            assert not (tmp_path / "out").exists()


@over(
    "words",
    [["fit"], ["compare", "--model", "P5"], ["diagnose"], ["add", "creep"], ["discover"], ["lab"]],
)
def test_an_example_stands_in_place_of_data(words, capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "no example is named 'pcma'; there is picma" in refused(
        capsys, *words, "--example", "pcma"
    )
    both = refused(capsys, *words, "run.csv", "--example", "picma")
    assert "--example 'picma' stands in place of DATA; give one of them" in both
    if words != ["lab"]:  # which files may be dropped on
        assert "DATA is missing; give a data file, a folder" in refused(capsys, *words)
    assert not list(tmp_path.iterdir())


def test_a_plant_that_is_none_is_not_called(tmp_path_factory, capsys, subtests):
    for name in ["os:system", "os:abort", "os:getcwd", "math:pi", "sys:exit"]:
        with subtests.test(name=name):
            tmp_path = tmp_path_factory.mktemp("case")
            line = refused(capsys, "bench", "--plant", name, "--out", str(tmp_path / "out"))
            assert f"{name!r} is " in line
            assert "give a rdpi_gym.plant.PlantModel" in line


def test_a_name_that_no_module_has(tmp_path_factory, capsys, subtests):
    for name in [".:x", "..:x", "a..b:x", ":x", "os:"]:
        with subtests.test(name=name):
            tmp_path = tmp_path_factory.mktemp("case")
            refused(capsys, "bench", "--plant", name, "--out", str(tmp_path / "out"))
