"""The unknown block in each of its forms: a stage like any other, found by name and not listed."""

from dataclasses import replace

import numpy as np

from baselines.inverses import Setting, inverse_of
from rdpi_gym.plant import P5, Plant
from rdpi_gym.plant.effects import CATALOGUE, DataScale, forms_of
from rdpi_gym.plant.effects.unknown import TERMS, Unknown, is_even, unknown_block
from tests.looping import over

FORMS = forms_of(Unknown)
TS = 1e-3
SCALE = DataScale(0.0, 30.0, 20.0, 2e3, TS, 10.0)
U = 30.0 * np.sin(np.linspace(0.0, 20.0, 400)) * np.linspace(0.0, 1.0, 400) ** 2  # no corner


def small(form, seed=0):
    """Weights of a few hundredths, in the size of the data."""
    rng, start = np.random.default_rng(seed), form.starts(SCALE)[0]
    own = {p.name: rng.uniform(-0.04, 0.04) for p in form.parameters if p.neutral is not None}
    return start.with_values(own)


def test_it_is_found_by_its_name_and_no_search_has_it():
    assert CATALOGUE["unknown"] is Unknown
    assert "unknown" not in list(CATALOGUE)
    assert len(CATALOGUE) == len(list(CATALOGUE))


@over("term", TERMS)
def test_a_term_is_even_or_odd(term):
    p = np.zeros((7 + 3 + len(TERMS) + 5, 1))
    p[0], p[3], p[4], p[9], p[10 + TERMS.index(term)] = 0.1, 20.0, 1.0, 1.0, 0.3
    added = []
    for x in (U, -U):
        y = np.empty((len(U), 1))
        unknown_block(x[:, None].copy(), x[:, None], p, np.full((4, 1), np.nan), TS, y)
        added.append(y[:, 0] - x)
    assert np.abs(added[0]).max() > 0.0
    np.testing.assert_allclose(
        added[1], added[0] if is_even(term) else -added[0], atol=1e-12
    )  # fmt: skip


def test_a_steep_curve_is_undone_too():
    steep = Unknown(even_1=0.0, odd_1=0.45, span_um=20.0)  # its slope goes from 1 to 2.35
    y = steep.run(U, TS)
    inverse = inverse_of(steep)(steep, Setting(TS, P5.hysteresis, 20.0, 0.0))
    state, _ = inverse.start(y[:1])
    assert np.abs(inverse.run(y[1:, None].copy(), state)[:, 0] - U[1:]).max() < 1e-3


@over("form", FORMS)
def test_its_inverse_leaves_a_seventh_of_it_at_most(form):
    effect = small(form, 1)
    core = P5.hysteresis.static()
    plant = replace(P5, hysteresis=core, effects=(effect,))
    inverse = inverse_of(effect)(effect, Setting(TS, core, 20.0, 0.0))
    before = effect.slot == "input"
    wanted = U if before else Plant(replace(plant, effects=()), TS).simulate(U)
    y = effect.run(U, TS) if before else Plant(plant, TS).simulate(U)
    state, _ = inverse.start(y[:1])
    x = inverse.run(y[1:, None].copy(), state)[:, 0]
    assert np.std(x - wanted[1:]) < np.std(y - wanted) / 7.0
