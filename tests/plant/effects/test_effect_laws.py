"""What every effect keeps to: blocks, lanes, bounds, neutral values, rest."""

import dataclasses
from collections.abc import Sequence
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.support.errors import InputError
from tests.looping import over

NAMES = tuple(CATALOGUE)
TS = 1e-4
STATELESS = tuple(n for n in NAMES if CATALOGUE[n]().state_rows(TS) == 0)
CLOCKED = tuple(n for n in NAMES if CATALOGUE[n].clocked)
HYSTERESIS = P10.hysteresis


class Stage:
    """The effects of some lanes, run block by block."""

    def __init__(self, effects: Sequence[Effect], ts: float = TS, spare_rows: int = 0) -> None:
        self.ts, self.block = ts, type(effects[0]).block
        self.p = np.array([e.coefficients(ts, HYSTERESIS) for e in effects]).T.copy()
        rows = max(e.state_rows(ts) for e in effects) + spare_rows
        self.state = np.full((rows, len(effects)), np.nan)

    def run(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        y = np.full_like(x, np.nan)
        self.block(x, u, self.p, self.state, self.ts, y)
        return y


def typical(name: str, rng: np.random.Generator) -> Effect:
    kind = CATALOGUE[name]
    return kind(**{p.name: rng.uniform(*p.typical) for p in kind.parameters})


def signals(
    name: str, lanes: int, length: int = 120, seed: int = 5
) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    u = rng.normal(0, 2, (length, lanes)).cumsum(axis=0)
    x = {"input": u, "rate": np.gradient(u, TS, axis=0)}.get(CATALOGUE[name].slot, 1.2 * u + 0.3)
    return np.ascontiguousarray(x), u


@over("name", NAMES)
@settings(max_examples=25, deadline=None)
@given(
    cuts=st.lists(st.integers(1, 119), max_size=5),
    lanes=st.sampled_from([1, 3, 33]),
    seed=st.integers(0, 2**31),
)
def test_splitting_a_block_of_a_stage_changes_nothing(name, cuts, lanes, seed):
    x, u = signals(name, lanes, seed=seed)
    effects = [typical(name, np.random.default_rng(seed + b)) for b in range(lanes)]
    whole, pieces = Stage(effects), Stage(effects)
    expected = whole.run(x, u)
    edges = [0, *sorted(set(cuts)), len(x)]
    parts = [pieces.run(x[a:b].copy(), u[a:b].copy()) for a, b in pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate(parts), expected)
    np.testing.assert_array_equal(
        pieces.run(x[::-1].copy(), u[::-1].copy()), whole.run(x[::-1].copy(), u[::-1].copy())
    )
    assert np.isfinite(expected).all()


@over("lanes", [2, 17, 40])
@over("name", NAMES)
def test_lanes_of_a_stage_equal_single_runs(name, lanes):
    rng = np.random.default_rng(lanes)
    x, u = signals(name, lanes)
    effects = [typical(name, rng) for _ in range(lanes)]
    together = Stage(effects, spare_rows=3).run(x, u)
    scale = np.abs(x).max()
    for b, effect in enumerate(effects):
        alone = Stage([effect]).run(x[:, b : b + 1].copy(), u[:, b : b + 1].copy())
        np.testing.assert_allclose(together[:, b], alone[:, 0], rtol=0, atol=1e-12 * scale)


@over("name", NAMES)
def test_a_stage_changes_neither_input_nor_command(name):
    x, u = signals(name, 4)
    before = x.copy(), u.copy()
    Stage([CATALOGUE[name]()] * 4).run(x, u)
    np.testing.assert_array_equal(x, before[0])
    np.testing.assert_array_equal(u, before[1])


@over(
    "name, parameter",
    [(n, p) for n in NAMES for p in CATALOGUE[n].parameters if p.neutral is not None],
)
def test_the_neutral_value_changes_nothing(name, parameter):
    effect = typical(name, np.random.default_rng(1)).with_values(
        {parameter.name: parameter.neutral}
    )
    x, u = signals(name, 1)
    np.testing.assert_array_equal(Stage([effect]).run(x, u), x)


@over("name", [n for n in NAMES if all(p.neutral is None for p in CATALOGUE[n].parameters)])
def test_an_effect_without_such_a_value_comes_close_to_it_at_its_bounds(name):
    kind, t = CATALOGUE[name], np.arange(2000) * 1e-5
    x = 30 * np.sin(2 * np.pi * 50 * t)
    ends = product(*((p.low, p.high, p.typical[0]) for p in kind.parameters))
    assert min(np.abs(kind(*values).run(x, 1e-5) - x).max() for values in ends) < 1e-3 * 30


@over("name", [n for n in NAMES if n not in STATELESS and n not in CLOCKED])
def test_a_stage_begins_at_rest_at_its_first_sample(name):
    y = CATALOGUE[name]().run(np.full(50, 7.5), TS)
    np.testing.assert_allclose(y, y[0], rtol=1e-12)


@over("name", CLOCKED)
def test_a_clock_may_begin_later(name):
    x = np.linspace(1.0, 2.0, 200)[:, None]
    effect = CATALOGUE[name]()
    whole, late = Stage([effect], 0.5), Stage([effect], 0.5)
    late.state[0] = 80
    np.testing.assert_allclose(late.run(x[80:].copy(), x[80:]), whole.run(x, x)[80:], rtol=1e-13)


@over("name", STATELESS)
def test_a_stage_without_memory_forgets(name):
    x, u = signals(name, 1)
    stage = Stage([CATALOGUE[name]()])
    once = stage.run(x, u)
    np.testing.assert_array_equal(stage.run(x, u), once)


@over("name, parameter", [(n, p) for n in NAMES for p in CATALOGUE[n].parameters])
def test_values_outside_the_bounds_are_refused_in_one_line(name, parameter):
    kind, wide = CATALOGUE[name], parameter.high - parameter.low
    for bad in (parameter.low - wide, parameter.high + wide, np.nan, np.inf):
        with pytest.raises(InputError) as refusal:
            kind(**{parameter.name: bad})
        message = str(refusal.value)
        assert "\n" not in message
        for word in (name, parameter.name, f"{parameter.low:g}", f"{parameter.high:g}"):
            assert word in message


@over("name", NAMES)
def test_defaults_are_typical_and_typical_values_are_physical(name):
    effect = CATALOGUE[name]()
    for p in effect.parameters:
        assert p.low <= p.typical[0] <= effect.values[p.name] <= p.typical[1] <= p.high
        assert p.typical[0] == p.typical[1] or not p.fixed


@over("name", NAMES)
def test_an_effect_survives_its_json_form(name):
    from rdpi_gym.plant.effects import effect_from_dict

    effect = typical(name, np.random.default_rng(2))
    assert effect_from_dict(CATALOGUE, effect.to_dict(), "test") == effect


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
        ("creep", "is no effect; expected"),
    ],
)
def test_a_bad_json_form_is_refused_in_one_line(document, words):
    from rdpi_gym.plant.effects import effect_from_dict

    with pytest.raises(InputError) as refusal:
        effect_from_dict(CATALOGUE, document, "model.json")
    assert words in str(refusal.value)
    assert str(refusal.value).startswith("model.json")
    assert "\n" not in str(refusal.value)


def test_unknown_values_are_refused():
    with pytest.raises(InputError, match=r"creep has no parameter 'gain'; .* gain_per_decade"):
        CATALOGUE["creep"]().with_values({"gain": 1.0})


@over("name", NAMES)
def test_parameters_are_the_fields(name):
    kind = CATALOGUE[name]
    assert [f.name for f in dataclasses.fields(kind)] == [p.name for p in kind.parameters]
