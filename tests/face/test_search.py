"""From what a search found it goes on, back and forth, each time to a new result."""

import pytest

import rdpi_gym as rg
from rdpi_gym.face.search import candidates_of
from rdpi_gym.plant.effects import CATALOGUE, load_effect
from tests.looping import over


def names(result):
    return [effect.name for effect in result.plant.effects]


def test_the_hidden_effect_is_found(found):
    assert names(found) == ["creep"]
    assert "creep" in repr(found).splitlines()[0]


def test_one_validation_error_in_terminal_page_laboratory_and_file(found, tmp_path):
    error_um = found.final.validation_rmse_um
    stated = f"{error_um:.3g} µm"
    assert f"to {stated}, noise" in found.summary_lines()[0]
    assert found.brief()["validation"].iloc[-1] == stated
    document = found.to_dict()
    assert document["final"]["validation_rmse"] == error_um
    assert document["steps"][-1]["validation_rmse"] == error_um
    assert f"to {stated}, noise" in found.page(tmp_path / "page.html").read_text(encoding="utf-8")
    compared = rg.compare(found.data, found.plant)
    assert compared.rmse_um("validation") == pytest.approx(error_um, rel=1e-9)
    assert compared.to_dict()["validation_rmse_um"] == compared.rmse_um("validation")
    in_laboratory = rg.respond(found.plant, found.data).errors.validation_rmse_um
    assert in_laboratory == pytest.approx(error_um, rel=1e-9)
    shown = found.stated["creep"]
    assert found.stated_rounds[0][0].errors == shown.errors == found.final


def test_the_error_of_a_fit_is_that_of_its_comparison(data, model, comparison):
    assert comparison.rmse_um("validation") == pytest.approx(model.validation_rmse_um, rel=1e-9)
    assert comparison.rmse_um("train") == pytest.approx(model.train_rmse_um, rel=1e-9)
    in_laboratory = rg.respond(model, data).errors
    assert in_laboratory.validation_rmse_um == pytest.approx(model.validation_rmse_um, rel=1e-9)


@pytest.mark.slow
def test_an_effect_is_taken_out_and_added_again(found):
    less = found.remove("creep")
    assert names(less) == []
    assert less.base.validation_rmse_um > 2 * found.noise_floor_um
    again = less.add("creep", jobs=1)
    assert names(again) == ["creep"]
    assert again.steps[0].errors.validation_rmse_um == pytest.approx(
        found.steps[-1].errors.validation_rmse_um, rel=0.05
    )
    assert names(found) == ["creep"]  # it stayed as it was


def test_an_effect_may_be_given_by_its_class(found):
    more = found.add(CATALOGUE["delay"], jobs=1)
    assert names(more) == ["creep", "delay"]


def test_a_loaded_search_goes_on(found, tmp_path):
    again = rg.load_result(found.save(tmp_path / "found.npz"))
    assert names(again.remove("creep")) == []


def test_what_it_has_and_what_it_lacks_is_said(found):
    with pytest.raises(rg.InputError, match="has no effect 'delay'; it has creep"):
        found.remove("delay")
    with pytest.raises(rg.InputError, match="has creep already"):
        found.add("creep", jobs=1)
    with pytest.raises(rg.InputError, match="creap"):
        found.add("creap", jobs=1)


def test_results_with_a_plant_stand_for_it(data, found):
    layout = rg.environments.layout(found, ts_s=1e-4)
    controller = rg.make_controller("pi-classical-reference-rate", found, layout)
    assert controller.belief == found.plant
    assert rg.compare(data, found).model == found.plant


@over(
    "call, expected",
    [
        (lambda data: rg.discover(3), "data is 3; give a Dataset, a path or text"),
        (lambda data: rg.discover(data, 3), "model is 3"),
        (lambda data: rg.discover(data, jobs="two"), "jobs is 'two'; give a whole number"),
        (lambda data: rg.discover(data, jobs=0), "jobs is 0"),
        (lambda data: rg.discover(data, seed=-1), "seed is -1"),
        (lambda data: rg.discover(data, effects="mine:Wobble"), "effects is 'mine:Wobble'"),
        (lambda data: rg.discover(data, effects=[int]), "effect int is int; an effect is"),
        (lambda data: rg.add(3, data, "P5"), "add: effect is 3"),
        (lambda data: rg.add("creep", data), "--model"),
    ],
)
def test_bad_options_are_refused_in_one_line(data, call, expected):
    with pytest.raises(rg.InputError) as caught:
        call(data)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_form_is_no_candidate_of_its_own():
    with pytest.raises(rg.InputError, match="HardRails is saturation, hard rails: name saturation"):
        candidates_of([load_effect("saturation", "hard rails")])
