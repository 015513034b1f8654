"""The generalised core: the literature's envelopes, an integration of its own, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from rdpi_gym.plant import PAPER_III_B, Plant, PlantModel
from rdpi_gym.plant.cores.generalised import GeneralisedPI
from rdpi_gym.support.arrays import Array
from tests.looping import over
from tests.plant.cores.integration import path, run

WIRE = GeneralisedPI(  # its envelopes with their thresholds do not cross, so that its loop closes
    weights=(0.3, 0.8, 0.5, 0.2),
    thresholds_V=(3.2, 4.0, 6.0),
    rising_per_V=0.10,
    rising_centre_V=3.0,
    falling_per_V=0.09,
    falling_centre_V=-3.0,
    falling_gain=0.95,
)
shapes = st.builds(
    lambda a, b, c, d, e: replace(
        WIRE, rising_per_V=a, rising_centre_V=b, falling_per_V=c, falling_centre_V=d, falling_gain=e
    ),
    st.floats(0.0, 0.3), st.floats(-10.0, 10.0), st.floats(0.0, 0.3), st.floats(-10.0, 10.0),
    st.floats(0.5, 2.0),
)  # fmt: skip
volts = st.floats(-12.0, 12.0)


class Tanh:
    """An envelope of the literature, c0 tanh(c1 u + c2) + c3."""

    def __init__(self, c0: float, c1: float, c2: float, c3: float) -> None:
        self.c0, self.c1, self.c2, self.c3 = c0, c1, c2, c3

    def at(self, u: float) -> float:
        return float(self.c0 * np.tanh(self.c1 * u + self.c2) + self.c3)

    def slope(self, u: float) -> float:
        return float(self.c0 * self.c1 / np.cosh(self.c1 * u + self.c2) ** 2)


RISING, FALLING = Tanh(8.0, 0.11, -0.22, -0.5), Tanh(10.0, 0.09, 0.27, 1.8)


def sliding(r: float, x: float, corners: Array, samples: int) -> Array:
    """A play between both envelopes: dx/dt follows the envelope that it touches, by events and integration."""
    out = [x]
    for a, b in pairwise(corners):
        times = np.linspace(0.0, 1.0, samples)[1:]
        envelope, side = (RISING, -r) if b > a else (FALLING, r)

        def gap(
            t: float, x: Array, a: float = a, b: float = b, e: Tanh = envelope, s: float = side
        ) -> float:
            return e.at(a + (b - a) * t) + s - float(x[0])

        def slides(
            t: float, x: Array, a: float = a, b: float = b, e: Tanh = envelope
        ) -> list[float]:
            return [e.slope(a + (b - a) * t) * (b - a)]

        gap.terminal = True  # type: ignore[attr-defined]
        touches = 0.0
        if gap(0.0, np.array([x])) * (b - a) < -1e-12:
            rests = solve_ivp(
                lambda t, x: [0.0], (0.0, 1.0), [x],
                events=gap, max_step=0.1, rtol=1e-11, atol=1e-12,
            )  # fmt: skip
            touches = float(rests.t[-1])
        out += [x] * int(np.sum(times <= touches))
        if touches < 1.0:
            at = times[times > touches]
            moves = solve_ivp(slides, (touches, 1.0), [x], t_eval=at, rtol=1e-11, atol=1e-12)
            out += moves.y[0].tolist()
            x = float(moves.y[0, -1])
    return np.array(out)


def test_it_is_an_independent_integration_of_the_envelopes_of_the_literature() -> None:
    corners = np.concatenate([[0.0], np.random.default_rng(5).uniform(-15.0, 15.0, 24)])
    u, radii, gains = path(corners), (0.2, 1.4, 3.0), (0.8, 0.5, 0.2)
    at_rest = 0.5 * (RISING.at(0.0) + FALLING.at(0.0))
    apart = 0.5 * (FALLING.at(0.0) - RISING.at(0.0))
    y = np.zeros_like(u)
    for p, r in zip(gains, radii, strict=True):
        y += p * (sliding(r, at_rest, corners, 40) - at_rest)
    scale = RISING.c0 * RISING.c1
    mean = 0.5 * np.array([RISING.at(v) + FALLING.at(v) for v in u]) - at_rest
    core = GeneralisedPI(
        (0.3, *(scale * p for p in gains)), tuple((r + apart) / scale for r in radii),
        RISING.c1, -RISING.c2 / RISING.c1, FALLING.c1, -FALLING.c2 / FALLING.c1,
        FALLING.c0 * FALLING.c1 / scale,
    )  # fmt: skip
    whole = y + 0.3 * mean / scale
    np.testing.assert_allclose(run(core, u), whole, atol=1e-6 * np.ptp(whole))


def test_without_bend_it_is_the_paper_s_model() -> None:
    u = path(np.random.default_rng(1).uniform(-9.0, 9.0, 30))
    plain = PAPER_III_B.static()
    straight = GeneralisedPI(plain.weights, plain.thresholds_V)
    model = PlantModel(plain, "plain", (-10.0, 10.0), (0.0, 5.0))
    np.testing.assert_allclose(run(straight, u), Plant(model, 1e-3).simulate(u), atol=1e-13)


@over("bend", [0.0, 1e-300, 1e-9, 0.3, 7.0, 1e3])
def test_an_envelope_is_tanh_to_the_last_digits(bend: float) -> None:
    core = replace(WIRE, rising_per_V=bend, rising_centre_V=-1.5)
    u = np.linspace(-40.0, 40.0, 4001)
    exact = u if bend < 1e-200 else (np.tanh(bend * (u + 1.5)) - np.tanh(bend * 1.5)) / bend
    np.testing.assert_allclose(core.envelopes(u)[0], exact, atol=3e-15 * np.ptp(exact), rtol=2e-15)


@given(shapes, st.lists(volts, min_size=1, max_size=6), volts, volts)
def test_more_command_is_never_less_displacement(
    core: GeneralisedPI, turns: list[float], one: float, other: float
) -> None:
    low, high = (run(core, np.array([*turns, u]))[-1] for u in sorted((one, other)))
    assert low <= high + 1e-12


@given(
    shapes, st.lists(volts, min_size=1, max_size=5), st.floats(0.05, 0.95), st.floats(0.05, 0.95)
)
def test_a_loop_within_is_forgotten_whatever_the_shape(
    core: GeneralisedPI, turns: list[float], depth: float, height: float
) -> None:
    top = 13.0
    inner = [top * height, -top * depth, top * height]
    once = run(core, np.array([*turns, top, -top, top * 0.9]))
    looped = run(core, np.array([*turns, top, -top, *inner, top * 0.97, -top, top * 0.9]))
    assert looped[-1] == pytest.approx(once[-1], abs=1e-12)
