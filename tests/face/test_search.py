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
