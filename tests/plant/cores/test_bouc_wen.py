"""Bouc-Wen: closed forms, an independent integration, its limits, and the asymmetric form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rdpi_gym.plant.cores.bouc_wen import AsymmetricBoucWen, BoucWen
from tests.looping import over
from tests.plant.cores.integration import corners, integrated, run, sampled

CASES = [
    (limit, sigma, exponent, skew)
    for limit in (0.5, 4.0, 40.0)
    for sigma, exponent, skew in (
        (0.5, 1.0, 0.0), (0.7, 1.0, 0.3), (1.0, 1.05, 0.0), (0.6, 1.5, 0.0), (0.8, 2.0, -0.4),
        (3.0, 2.5, 0.2), (0.5, 3.7, 0.0), (0.9, 12.0, 0.0),
    )
]  # fmt: skip


def core_of(limit: float, sigma: float, exponent: float, skew: float = 0.0) -> BoucWen:
    return AsymmetricBoucWen(0.3, 1.0, limit, sigma, exponent, None, skew)


@over("case", CASES)
@over("longest_V", [50.0, 0.13])
def test_it_equals_an_independent_integration(case, longest_V: float) -> None:
    limit, sigma, n, skew = case
    total = limit**-n
    beta, gamma = sigma * total, (1.0 - sigma) * total

    def slope(z: float, sign: float) -> float:
        power = abs(z) ** n
        return 1.0 + skew * np.sign(z) - (beta * sign * np.sign(z) + gamma) * power

    u, turns = sampled(corners(), longest_V)
    z = integrated(slope, corners(), event=skew != 0.0)
    y = 0.3 * corners() + z
    np.testing.assert_allclose(run(core_of(*case), u)[turns], y, atol=1e-7 * np.ptp(y))


def test_the_first_loading_is_that_of_the_closed_forms() -> None:
    u = np.linspace(0.0, 12.0, 200)
    exponential = run(BoucWen(0.0, 1.0, 3.0, 0.5, 1.0), u)
    np.testing.assert_allclose(exponential, 3.0 * -np.expm1(-u / 3.0), atol=1e-14)
    tanh = run(BoucWen(0.0, 1.0, 3.0, 0.5, 2.0), u)
    np.testing.assert_allclose(tanh, 3.0 * np.tanh(u / 3.0), atol=1e-8)


def test_the_way_back_is_straight_for_sigma_one_half_and_a_tangent_for_one() -> None:
    back = np.linspace(20.0, 17.5, 60)
    path = np.concatenate([[20.0], back])
    straight = run(BoucWen(0.0, 1.0, 3.0, 0.5, 2.0), path)[1:]
    np.testing.assert_allclose(straight, straight[0] + back - 20.0, atol=1e-12)
    bent = run(BoucWen(0.0, 1.0, 3.0, 1.0, 2.0), np.linspace(20.0, 18.0, 60))
    z0 = 3.0 * math.tanh(20.0 / 3.0)
    angle = math.atan(z0 / 3.0) - (20.0 - np.linspace(20.0, 18.0, 60)) / 3.0
    np.testing.assert_allclose(bent, 3.0 * np.tan(angle), atol=1e-7)


def test_the_numbers_of_the_literature_make_the_same_model() -> None:
    # Ikhouane, Rodellar: z0 = (A / (β + γ))^(1/n), and A, β, γ, d are one model under a scale of z.
    core = BoucWen.from_law(k=0.5, d=2.0, beta=0.4, gamma=0.1, n=1.5, A=3.0)
    z0 = (3.0 / 0.5) ** (1.0 / 1.5)
    top = float(run(core, np.array([1e3]))[0]) - 0.5e3
    assert top == pytest.approx(2.0 * z0, rel=1e-12)
    assert core.sigma == pytest.approx(0.8)

    def slope(z: float, sign: float) -> float:
        power = abs(z) ** 1.5
        return 3.0 - (0.4 * sign * np.sign(z) + 0.1) * power

    y = 0.5 * corners() + 2.0 * integrated(slope, corners())
    np.testing.assert_allclose(run(core, corners()), y, atol=1e-7 * np.ptp(y))


def test_it_never_passes_its_limit_and_no_step_is_too_long() -> None:
    rng = np.random.default_rng(3)
    for exponent in (1.0, 1.3, 2.0, 9.0, 16.0):
        core = AsymmetricBoucWen(0.0, 1.0, 2.0, 1.3, exponent, None, 0.4)
        low, high = core.reach_V
        u = rng.normal(size=400) * 10.0 ** rng.uniform(-6.0, 200.0, 400)
        y = run(core, u)
        assert np.all((y >= low * (1 + 1e-15)) & (y <= high * (1 + 1e-15)))
        assert run(core, np.array([1e308, -1e308])).tolist() == pytest.approx([high, low])


def test_the_asymmetric_form_saturates_at_unlike_heights_and_is_nested() -> None:
    u = 20.0 * np.sin(np.linspace(0.0, 12.0, 500))
    plain = BoucWen(0.4, 0.8, 3.0, 0.8, 1.6)
    same = AsymmetricBoucWen(0.4, 0.8, 3.0, 0.8, 1.6)
    np.testing.assert_array_equal(run(plain, u), run(same, u))
    skewed = AsymmetricBoucWen(0.0, 1.0, 3.0, 0.8, 1.6, None, 0.3)
    assert run(skewed, np.array([500.0]))[0] == pytest.approx(3.0 * 1.3 ** (1 / 1.6))
    assert run(skewed, np.array([-500.0]))[0] == pytest.approx(-3.0 * 0.7 ** (1 / 1.6))


@over("d", [-10.0, 10.0])
def test_a_fit_stays_where_the_displacement_rises_with_the_command(d: float) -> None:
    core = AsymmetricBoucWen(1.0, 0.1, 2.0, 0.6, 1.5, None, 0.2).with_gains([1.0, d])
    core = core.with_shape({"sigma": 3.0, "skew": -0.9, "limit_V": 0.5, "exponent": 1.2})
    assert core.d == pytest.approx(d if d > 0 else -1.0 / (6.0 * 1.9), rel=1e-5)
    path, _ = sampled(corners(), 0.02)
    assert np.all(np.diff(run(core, path)) * np.diff(path) >= -1e-12)
    assert core.with_gains([0.0, 0.0]).a0 > 0.0
