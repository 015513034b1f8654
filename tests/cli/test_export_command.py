"""`rdpi export c`, `rdpi export fmu`, `rdpi verify`: what they write, and bad input as one line."""

import pytest

import rdpi_gym as rg
from rdpi_gym.cli import main
from tests.firmware.programs import needs_compiler
from tests.looping import over


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@needs_compiler
def test_a_controller_and_what_verify_says(tmp_path, capsys):
    rg.plants["P5"].save("mine.json")
    words = ["mine.json", "--controller", "classical-reference-rate", "--ts", "1e-4", "--out", "fw"]
    assert main(["export", "c", *words]) == 0
    assert "controller classical-reference-rate as C: fw" in capsys.readouterr().out
    assert main(["verify", "fw", "--records", "5", "--samples", "50"]) == 0
    assert capsys.readouterr().out.count("ok") == 9
    path = tmp_path / "fw" / "rdpi_controller.c"
    path.write_text(path.read_text().replace("return command_V;", "return (rdpi_real)0;"))
    assert main(["verify", "fw", "--records", "5", "--samples", "50"]) == 2
    captured = capsys.readouterr()
    assert "FAILED" in captured.out
    assert "fw is not what Python is: vectors in double differ by" in captured.err
    assert captured.err.count("\n") == 1


def test_a_plant_stands_where_no_controller_is_named(tmp_path, capsys):
    assert main(["export", "c", "P5"]) == 0
    assert "plant P5 as C: firmware" in capsys.readouterr().out
    assert (tmp_path / "firmware" / "rdpi_plant.c").exists()


@needs_compiler
def test_an_fmu_of_either_version(tmp_path, capsys):
    assert main(["export", "fmu", "P5"]) == 0
    assert main(["export", "fmu", "P5", "--controller", "pi", "--fmi", "2", "--out", "pi.fmu"]) == 0
    out = capsys.readouterr().out
    assert "plant P5 as an FMU: stage.fmu" in out
    assert (tmp_path / "pi.fmu").stat().st_size > 1000


@over(
    "words, message",
    [
        (["c", "P55"], "'P55' is neither a plant file nor one of"),
        (["c", "P5", "--controller", "clasical-static"], "did you mean 'classical-static'?"),
        (["c", "P5", "--controller", "os:system"], "'os:system' is no controller"),
        (["c", "P5", "--controller", "preview-inversion"], "plans over the whole reference"),
        (["c", "P5", "--controller", "iterative-learning"], "plans over the whole reference"),
        (["c", "P5", "--ts", "0"], "--ts is 0.0; give a sampling time"),
        (["c", "P5", "--ts", "soon"], "Invalid value for '--ts'"),
        (["c", "P5", "--preview", "3"], "--preview is of controllers"),
        (["c", "P5", "--controller", "pi", "--preview", "0"], "--preview is 0"),
        (["c", "P5", "--prefix", "1st"], "--prefix is '1st'; give an identifier of C"),
        (["c", "P5", "--prefix", "../x"], "--prefix is '../x'; give an identifier of C"),
        (["c", "P5", "--prefix", "double"], "--prefix is 'double'; give an identifier of C"),
        (["c", "P5", "--prefix", "math"], "--prefix is 'math'; give an identifier of C"),
        (["c", "P5", "--out", "taken"], "taken holds files and no export of C"),
        (["c", "P5", "--out", "taken/notes.txt"], "notes.txt"),
        (["fmu", "P5", "--out", "stage.zip"], "stage.zip is no file to export to"),
        (["fmu", "P5", "--fmi", "1"], "'1' is not one of"),
        (["results/policy"], "rdpi export onnx POLICY"),
        (["c"], "Missing argument 'MODEL'"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(words, message, tmp_path, capsys):
    (tmp_path / "taken").mkdir(exist_ok=True)
    (tmp_path / "taken" / "notes.txt").write_text("mine")
    assert main(["export", *words]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
    assert [path.name for path in (tmp_path / "taken").iterdir()] == ["notes.txt"]


def test_what_is_no_export_is_not_verified(capsys):
    assert main(["verify", "."]) == 2
    assert "program.json does not exist" in capsys.readouterr().err
