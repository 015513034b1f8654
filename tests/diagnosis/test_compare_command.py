"""`rdpi compare`: what it writes, and the one line that bad input gets."""

import json

import numpy as np
import pytest

from rdpi_gym.cli import main
from rdpi_gym.measurement import write_csv
from rdpi_gym.plant import P5, PlantModel
from rdpi_gym.plant.cores.bouc_wen import BoucWen


@pytest.fixture
def data(sine_record, tmp_path):
    folder = tmp_path / "data"
    write_csv(sine_record(P5, noise_um=0.02), folder / "slow.csv")
    write_csv(sine_record(P5, 50.0, noise_um=0.02), folder / "fast.csv")
    return folder


def test_named_plant(data, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["compare", str(data), "--model", "P5", "--out", str(out)]
    assert main([*words, "--verbose"]) == 0
    document = json.loads((out / "compare.json").read_text(encoding="utf-8"))
    assert document["format"] == "rdpi-compare"
    assert document["version"] == 1
    assert document["validation_rmse_um"] == pytest.approx(0.02, rel=0.1)
    assert {row["name"] for row in document["records"]} == {"slow", "fast"}
    assert {row["role"] for row in document["records"]} == {"train", "validation"}
    needed = {"name", "role", "rmse_um", "nrmse_percent", "max_um", "offset_um", "samples", "ts_s"}
    assert needed <= document["records"][0].keys()
    assert np.shape(document["by_command_and_rate"]["mean_um"]) == np.shape(
        document["by_command_and_rate"]["samples"]
    )
    assert document["noise_floor_um"] == pytest.approx(0.02, rel=0.1)
    assert {"spectrum", "distortion", "since_rest", "clock", "checks"} <= document.keys()
    printed = capsys.readouterr().out
    assert str(out / "report.html") in printed
    for finding in document["findings"]:
        assert finding in printed
    assert sorted(file.name for file in out.iterdir()) == ["compare.json", "report.html"]


def test_plant_file_and_single_record(data, tmp_path):
    model = P5.save(tmp_path / "model.json")
    out = tmp_path / "out"
    assert main(["compare", str(data / "slow.csv"), "--model", str(model), "--out", str(out)]) == 0
    assert (out / "report.html").stat().st_size > 1e6


def test_data_options_reach_the_reader(data, tmp_path):
    out = tmp_path / "out"
    options = ["--units", "y=nm", "--skip", "0.02", "--validate", "fast"]
    model = ["--model", "P5", "--out", str(out)]
    assert main(["compare", str(data), *model, *options]) == 0
    document = json.loads((out / "compare.json").read_text(encoding="utf-8"))
    assert "close to 10^-3" in document["findings"][0]
    assert any("left out: the first 0.02 s" in line for line in document["left_out"])
    roles = {row["name"]: row["role"] for row in document["records"]}
    assert roles == {"slow": "train", "fast": "validation"}


def refused(arguments, capsys):
    assert main(["compare", *map(str, arguments)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    return printed.err


def test_missing_model_file(data, tmp_path, capsys):
    out = tmp_path / "out"
    line = refused([data, "--model", "no_model.json", "--out", out], capsys)
    assert "'no_model.json' is neither a plant file nor one of P5" in line
    assert not out.exists()


def test_truncated_model_file(data, tmp_path, capsys):
    model = P5.save(tmp_path / "model.json")
    model.write_text(model.read_text()[:100])
    line = refused([data, "--model", model, "--out", tmp_path / "out"], capsys)
    assert "model.json" in line
    assert "not whole JSON" in line


def test_foreign_model_file(data, tmp_path, capsys):
    model = tmp_path / "model.json"
    model.write_text('{"format": "something", "version": 1}')
    assert "is not a rdpi-plant file" in refused([data, "--model", model], capsys)


def test_missing_data(tmp_path, capsys):
    assert "nowhere does not exist" in refused([tmp_path / "nowhere", "--model", "P5"], capsys)


def test_unknown_kind_of_data_file(tmp_path, capsys):
    (tmp_path / "data.xlsx").write_text("")
    line = refused([tmp_path / "data.xlsx", "--model", "P5"], capsys)
    assert "'.xlsx' are not read" in line


def test_no_model_given(data, capsys):
    assert "--model" in refused([data], capsys)


def test_output_folder_that_is_a_file(data, tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    line = refused([data, "--model", "P5", "--out", tmp_path / "taken" / "out"], capsys)
    assert "cannot be written" in line


def test_several_models_beside_each_other(data, tmp_path, capsys):
    files = [P5.save(tmp_path / folder / "model.json") for folder in ("one", "two")]
    wen = PlantModel(BoucWen(1.2, -0.4, 8.0, 0.7, 1.4), "wen", (-25.0, 25.0), (0.0, 10.0))
    other = wen.save(tmp_path / "wen.json")
    out = tmp_path / "out"
    names = ["P5-static", *map(str, files), str(other)]
    options = [word for name in names for word in ("--model", name)]
    assert main(["compare", str(data), *options, "--out", str(out)]) == 0
    document = json.loads((out / "compare.json").read_text(encoding="utf-8"))
    models = document["models"]
    assert [m["model"]["name"] for m in models] == ["P5-static", "one", "two", "wen"]
    assert [m["model"]["core"] for m in models] == ["rdpi", "rdpi", "rdpi", "bouc_wen"]
    static, one, two, _ = models
    assert one["validation_rmse_um"] == two["validation_rmse_um"] < static["validation_rmse_um"]
    assert {"records", "by_frequency", "spectrum", "since_rest"} <= one.keys()
    best = document["best"]
    assert {row["best"] for row in best["by_frequency"][1:]} == {"one, two"}
    (held_out,) = (row for row in best["records"] if row["record"] == "all validation")
    assert held_out["rmse_um"]["one"] == one["validation_rmse_um"]
    assert held_out["noise_floor"] == document["noise_floor_um"]
    printed = capsys.readouterr().out
    assert "one and two are nearest with 0.02" in printed
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "4 models against measurement" in page
    assert "Where wen fails" in page


def test_models_of_other_quantities_and_too_many_are_refused(data, tmp_path, capsys):
    line = refused([data, "--model", "P5", "--model", "friction_damper-stop"], capsys)
    assert "model friction_damper-stop turns mm into kN, and these data have V and µm" in line
    seven = [word for _ in range(7) for word in ("--model", "P5")]
    assert "7 models are more than a page shows clearly; give 6" in refused([data, *seven], capsys)
