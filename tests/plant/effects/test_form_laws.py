"""Further forms of effects: nested in each other, exact between samples, right at rest."""

import numpy as np
import pytest
from scipy.signal import lsim

from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE, Effect, forms_of
from rdpi_gym.plant.effects.creep import TIME_CONSTANTS_S

TS = 1e-3
FORMS = [kind for simplest in CATALOGUE.values() for kind in forms_of(simplest)[1:]]


def form(name: str, words: str = "") -> type[Effect]:
    return next(kind for kind in forms_of(CATALOGUE[name]) if kind.form == words)


def full_name(kind: type[Effect]) -> str:
    return kind.full_name()


def rough(length: int = 400, seed: int = 3) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 5, length).cumsum()


def ran(effect: Effect, x: np.ndarray, ts: float = TS) -> np.ndarray:
    return effect.run(x, ts, 0.9 * x + 2.0 * np.sin(x), P10.hysteresis)


NESTED = [
    (form("creep", "between two times")(0.02, 10**-2.25, 10**3.25), form("creep")(0.02)),
    (form("creep", "between two times")(0.02, 10**3.25, 10**-2.25), form("creep")(0.02)),
    (
        form("creep", "two time constants")(0.03, 0.2, 0.0, 7.0),
        form("creep", "one time constant")(0.03, 0.2),
    ),
    (
        form("creep", "two time constants")(0.01, 0.2, 0.02, 0.2),
        form("creep", "one time constant")(0.03, 0.2),
    ),
    (
        form("creep", "three time constants")(0.01, 0.2, 0.0, 1.0, 0.02, 7.0),
        form("creep", "two time constants")(0.01, 0.2, 0.02, 7.0),
    ),
    (
        form("creep", "spectrum")(0.0, 0.01, 0.0, 0.02, 0.0, 0.0),
        form("creep", "two time constants")(0.01, 0.1, 0.02, 10.0),
    ),
]


@pytest.mark.parametrize(
    ("richer", "simpler"), NESTED, ids=lambda effect: effect.full_name().replace(", ", "-")
)
def test_a_richer_form_holds_the_simpler_one(richer, simpler):
    x = rough()
    np.testing.assert_allclose(
        ran(richer, x), ran(simpler, x), rtol=1e-12, atol=1e-12 * np.abs(x).max()
    )


@pytest.mark.parametrize(
    "kind", [f for f in FORMS if any(p.neutral is not None for p in f.parameters)], ids=full_name
)
def test_a_form_at_its_neutral_values_changes_nothing(kind):
    x = rough()
    neutral = {p.name: p.neutral for p in kind.parameters if p.neutral is not None}
    np.testing.assert_allclose(ran(kind(**neutral), x), x, rtol=1e-12)


@pytest.mark.parametrize("words", [kind.form for kind in forms_of(CATALOGUE["creep"])[1:]])
@pytest.mark.parametrize("ts", [1e-4, 0.3])
def test_creep_in_every_form_is_a_sum_of_exact_lags(words, ts):
    effect = form("creep", words)()
    x = rough()
    gains, taus = effect.elements()
    times = np.arange(len(x)) * ts
    elements = [lsim(([1.0], [tau, 1.0]), x - x[0], times)[1] + x[0] for tau in taus]
    expected = x + np.asarray(gains) @ np.array(elements)
    # lsim loses digits where the time constant is many samples long
    np.testing.assert_allclose(ran(effect, x, ts), expected, atol=1e-6 * np.abs(x).max())


@pytest.mark.parametrize(
    "kind", [k for k in FORMS if k.name in ("creep", "slew_limit")], ids=full_name
)
def test_an_input_linear_between_samples_gives_the_same_at_an_eighth_of_ts(kind):
    x = rough(200)
    fine = np.interp(np.arange(199 * 8 + 1) / 8, np.arange(200), x)
    effect = kind()
    np.testing.assert_allclose(
        effect.run(fine, 0.01 / 8)[::8], effect.run(x, 0.01), atol=1e-9 * np.abs(x).max()
    )


@pytest.mark.parametrize("words", [kind.form for kind in forms_of(CATALOGUE["creep"])[1:]])
def test_creep_begins_at_rest_and_ends_with_its_whole_gain(words):
    effect = form("creep", words)()
    gains, taus = effect.elements()
    whole = 1.0 + np.sum(gains)
    np.testing.assert_allclose(ran(effect, np.full(50, 7.0)), 7.0 * whole, rtol=1e-12)
    step = effect.run([1.0] + [3.0] * 200, 0.2 * max(taus))
    assert step[-1] == pytest.approx(3.0 * whole, rel=1e-9)


def test_elements_between_two_times_are_those_of_the_simplest_ladder_at_its_ends():
    _, taus = form("creep", "between two times")(0.02, 10**-2.25, 10**3.25).elements()
    np.testing.assert_allclose(taus, TIME_CONSTANTS_S, rtol=1e-12)
