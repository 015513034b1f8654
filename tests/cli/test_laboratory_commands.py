"""`rdpi diagnose`, `rdpi add`, `rdpi discover`: what they write and print, and how they refuse."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.cli import main
from rdpi_gym.measurement import Record, example_folder, load, write_csv
from rdpi_gym.plant import P5, Plant, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, load_effect
from tests.looping import over

NOISE_UM = 0.02
OWN_EFFECT = '''
from dataclasses import dataclass
from numba import njit
from rdpi_gym.plant.effects import Effect, Parameter

@njit(cache=False)
def bend_block(x, u, p, state, ts, y):
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] + p[0, b] * x[t, b] ** 3

@dataclass(frozen=True)
class Bend(Effect):
    """A cubic."""

    cubic: float = 1e-5
    name = "bend"
    slot = "output"
    order = 90
    parameters = (Parameter("cubic", "1/um^2", -1e-2, 1e-2, (1e-6, 1e-4), "of the cube"),)
    equation, source, signature, experiment = "y = x + c x^3", "", "", ""
    mistaken_for = ()
    block = staticmethod(bend_block)

    def coefficients(self, ts_s, hysteresis):
        return [self.cubic]

    def state_rows(self, ts_s):
        return 0

@dataclass(frozen=True)
class Creep(Bend):
    name = "creep"
'''


def creeping_record(name, seed):
    """Three tones and a hold, of a plant that creeps by 4 % a decade."""
    plant = replace(P5, effects=(CATALOGUE["creep"](gain_per_decade=0.04),))
    rng, ts_s = np.random.default_rng(seed), 1e-3
    t = np.arange(1500) * ts_s
    tones = zip((8.0, 5.0, 3.0), rng.uniform(2.0, 40.0, 3), rng.uniform(0.0, 6.0, 3), strict=True)
    u = np.sum([a * np.sin(2 * np.pi * f * t + phase) for a, f, phase in tones], axis=0)
    u[1000:] = u[1000]
    y = Plant(plant, ts_s).simulate(u) + NOISE_UM * rng.standard_normal(t.size)
    return Record(name, t, u, y, ts_s=ts_s)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("creeping") / "data"
    for seed, name in enumerate(("first", "second", "validation-third")):
        write_csv(creeping_record(name, seed), folder / f"{name}.csv")
    return folder


def run(words, out, capsys):
    assert main([*map(str, words), "--out", str(out), "--jobs", "1"]) == 0
    return capsys.readouterr().out


def check_one_thing(printed, last):
    """Assert an answer, at most three sentences, one table of at most twelve rows, and a file.

    A line that asks for missing units is no sentence of the answer.
    """
    lines = printed.splitlines()
    assert len(lines) <= 25, printed
    lines = [line for line in lines if not line.startswith("no unit is given for ")]
    (rule,) = (i for i, line in enumerate(lines) if set(line.strip()) == {"─"})
    assert sum(bool(line.strip()) for line in lines[: rule - 1]) <= 1 + 3 + 1, printed  # a title
    assert sum(bool(line.strip()) for line in lines[rule + 1 : -1]) <= 12, printed
    assert lines[-1].startswith(str(last)), printed


@pytest.mark.slow
def test_fit_and_compare_say_one_thing_of_twelve_records(tmp_path, capsys):
    stage = load(example_folder("picma"))
    twelve, out = tmp_path / "twelve", tmp_path / "out"
    for k, record in enumerate(6 * stage.train + 6 * stage.validation):
        write_csv(record.cut(slice(2000)), twelve / f"{record.role}-{k}.csv")
    assert main(["fit", str(twelve), "--out", str(out)]) == 0
    check_one_thing(capsys.readouterr().out, out / "model.json")
    words = ["compare", str(twelve), "--model", str(out / "model.json"), "--out", str(out)]
    assert main(words) == 0
    printed = capsys.readouterr().out
    check_one_thing(printed, out / "report.html")
    assert main([*words, "--verbose"]) == 0
    assert len(capsys.readouterr().out) > 2 * len(printed)


def read(path):
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.slow
def test_discover(data, tmp_path, capsys):
    out = tmp_path / "out"
    printed = run(["discover", data], out, capsys)
    document = read(out / "discovery.json")
    assert (document["format"], document["version"]) == ("rdpi-discovery", 1)
    assert [step["effect"] for step in document["steps"]] == ["creep"]
    needed = {
        "train_rmse", "validation_rmse", "validation_nrmse_percent", "parameters",
        "standard_errors", "confidence", "indistinguishable", "evidence",
    }  # fmt: skip
    assert needed <= document["steps"][0].keys()
    assert document["steps"][0]["validation_rmse"] < document["base"]["validation_rmse"]
    model = PlantModel.load(out / "model.json")
    assert [effect.name for effect in model.effects] == ["creep"]
    assert printed.startswith("Missing: creep (gain per decade 0.0")
    assert printed.count("probable") == 1
    check_one_thing(printed, out / "report.html")
    assert "+ creep" in printed
    assert "noise floors" in printed
    page = (out / "report.html").read_text(encoding="utf-8")
    assert printed.splitlines()[0] in page
    names = ["candidates.jsonl", "discovery.json", "model.json", "report.html"]
    assert sorted(file.name for file in out.iterdir()) == names


@pytest.mark.slow
def test_diagnose_and_go_on_where_it_was_interrupted(data, tmp_path, capsys):
    out = tmp_path / "out"
    printed = run(["diagnose", data, "--model", "P5", "--verbose"], out, capsys)
    document = read(out / "diagnosis.json")
    assert (document["format"], document["version"]) == ("rdpi-diagnosis", 1)
    assert {c["effect"] for c in document["candidates"]} == set(CATALOGUE)
    assert document["candidates"][0]["effect"] == "creep"
    errors = [c["validation_rmse"] for c in document["candidates"]]
    assert errors == sorted(errors)
    for name in CATALOGUE:
        assert name in printed
    finished = out / "candidates.jsonl"
    lines = finished.read_text(encoding="utf-8").splitlines(keepends=True)
    finished.write_text("".join(lines[:-1]) + lines[-1][:20], encoding="utf-8")
    printed = run(["diagnose", data, "--model", "P5"], out, capsys)
    check_one_thing(printed, out / "report.html")
    again = read(out / "diagnosis.json")
    for key in ("candidates", "base", "verdict", "noise_floor"):
        assert again[key] == document[key]


def test_add(data, tmp_path, capsys):
    out = tmp_path / "out"
    printed = run(["add", "creep", data, "--model", "P5"], out, capsys)
    document = read(out / "add.json")
    assert (document["format"], document["version"]) == ("rdpi-add", 1)
    assert document["effect"] == "creep"
    assert document["after"]["validation_rmse"] < 0.5 * document["before"]["validation_rmse"]
    assert document["parameters"]["gain_per_decade"] == pytest.approx(0.04, rel=0.3)
    for stage in ("before", "after"):
        assert f"{document[stage]['validation_rmse']:.3g} µm" in printed
    model = PlantModel.load(out / "model.json")
    assert [effect.name for effect in model.effects] == ["creep"]
    assert (out / "report.html").is_file()


@pytest.fixture
def own_effect(tmp_path, monkeypatch):
    (tmp_path / "my_bend_effect.py").write_text(OWN_EFFECT)
    monkeypatch.syspath_prepend(tmp_path)
    return "my_bend_effect:Bend"


def test_add_what_is_unknown(data, tmp_path, capsys):
    out = tmp_path / "out"
    printed = run(["add", "unknown", data, "--model", "P5"], out, capsys)
    document = read(out / "add.json")
    assert document["after"]["validation_rmse"] < 0.5 * document["before"]["validation_rmse"]
    assert "memor" in document["form"]
    assert f"Added: unknown, {document['form']}" in printed
    model = PlantModel.load(out / "model.json")
    assert [effect.form for effect in model.effects] == [document["form"]]
    assert "time constant τ of its lag" in (out / "report.html").read_text(encoding="utf-8")


def test_own_effect_is_added(data, own_effect, tmp_path, capsys):
    out = tmp_path / "out"
    run(["add", own_effect, data, "--model", "P5"], out, capsys)
    document = read(out / "add.json")
    assert document["effect"] == load_effect(own_effect).name
    assert list(document["parameters"]) == ["cubic"]
    assert "of the cube" in (out / "report.html").read_text(encoding="utf-8")


def refused(words, out, capsys):
    assert main([*map(str, words), "--out", str(out)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert not out.exists()
    return printed.err


@over(
    "words, said",
    [
        (["diagnose", "DATA", "--model", "none.json"], "'none.json' is neither a plant file nor"),
        (["diagnose", "DATA", "--jobs", "0"], "--jobs is 0"),
        (["add", "creep", "DATA", "--model", "P5", "--jobs", "-2"], "--jobs is -2"),
        (["discover", "DATA", "--skip", "nan"], "--skip is nan"),
        (["diagnose", "DATA", "--effect", "math:pi"], "is a float"),
        (["discover", "DATA", "--effect", "no_such_module:Wobble"], "cannot be imported"),
        (["discover", "DATA", "--effect", "my_bend_effect:Creep"], "as another effect is; rename"),
        (["discover", "nowhere"], "nowhere does not exist"),
        (["add", "wobble", "DATA", "--model", "P5"], "no effect is named 'wobble'"),
        (["add", "creep", "DATA"], "--model"),
        (["discover", "DATA", "--seed", "-1"], "--seed"),
        (["discover", "DATA", "--core", "spring"], "--core: 'spring' is unknown"),
    ],
)
def test_bad_input_is_one_line(words, said, data, own_effect, tmp_path, capsys):
    named = [data if word == "DATA" else word for word in words]
    assert said in refused(named, tmp_path / "out", capsys)


def test_effect_that_is_there_already_is_not_added(data, tmp_path_factory, capsys, subtests):
    for name in ["creep", "unknown"]:
        with subtests.test(name=name):
            tmp_path = tmp_path_factory.mktemp("case")
            has = replace(P5, effects=(CATALOGUE[name](),)).save(tmp_path / "has.json")
            words = ["add", name, data, "--model", has]
            assert f"has {name} already" in refused(words, tmp_path / "out", capsys)
