"""Downloads: the same numbers, and one line where there is nothing yet."""

import json
import tomllib
from dataclasses import replace

import pytest

import rdpi_gym as rg
from rdpi_gym.laboratory.downloads import FILES, download
from rdpi_gym.laboratory.session import Session, Step
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.errors import InputError


def code_of(notebook):
    cells = json.loads(notebook)["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


def step(name, parent, made, plant, errors):
    return Step(
        name, parent, name, made, plant, errors.train_rmse_um, errors.validation_rmse_um,
        dict(errors.by_record_um),
    )  # fmt: skip


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Return a session in which creep was set by hand on a fitted model."""
    found = Session(tmp_path_factory.mktemp("session"))
    data = rg.simulate("P5", seed=1, ts_factor=4.0).select("sine-10hz", "validation-loops")
    rg.Dataset.of(data).write(found.data_folder)
    data = rg.load(found.data_folder)
    found.begin(data)
    first = rg.fit(data, name="base").plant
    creep = rg.effects["creep"](gain_per_decade=0.01)
    second = replace(first, effects=(creep.with_values({"gain_per_decade": 0.02}),))
    for name, parent, plant, made in (
        ("s1", None, first, {"kind": "fit", "core": None}),
        ("s2", "s1", replace(first, effects=(creep,)), {"kind": "added", "effect": "creep"}),
        ("s3", "s2", second, {
            "kind": "set", "effect": "creep", "parameter": "gain_per_decade", "value": 0.02,
        }),
    ):  # fmt: skip
        errors = rg.respond(plant, data).errors
        own = step(name, parent, made, plant, errors)
        found.write({"do": "step", "step": own.to_dict()})
    return found


def test_the_model_that_is_taken_is_the_present_one(session):
    taken = PlantModel.from_dict(json.loads(download(session, "model.json")[1]))
    assert taken.effects == session.step("s3").plant.effects
    assert taken.hysteresis == session.step("s3").plant.hysteresis


def test_a_notebook_repeats_a_fit_and_a_value_set_by_hand(session):
    prepared, helpers, *cells = code_of(download(session, "notebook.ipynb")[1])
    names: dict = {}
    exec(prepared + "\n" + helpers + "\n" + cells[0], names)
    assert names["errors"]["s1"] == (session.step("s1").train_um, session.step("s1").validation_um)
    names["s2"] = session.step("s2").plant  # a search is too long here: see the test in a browser
    exec(cells[2], names)
    assert names["s3"].effects == session.step("s3").plant.effects
    assert names["errors"]["s3"] == (session.step("s3").train_um, session.step("s3").validation_um)
    assert "rg.add('creep', data, s1)" in cells[1]


def test_settings_and_session_say_what_was_done(session):
    assert set(tomllib.loads(download(session, "dataset.toml")[1])["records"])
    document = json.loads(download(session, "session.json")[1])
    assert document["path"] == ["s1", "s2", "s3"]
    assert [event["do"] for event in document["events"]] == ["read", "step", "step", "step"]


def test_what_is_not_there_yet_is_one_line(session, tmp_path):
    empty = Session(tmp_path)
    for name in FILES:
        if name not in ("session.json",):
            with pytest.raises(InputError, match="yet"):
                download(empty, name)
    with pytest.raises(InputError, match="wait for it"):
        download(session, "experiment.csv")
    with pytest.raises(InputError, match="cannot be taken home"):
        download(session, "../secret")
