"""Arguments of the wrong type and names with a typing error: one line that says what is right."""

import inspect

import pytest

import rdpi_gym as rg
from tests.looping import over


@over(
    "call, expected",
    [
        (lambda data: rg.fit(data, plays="ten"), "fit: plays is 'ten'; give a whole number"),
        (lambda data: rg.fit(data, plays=2.5), "fit: plays is 2.5; give a whole number"),
        (lambda data: rg.fit(data, plays=True), "fit: plays is True; give a whole number"),
        (lambda data: rg.fit(3), "fit: data is 3; give a Dataset, a path or text"),
        (lambda data: rg.fit(data, free_memory=1), "give True or False"),
        (lambda data: rg.load(3), "load: path is 3; give a path, text"),
        (lambda data: rg.load("x.csv", columns="u=3"), "columns is 'u=3'; give a mapping"),
        (lambda data: rg.load("x.csv", skip_s="1"), "skip_s is '1'; give a number or None"),
        (lambda data: rg.compare(data, 3), "compare: model is 3"),
        (lambda data: rg.compare(data, "P55"), "P55"),
        (lambda data: rg.simulate("P5", hide=3), "simulate: hide is 3"),
        (lambda data: rg.simulate("P5", hide="creap"), "did you mean 'creep'?"),
        (lambda data: rg.simulate("P5", seed=-1), "seed is -1; give 0 or above"),
        (lambda data: rg.simulate("P5", noise_um="low"), "noise_um is 'low'; give a number"),
        (lambda data: rg.make_controller(3, "P5"), "make_controller: name is 3; give text"),
        (
            lambda data: rg.make_controller("clasical-static", "P5"),
            "did you mean 'classical-static'?",
        ),
        (lambda data: rg.make_controller("none", "P5", layout="x"), "layout is 'x'"),
        (
            lambda data: rg.benchmark("none"),
            "controllers is 'none'; give a sequence of text",
        ),
        (lambda data: rg.benchmark(["nune"], ["P5"]), "did you mean 'none'?"),
        (lambda data: rg.benchmark(["none"], ["P55"]), "did you mean 'P5'?"),
        (lambda data: rg.benchmark(["none"], ["P5"], ["sin"]), "did you mean 'sine'?"),
        (lambda data: rg.benchmark(["none"], ["P5"], seeds=0), "seeds is 0"),
        (lambda data: rg.environments.layout("P5", ts_s="fast"), "ts_s is 'fast'; give a number"),
        (lambda data: rg.environments.layout("P5", action="push"), "give one of 'command'"),
        (lambda data: rg.plants["P55"], "did you mean 'P5'?"),
        (lambda data: rg.effects["creap"], "did you mean 'creep'?"),
        (lambda data: rg.load_result(3), "load_result: path is 3"),
    ],
)
def test_one_line_that_says_what_is_right(data, call, expected):
    with pytest.raises(rg.InputError) as caught:
        call(data)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_keyword_is_pythons_own_error(data):
    with pytest.raises(TypeError, match="play"):
        rg.fit(data, play=10)
    with pytest.raises(TypeError, match="column"):
        rg.load("x.csv", column={})
    with pytest.raises(TypeError, match="path"):
        rg.load()


def test_load_shows_its_options_in_its_signature():
    assert list(inspect.signature(rg.load).parameters) == [
        "path", "columns", "input", "units", "sampling_time_s", "validate", "skip_s",
    ]  # fmt: skip


def test_catalogues_print_what_there_is():
    assert repr(rg.plants).splitlines()[0].startswith("P5 ")
    assert {line.split()[0] for line in repr(rg.effects).splitlines()} == set(rg.effects)
    assert rg.plants["P10"].name == "P10"
    assert rg.effects["creep"].name == "creep"
    assert "pi" in rg.controllers
    assert len(rg.controllers) == len(list(rg.controllers))


def test_several_files_make_one_data_set(data, tmp_path):
    folder = data.write(tmp_path / "data")
    few = rg.load([folder / "stairs.csv", str(folder / "sine-50hz.csv")], validate="sine*")
    assert [(r.name, r.role) for r in few.records] == [
        ("stairs", "train"), ("sine-50hz", "validation"),
    ]  # fmt: skip
    with pytest.raises(rg.InputError, match="two of the files are record 'stairs'"):
        rg.load([folder / "stairs.csv", folder])
    with pytest.raises(rg.InputError, match="no path"):
        rg.load([])
    with pytest.raises(rg.InputError, match="path of the data is empty"):
        rg.load("")
