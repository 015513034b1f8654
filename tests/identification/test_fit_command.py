"""`rdpi fit`, through the function that the command runs."""

import json

import numpy as np
import pytest

from rdpi_gym.cli import main
from rdpi_gym.plant import P5, Plant, PlantModel, settled_memory
from tests.looping import over


def write(path, frequency_hz, *, sign=1.0, extremum_V=0.0):
    t = np.arange(0.0, 3 / frequency_hz, 1 / frequency_hz / 300)
    u = 20.0 * np.sin(2 * np.pi * frequency_hz * t)
    plant = Plant(P5, t[1])
    plant.reset(memory=settled_memory(P5.hysteresis.thresholds_V, [extremum_V]))
    y = sign * plant.simulate(u) + 0.01 * np.random.default_rng(0).standard_normal(t.size)
    lines = ["t,u,y", *(f"{a:.9g},{b:.12g},{c:.12g}" for a, b, c in zip(t, u, y, strict=True))]
    path.write_text("\n".join(lines))


@pytest.fixture
def folder(tmp_path):
    data = tmp_path / "data"
    data.mkdir()
    write(data / "slow.csv", 5.0)
    write(data / "fast.csv", 50.0)
    write(data / "validation.csv", 20.0)
    return data


def test_a_folder_gives_a_plant_and_a_table(folder, tmp_path, capsys):
    out = tmp_path / "fit"
    assert main(["fit", str(folder), "--out", str(out), "-n", "5", "--seed", "3", "--verbose"]) == 0
    model = PlantModel.load(out / "model.json")
    assert model.hysteresis.thresholds_V[0] == pytest.approx(1.75, rel=0.02)
    assert model.hysteresis.delta2_s == pytest.approx(3.762e-4, rel=0.02)
    assert sorted(model.identification["records"]) == ["fast", "slow"]
    shown = capsys.readouterr().out
    for words in (
        "δ1",
        "δ2",
        "a_5",
        "offset of slow",
        "95 % interval",
        "rms on validation records",
        "20 Hz",
    ):
        assert (words in shown) == (words != "20 Hz")
    assert str(out / "model.json") in shown
    assert [path.name for path in out.iterdir()] == ["model.json"]


def test_what_the_data_do_not_say_is_printed(tmp_path, capsys):
    write(tmp_path / "one.csv", 5.0)
    assert main(["fit", str(tmp_path / "one.csv"), "--out", str(tmp_path), "-n", "5"]) == 0
    shown = capsys.readouterr().out
    assert "δ2 is not determined by these data" in shown
    assert "in blocks, is held out" not in shown
    words = ["fit", str(tmp_path / "one.csv"), "--out", str(tmp_path), "-n", "5", "--verbose"]
    assert main(words) == 0
    assert "in blocks, is held out" in capsys.readouterr().out


def test_the_memory_is_shown_where_it_was_free(tmp_path, capsys):
    write(tmp_path / "a.csv", 5.0, extremum_V=9.0)
    write(tmp_path / "b.csv", 50.0)
    words = [
        "fit",
        str(tmp_path),
        "--out",
        str(tmp_path / "out"),
        "-n",
        "5",
        "--free-memory",
        "--verbose",
    ]
    assert main(words) == 0
    assert "extremum of a" in capsys.readouterr().out
    stated = json.loads((tmp_path / "out" / "model.json").read_text(encoding="utf-8"))
    assert stated["identification"]["memory_extrema_V"]["a"] == pytest.approx(9.0, abs=0.3)


def test_the_rate_can_be_band_limited(folder, tmp_path):
    words = ["fit", str(folder), "--out", str(tmp_path / "out"), "-n", "5"]
    assert main([*words, "--rate-bandwidth", "400"]) == 0
    assert PlantModel.load(tmp_path / "out" / "model.json").hysteresis.rate_bandwidth_hz == 400.0


@over(
    "options, words",
    [
        (["--plays", "0"], "--plays"),
        (["--rate-bandwidth", "-1"], "rate_bandwidth_hz is -1"),
        (["--columns", "q=1"], "q"),
        (["--nonsense"], "nonsense"),
    ],
)
def test_bad_options_exit_2_and_write_nothing(folder, tmp_path, capsys, options, words):
    out = tmp_path / "out"
    assert main(["fit", str(folder), "--out", str(out), *options]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_bad_data_exit_2_and_write_nothing(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["fit", str(tmp_path / "none.csv"), "--out", str(out)]) == 2
    assert "none.csv does not exist" in capsys.readouterr().err
    write(tmp_path / "down.csv", 5.0, sign=-1.0)
    assert main(["fit", str(tmp_path / "down.csv"), "--out", str(out)]) == 2
    assert "the displacement falls where the voltage rises" in capsys.readouterr().err
    assert not out.exists()


def test_a_folder_that_cannot_be_written_is_named(folder, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    words = ["fit", str(folder), "--out", str(tmp_path / "file"), "-n", "5"]
    assert main(words) == 2
    assert "cannot be written" in capsys.readouterr().err
