"""The command line is a thin layer over the face: the same numbers from both, and nothing behind it."""

import ast
import json
from pathlib import Path

import pytest

import rdpi_gym as rg
from rdpi_gym import cli, measurement
from rdpi_gym.cli import main
from rdpi_gym.plant import PlantModel
from tests.looping import over

FOLDER = Path(cli.__file__).parent
# What a command may know besides `import rdpi_gym as rg`.
# the laboratory stands on the face, as commands do
KNOWN = ("rdpi_gym.cli", "rdpi_gym.support", "rdpi_gym.face.options", "rdpi_gym.laboratory")


def read(path):
    document = json.loads(Path(path).read_text(encoding="utf-8"))
    document.pop("seconds", None)
    return document


@pytest.fixture(scope="module")
def folder(data, tmp_path_factory):
    few = data.select("stairs", "sine-*", "validation-stairs", "quiet")
    return few.write(tmp_path_factory.mktemp("records") / "data")


def run(*words):
    assert main([str(word) for word in words]) == 0


def test_fit(folder, tmp_path):
    run("fit", folder, "--plays", 5, "--skip", 0.001, "--out", tmp_path)
    model = rg.fit(rg.load(folder, skip_s=0.001), plays=5)
    assert PlantModel.load(tmp_path / "model.json").to_dict() == model.plant.to_dict()


def test_fit_of_an_example_with_options_of_data(tmp_path):
    run("fit", "--example", "picma", "--plays", 3, "--skip", 2.0, "--out", tmp_path)
    model = rg.fit(rg.load(measurement.example_folder("picma"), skip_s=2.0), plays=3)
    assert PlantModel.load(tmp_path / "model.json").to_dict() == model.plant.to_dict()


def test_fit_of_another_kind_of_hysteresis(folder, tmp_path, capsys):
    run("fit", folder, "--core", "stop", "--out", tmp_path)
    model = rg.fit_core(rg.load(folder), "stop")
    assert PlantModel.load(tmp_path / "model.json") == model.plant
    assert main(["fit", str(folder), "--core", "stpo", "--out", str(tmp_path)]) == 2
    assert "'stpo' is unknown (did you mean 'stop'?)" in capsys.readouterr().err
    assert main(["fit", str(folder), "--core", "stop", "--plays", "3"]) == 2
    assert "--plays, --free-memory and --rate-bandwidth belong to the core rdpi" in (
        capsys.readouterr().err
    )


@pytest.mark.slow
def test_fit_chooses_the_kind_of_hysteresis(folder, tmp_path, capsys):
    run("fit", folder, "--core", "auto", "--out", tmp_path)
    said = capsys.readouterr().out
    assert "Kind of hysteresis: rdpi, the rate-dependent Prandtl-Ishlinskii model." in said
    assert "The loops turn counter-clockwise." in said
    assert "Fitted beside it: creep (" in said
    found = rg.choose_kind(rg.load(folder))
    assert PlantModel.load(tmp_path / "model.json") == found.plant
    again = rg.load_result(found.save(tmp_path / "kinds.npz"))
    assert repr(again) == repr(found)
    assert again.plant == found.plant


def test_compare(folder, tmp_path):
    run("compare", folder, "--model", "P5", "--validate", "sine-5*", "--out", tmp_path)
    result = rg.compare(rg.load(folder, validate="sine-5*"), "P5")
    assert read(tmp_path / "compare.json") == json.loads(json.dumps(result.to_dict()))


@pytest.mark.slow
def test_add(folder, tmp_path):
    run("add", "creep", folder, "--model", "P5", "--jobs", 1, "--out", tmp_path / "command")
    found = rg.add("creep", folder, "P5", jobs=1)
    assert read(tmp_path / "command" / "add.json") == read(found.to_json(tmp_path / "add.json"))


@pytest.mark.slow
def test_diagnose(folder, tmp_path):
    run("diagnose", folder, "--seed", 3, "--jobs", 1, "--out", tmp_path / "command")
    found = rg.diagnose(folder, seed=3, jobs=1)
    written = found.to_json(tmp_path / "diagnosis.json")
    assert read(tmp_path / "command" / "diagnosis.json") == read(written)


def test_simulate(tmp_path):
    run(
        "simulate",
        "--model",
        "P5",
        "--hide",
        "creep",
        "--seed",
        2,
        "--ts-factor",
        4,
        "--out",
        tmp_path,
    )
    data = rg.simulate("P5", ["creep"], seed=2, ts_factor=4.0)
    assert read(tmp_path / "truth.json") == read(data.truth.save(tmp_path / "mine.json"))
    again = rg.load(data.write(tmp_path / "mine"))
    command = rg.load(tmp_path / "data")
    for one, other in zip(command.records, again.records, strict=True):
        assert (one.y_um == other.y_um).all()


def test_effects(tmp_path):
    run("effects", "creep", "--out", tmp_path / "command")
    json_file, page = rg.effects.write(tmp_path / "mine", "creep")
    assert read(tmp_path / "command" / "effects.json") == read(json_file)
    assert (tmp_path / "command" / "effects.md").read_text() == page.read_text()


@over("file", sorted(FOLDER.glob("*.py")))
def test_a_command_knows_the_face_alone(file):
    tree = ast.parse(file.read_text(encoding="utf-8"))
    found = [alias.name for n in ast.walk(tree) if isinstance(n, ast.Import) for alias in n.names]
    found += [n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    rooms = ("rdpi_gym", "baselines", "benchmarks", "studies")
    ours = [name for name in found if name.partition(".")[0] in rooms and name != "rdpi_gym"]
    assert [name for name in ours if not name.startswith(KNOWN)] == []


def test_options_of_data_and_search_are_written_once():
    # no command states one of them by itself
    from rdpi_gym.face.options import CandidateOptions, DataOptions
    from rdpi_gym.support.options import option_fields

    flags = {o.flag for kind in (DataOptions, CandidateOptions) for _, o, _ in option_fields(kind)}
    shared = flags - {"--model", "--core", "--seed", "--jobs"}  # other commands have their own
    for file in FOLDER.glob("*.py"):
        assert not shared & {
            node.value
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
        }
