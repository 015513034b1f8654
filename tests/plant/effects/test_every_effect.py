"""The contract of an effect, held by every form of the catalogue and of the free block."""

import dataclasses
import json
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rdpi_gym.plant import P5, P10, Plant, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, DataScale, Effect, effect_from_dict, forms_of
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.support.errors import InputError
from tests.looping import over

TS = 1e-4
SIMPLEST = tuple(CATALOGUE.values())
FURTHER = [form for kind in (*SIMPLEST, Unknown) for form in forms_of(kind)[1:]]
KINDS = [*SIMPLEST, Unknown, *FURTHER]  # the catalogue lists no free block
STAGES = [kind for kind in KINDS if kind.slot != "memory"]
STATELESS = [kind for kind in KINDS if kind().state_rows(TS) == 0]
CLOCKED = [kind for kind in KINDS if kind.clocked]
SCALES = (
    DataScale(50.0, 50.0, 40.0, 3e4, 1e-5, 60.0),  # a piezo stage
    DataScale(0.0, 40.0, 40.0, 3e3, 1e-4, 10.0),  # about zero
    DataScale(0.0, 5e-6, 3e3, 1e-5, 1e-3, 1.0),  # newtons and metres
    DataScale(-3e5, 2e5, 1e-6, 1e7, 1.0, 1e5),  # millivolts by the hour
)


class Stage:
    """Effects of one form, one a lane, run block by block."""

    def __init__(self, effects, ts=TS, spare_rows=0):
        self.ts, self.block = ts, type(effects[0]).block
        self.p = np.array([e.coefficients(ts, P10.hysteresis) for e in effects]).T.copy()
        rows = max(e.state_rows_with(ts, P10.hysteresis) for e in effects) + spare_rows
        self.state = np.full((rows, len(effects)), np.nan)

    def run(self, x, u):
        y = np.full_like(x, np.nan)
        self.block(x, u, self.p, self.state, self.ts, y)
        return y


def typical(kind: type[Effect], rng: np.random.Generator) -> Effect:
    return kind(**{p.name: rng.uniform(*p.typical) for p in kind.parameters})


