"""`rdpi simulate`: a data set to measure oneself by, and its answer kept apart."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rdpi_gym import virtual_lab as hidden
from rdpi_gym.cli import main
from rdpi_gym.measurement import load
from rdpi_gym.plant import P10, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, effect_from_dict
from rdpi_gym.virtual_lab import HIDEABLE, Truth, simulate_dataset
from tests.looping import over


@pytest.fixture(scope="module")
def exercise(tmp_path_factory):
    out = tmp_path_factory.mktemp("simulate") / "exercise"
    words = ["simulate", "--hide", "random", "--seed", "4", "--ts-factor", "4", "--out", str(out)]
    assert main(words) == 0
    return out


def truth_of(out) -> dict:
    return json.loads((out / "truth.json").read_text(encoding="utf-8"))


def test_the_data_set_reads_as_a_measurement(exercise):
    dataset = load(exercise / "data")
    assert dataset.title == "simulated records of P10"
    assert [r.name for r in dataset.quiet] == ["quiet"]
    assert sum(len(r.u_V) for r in dataset.train) == 91_000 // 4
    assert len(dataset.validation) == 5
    assert all(r.note for r in dataset.records)
    assert not dataset.remarks
    assert not any(r.remarks for r in dataset.records)
    header = (exercise / "data" / "stairs.csv").read_text().splitlines()[0]
    assert header == "t,u,y"
    spans = sorted((r.t_s[0], r.t_s[-1]) for r in dataset.records)
    assert all(a[1] + 0.9 < b[0] for a, b in pairwise(spans))


def test_the_answer_makes_the_data(exercise):
    document = truth_of(exercise)
    assert (document["format"], document["version"]) == ("rdpi-truth", 1)
    effects = tuple(effect_from_dict(CATALOGUE, d, "truth") for d in document["hidden"])
    assert len(effects) == 1
    truth = Truth(
        PlantModel.from_dict(document["plant"]), effects, document["noise_um"], document["seed"],
        document["ts_factor"],
    )  # fmt: skip
    read = {r.name: r for r in load(exercise / "data").records}
    for record in simulate_dataset(truth).records:
        assert np.allclose(read[record.name].y_um, record.y_um, rtol=0, atol=1e-9)


def test_nothing_outside_the_truth_gives_the_answer_away(exercise, tmp_path, capsys):
    out = tmp_path / "again"
    words = ["simulate", "--hide", "random", "--seed", "4", "--ts-factor", "4", "--out", str(out)]
    assert main(words) == 0
    printed = capsys.readouterr()
    said = printed.out.replace(str(out), "") + printed.err
    assert not any(name in said for name in HIDEABLE)
    # the protocol's own words name effects, the same whatever is hidden
    plain = tmp_path / "plain"
    assert main(["simulate", "--ts-factor", "4", "--out", str(plain)]) == 0
    assert {f.name for f in (plain / "data").iterdir()} == {
        f.name for f in (out / "data").iterdir()
    }
    toml = "data/dataset.toml"
    assert (plain / toml).read_text() == (out / toml).read_text()
    # and the same seed is the same exercise
    assert truth_of(out) == truth_of(exercise)


def test_random_hides_different_effects(tmp_path):
    found = set()
    for seed in range(3):
        out = tmp_path / str(seed)
        words = ["--hide", "random", "--seed", str(seed), "--ts-factor", "4", "--out", str(out)]
        assert main(["simulate", *words]) == 0
        found |= {d["effect"] for d in truth_of(out)["hidden"]}
    assert len(found) > 1


def test_two_named_effects_in_a_plant_that_has_one(tmp_path, capsys):
    model = replace(P10, effects=(CATALOGUE["creep"](0.02),)).save(tmp_path / "model.json")
    out = tmp_path / "out"
    words = ["--model", str(model), "--hide", "delay, asymmetry", "--ts-factor", "4"]
    assert main(["simulate", *words, "--out", str(out)]) == 0
    document = truth_of(out)
    assert {d["effect"] for d in document["hidden"]} == {"delay", "asymmetry"}
    assert document["plant"]["effects"][0]["effect"] == "creep"
    assert f"data: {out / 'data'}" in capsys.readouterr().out


def test_without_noise_and_secret_it_is_the_plant(tmp_path, capsys):
    out = tmp_path / "out"
    words = ["--model", "P5", "--noise-um", "0", "--ts-factor", "4", "--out", str(out)]
    assert main(["simulate", *words]) == 0
    assert truth_of(out)["hidden"] == []
    assert "nothing is hidden" in capsys.readouterr().out
    assert np.all(load(out / "data").quiet[0].y_um == 0.0)


@over(
    "words, said",
    [
        (["--hide", "crep"], "--hide: 'crep' is unknown (did you mean 'creep'?)"),
        (["--hide", "creep,creep"], "creep is there twice"),
        (["--hide", "random,creep"], "random stands alone"),
        (["--hide", ","], "--hide names no effect"),
        (["--hide", ""], "--hide names no effect"),
        (["--noise-um", "-0.01"], "--noise-um is -0.01"),
        (["--noise-um", "nan"], "--noise-um is nan"),
        (["--noise-um", "loud"], "--noise-um"),
        (["--ts-factor", "0"], "--ts-factor is 0.0"),
        (["--seed", "-1"], "--seed"),
        (["--model", "P11"], "'P11' is neither a plant file nor one of P5"),
    ],
)
def test_bad_input_is_one_line_and_status_2(words, said, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["simulate", *words, "--out", str(out)]) == 2
    printed = capsys.readouterr()
    assert said in printed.err
    assert printed.err.count("\n") == 1
    assert printed.out == ""
    assert not out.exists()


def test_a_file_is_no_folder(tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    assert main(["simulate", "--out", str(tmp_path / "taken")]) == 2
    assert "is a file; give a folder" in capsys.readouterr().err


def test_records_of_something_else_are_not_mixed_in(tmp_path, capsys):
    other = tmp_path / "out" / "data" / "run1.csv"
    other.parent.mkdir(parents=True)
    other.write_text("t,u,y\n")
    words = ["simulate", "--ts-factor", "4", "--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert "holds run1.csv" in capsys.readouterr().err
    assert sorted(f.name for f in other.parent.iterdir()) == ["run1.csv"]


def test_an_effect_that_the_plant_has_is_no_secret(tmp_path, capsys):
    model = replace(P10, effects=(CATALOGUE["creep"](0.02),)).save(tmp_path / "model.json")
    words = ["simulate", "--model", str(model), "--hide", "creep", "--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert "has creep already" in capsys.readouterr().err


@pytest.mark.slow
def test_noise_that_masks_everything(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(hidden.draws, "_ATTEMPTS", 1)
    monkeypatch.setattr(hidden, "HIDEABLE", ("creep", "delay"))
    words = ["--noise-um", "1e9", "--ts-factor", "4", "--out", str(tmp_path / "out")]
    assert main(["simulate", "--hide", "random", *words]) == 2
    error = capsys.readouterr().err
    assert "no effect can be seen" in error
    assert not any(name in error for name in HIDEABLE)
