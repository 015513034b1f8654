"""Further forms of effects: what holds for every one of them, and for how they are found."""

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest

from rdpi_gym.plant import P10, Plant, PlantModel
from rdpi_gym.plant.effects import (
    CATALOGUE,
    DataScale,
    Effect,
    Parameter,
    check_effect,
    effect_from_dict,
    forms_of,
    load_effect,
)
from rdpi_gym.support.errors import InputError
from tests.looping import over

FORMS = [form for kind in CATALOGUE.values() for form in forms_of(kind)[1:]]
SCALES = {
    "piezo": DataScale(50.0, 50.0, 40.0, 3e4, 1e-5, 60.0),
    "about zero": DataScale(0.0, 40.0, 40.0, 3e3, 1e-4, 10.0),
    "newtons and metres": DataScale(0.0, 5e-6, 3e3, 1e-5, 1e-3, 1.0),
    "millivolts by the hour": DataScale(-3e5, 2e5, 1e-6, 1e7, 1.0, 1e5),
}


def full_name(kind):
    return kind.full_name()


def own_forms():
    @dataclass(frozen=True)
    class Sag(Effect):
        share: float = 0.02

        name, slot, order = "sag", "output", 15
        parameters = (Parameter("share", "1", 0.0, 0.5, (0.01, 0.05), "share", 0.0),)
        equation, source = "y = (1 - s) y_m", "Springs in series."
        signature, experiment, mistaken_for = "Less of all.", "Any.", ("gain_drift",)
        block = staticmethod(lambda x, u, p, state, ts, y: None)

        def coefficients(self, ts_s, hysteresis):
            return list(self.values.values())

        def state_rows(self, ts_s):
            return 0

    @dataclass(frozen=True)
    class Bent(Sag, of=Sag):
        share: float = 0.02
        bend: float = 0.0

        form = "bent"
        parameters = (*Sag.parameters, Parameter("bend", "1", -1.0, 1.0, (0.0, 0.1), "bend", 0.0))

    return Sag, Bent


def test_a_form_is_found_from_any_other_and_shares_what_it_does_not_state():
    simplest, bent = own_forms()
    assert forms_of(simplest) == forms_of(bent) == (simplest, bent)
    assert (bent.name, bent.slot, bent.order, bent.source) == ("sag", "output", 15, simplest.source)
    assert (simplest.full_name(), bent.full_name()) == ("sag", "sag, bent")
    assert check_effect(simplest, "own") is simplest


def test_a_form_has_what_a_base_that_it_shares_states_before_what_the_simplest_does():
    simplest, _ = own_forms()

    class Arch(Effect):
        source, cause = "Arches.", "An arch gives way."

    @dataclass(frozen=True)
    class Arched(Arch, simplest, of=simplest):
        share: float = 0.02

        form, cause = "arched", "It is arched."

    assert (Arched.source, Arched.cause) == ("Arches.", "It is arched.")
    assert (Arched.name, Arched.signature) == ("sag", simplest.signature)
    third = load_effect("sensor_lag", "third order")
    assert third.source.startswith("Filters of Bessel")
    assert third.cause.startswith("A filter in front of a converter")
    assert third.remedy == CATALOGUE["sensor_lag"].remedy


def test_a_form_that_is_not_whole_is_refused_with_its_effect():
    simplest, bent = own_forms()
    bent.form = ""
    with pytest.raises(InputError, match="each has the name 'sag' and a form of its own"):
        check_effect(simplest, "own")
    bent.form, bent.name = "bent", "sagging"
    with pytest.raises(InputError, match="bent' of sagging; each has the name 'sag'"):
        check_effect(simplest, "own")
    bent.name, bent.parameters = "sag", bent.parameters[:1]
    with pytest.raises(InputError, match="own, form 'bent' has the fields"):
        check_effect(simplest, "own")


def test_the_catalogue_holds_the_simplest_form_of_each():
    assert all(not kind.form and kind.simplest is None for kind in CATALOGUE.values())
    for kind in CATALOGUE.values():
        counts = [sum(not p.fixed for p in form.parameters) for form in forms_of(kind)]
        assert counts == sorted(counts)


@over("kind", FORMS)
def test_what_a_form_says_of_itself_is_whole(kind):
    assert kind.form == kind.form.strip().lower()
    assert kind.equation not in {form.equation for form in forms_of(kind) if form is not kind}
    for p in kind.parameters:
        assert p.low <= p.typical[0] <= kind().values[p.name] <= p.typical[1] <= p.high


@over("kind", FORMS)
def test_a_plant_with_a_form_survives_its_file(kind, tmp_path):
    plant = replace(P10, effects=(kind(),))
    again = PlantModel.load(plant.save(tmp_path / "plant.json"))
    assert again == plant
    assert type(again.effects[0]) is kind
    document = json.loads(json.dumps(kind().to_dict()))
    assert list(document)[:2] == ["effect", "form"]
    with pytest.raises(InputError, match=rf"no form is named 'x'; .* {kind.form}"):
        effect_from_dict(CATALOGUE, document | {"form": "x"}, "plant.json")


def test_an_effect_without_further_forms_says_so():
    with pytest.raises(InputError, match=r"no form is named 7; .* further forms are none"):
        effect_from_dict(CATALOGUE, {"effect": "backlash", "form": 7}, "plant.json")


@over("scale", SCALES.values())
@over("kind", FORMS)
def test_a_form_can_be_started_at_any_size_of_data_with_or_without_a_simpler_one(kind, scale):
    simpler = forms_of(kind)[forms_of(kind).index(kind) - 1]
    starts = kind.starts(scale)
    assert starts
    for start in [*starts, *kind.from_simpler(simpler.starts(scale)[0], scale)]:
        assert type(start) is kind
        assert np.all(np.isfinite(start.coefficients(scale.shortest_s, P10.hysteresis)))


@over("kind", FORMS)
def test_a_plant_with_a_form_stays_at_rest_and_runs_alike_in_pieces_and_lanes(kind):
    plant = replace(P10, effects=(kind(),))
    u = 40.0 * np.sin(np.arange(400) / 20.0) + np.random.default_rng(3).normal(0, 3, 400)
    whole = Plant(plant, 1e-4).simulate(u)
    assert np.all(np.isfinite(whole))
    two = Plant([plant, replace(plant, offset_um=1.0)], 1e-4)
    pieces = np.concatenate([two.simulate(np.stack([part, part], 1)) for part in (u[:7], u[7:])])
    np.testing.assert_allclose(pieces, np.stack([whole, whole + 1.0], 1), rtol=1e-12, atol=1e-12)


def test_lanes_with_two_forms_of_an_effect_are_refused():
    plants = [replace(P10, effects=(kind(),)) for kind in forms_of(CATALOGUE["saturation"])[:2]]
    with pytest.raises(InputError, match="lanes with different effects"):
        Plant(plants, 1e-4)


@over("kind", FORMS)
def test_a_cusp_is_along_a_parameter_that_the_form_has(kind):
    assert kind.kinked is None or kind.kinked in kind().values