def signals(kind: type[Effect], lanes: int, seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    u = np.random.default_rng(seed).normal(0, 2, (120, lanes)).cumsum(axis=0)
    x = {"input": u, "rate": np.gradient(u, TS, axis=0)}.get(kind.slot, 1.2 * u + 0.3)
    return np.ascontiguousarray(x), u


@over("kind", KINDS)
@settings(max_examples=25)
@given(
    cuts=st.lists(st.integers(1, 119), max_size=5),
    lanes=st.sampled_from([1, 3, 33]),
    seed=st.integers(0, 2**31),
)
def test_splitting_a_block_of_a_stage_changes_nothing(kind, cuts, lanes, seed):
    x, u = signals(kind, lanes, seed)
    effects = [typical(kind, np.random.default_rng(seed + b)) for b in range(lanes)]
    whole, pieces = Stage(effects), Stage(effects)
    expected = whole.run(x, u)
    edges = [0, *sorted(set(cuts)), len(x)]
    parts = [pieces.run(x[a:b].copy(), u[a:b].copy()) for a, b in pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate(parts), expected)
    back = x[::-1].copy(), u[::-1].copy()
    np.testing.assert_array_equal(pieces.run(*back), whole.run(*back))
    assert np.isfinite(expected).all()


@over("lanes", [2, 17, 40])
@over("kind", KINDS)
def test_lanes_of_a_stage_equal_single_runs_and_leave_their_inputs_alone(kind, lanes):
    rng = np.random.default_rng(lanes)
    x, u = signals(kind, lanes)
    before = x.copy(), u.copy()
    effects = [typical(kind, rng) for _ in range(lanes)]
    together = Stage(effects, spare_rows=3).run(x, u)
    for b, effect in enumerate(effects):
        alone = Stage([effect]).run(x[:, b : b + 1].copy(), u[:, b : b + 1].copy())
        atol = 1e-12 * np.abs(x).max()
        np.testing.assert_allclose(together[:, b], alone[:, 0], rtol=0, atol=atol)
    np.testing.assert_array_equal((x, u), before)


@over("kind", SIMPLEST)
def test_the_neutral_value_changes_nothing(kind):
    x, u = signals(kind, 1)
    for parameter in kind.parameters:
        if parameter.neutral is not None:
            effect = typical(kind, np.random.default_rng(1))
            still = effect.with_values({parameter.name: parameter.neutral})
            np.testing.assert_array_equal(Stage([still]).run(x, u), x)


@over("kind", [k for k in SIMPLEST if all(p.neutral is None for p in k.parameters)])
def test_an_effect_without_such_a_value_comes_close_to_it_at_its_bounds(kind):
    x = 30 * np.sin(2 * np.pi * 50 * np.arange(2000) * 1e-5)
    ends = product(*((p.low, p.high, p.typical[0]) for p in kind.parameters))
    assert min(np.abs(kind(*values).run(x, 1e-5) - x).max() for values in ends) < 1e-3 * 30


@over("kind", [k for k in SIMPLEST if k not in STATELESS and k not in CLOCKED])
def test_a_stage_begins_at_rest_at_its_first_sample(kind):
    y = kind().run(np.full(50, 7.5), TS)
    np.testing.assert_allclose(y, y[0], rtol=1e-12)


@over("kind", CLOCKED)
def test_a_clock_may_begin_later(kind):
    x = np.linspace(1.0, 2.0, 200)[:, None]
    whole, late = Stage([kind()], 0.5), Stage([kind()], 0.5)
    late.state[0] = 80
    np.testing.assert_allclose(late.run(x[80:].copy(), x[80:]), whole.run(x, x)[80:], rtol=1e-13)


@over("kind", STATELESS)
def test_a_stage_without_memory_forgets(kind):
    x, u = signals(kind, 1)
    stage = Stage([kind()])
    once = stage.run(x, u)
    np.testing.assert_array_equal(stage.run(x, u), once)


@over("kind", KINDS)
def test_parameters_are_fields_with_physical_bounds_and_typical_defaults(kind):
    assert [f.name for f in dataclasses.fields(kind)] == [p.name for p in kind.parameters]
    for p in kind.parameters:
        assert p.low <= p.typical[0] <= p.typical[1] <= p.high
        if kind.name != Unknown.name:
            assert p.typical[0] <= kind().values[p.name] <= p.typical[1]
        if kind in SIMPLEST:
            assert p.typical[0] == p.typical[1] or not p.fixed
        wide = p.high - p.low
        for bad in (p.low - wide, p.high + wide, np.nan, np.inf):
            with pytest.raises(InputError) as refusal:
                kind(**{p.name: bad})
            message = str(refusal.value)
            assert "\n" not in message
            for word in (kind.full_name(), p.name, f"{p.low:g}", f"{p.high:g}"):
                assert word in message
    assert kind.kinked is None or kind.kinked in kind().values


@over("kind", FURTHER)
def test_a_form_has_a_name_and_an_equation_of_its_own(kind):
    assert kind.form == kind.form.strip().lower()
    assert kind.equation not in {form.equation for form in forms_of(kind) if form is not kind}


@over("kind", SIMPLEST)
def test_the_catalogue_holds_the_simplest_form_of_each(kind):
    assert not kind.form
    assert kind.simplest is None
    counts = [sum(not p.fixed for p in form.parameters) for form in forms_of(kind)]
    assert counts == sorted(counts)


@over("kind", KINDS)
def test_a_plant_with_a_form_survives_its_file(kind, tmp_path):
    effect = typical(kind, np.random.default_rng(2))
    plant = dataclasses.replace(P10, effects=(effect,))
    again = PlantModel.load(plant.save(tmp_path / "plant.json"))
    assert again == plant
    assert type(again.effects[0]) is kind
    document = json.loads(json.dumps(effect.to_dict()))
    assert effect_from_dict(CATALOGUE, document, "test") == effect
    assert list(document)[: 1 + bool(kind.form)] == ["effect", "form"][: 1 + bool(kind.form)]
    with pytest.raises(InputError, match="no form is named 'x'; the simplest has no name"):
        effect_from_dict(CATALOGUE, document | {"form": "x"}, "plant.json")


@over("kind", KINDS)
def test_a_fit_can_start_at_any_size_of_data_with_or_without_a_simpler_form(kind):
    simpler = forms_of(kind)[max(forms_of(kind).index(kind) - 1, 0)]
    for scale in SCALES:
        starts = kind.starts(scale)
        assert starts
        for start in [*starts, *kind.from_simpler(simpler.starts(scale)[0], scale)]:
            assert type(start) is kind
            assert np.all(np.isfinite(start.coefficients(scale.shortest_s, P10.hysteresis)))


@over("kind", forms_of(Unknown))
def test_a_free_block_begins_as_nothing(kind):
    u = 30.0 * np.sin(np.linspace(0.0, 20.0, 400)) * np.linspace(0.0, 1.0, 400) ** 2
    still = dataclasses.replace(P5, effects=kind.starts(SCALES[1])[:1])
    np.testing.assert_array_equal(Plant(still, 1e-3).simulate(u), Plant(P5, 1e-3).simulate(u))


def test_lanes_with_two_forms_of_an_effect_are_refused():
    forms = forms_of(CATALOGUE["saturation"])[:2]
    with pytest.raises(InputError, match="lanes with different effects"):
        Plant([dataclasses.replace(P10, effects=(kind(),)) for kind in forms], TS)


@over(
    "document, words",
    [
        ({"effect": "crep"}, "no effect is named 'crep'; known are saturation"),
        ({"effect": ["creep"]}, "no effect is named ['creep']"),
        ({"effect": "creep"}, "parameter 'gain_per_decade' is missing"),
        ({"effect": "creep", "gain": 1}, "unknown parameter 'gain'; known are gain_per_decade"),
        ({"effect": "creep", "gain_per_decade": True}, "is True; expected a number"),
        ({"effect": "creep", "gain_per_decade": "1"}, "is '1'; expected a number"),
        ({"effect": "creep", "gain_per_decade": 2}, "physical values lie in 0 to 0.1"),
        ({"effect": "creep", "gain_per_decade": 10**400}, "model.json"),
        ({"effect": "backlash", "form": 7}, "no form is named 7; the simplest has no name, further forms are bridged by a spring"),
        ("creep", "is no effect; expected"),
    ],
)  # fmt: skip
def test_a_bad_json_form_is_refused_in_one_line(document, words):
    with pytest.raises(InputError) as refusal:
        effect_from_dict(CATALOGUE, document, "model.json")
    assert words in str(refusal.value)
    assert str(refusal.value).startswith("model.json")
    assert "\n" not in str(refusal.value)


def test_unknown_values_are_refused():
    with pytest.raises(InputError, match=r"creep has no parameter 'gain'; .* gain_per_decade"):
        CATALOGUE["creep"]().with_values({"gain": 1.0})
