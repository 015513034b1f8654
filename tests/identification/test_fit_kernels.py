"""The kernels of identification beside plain linear algebra and finite differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from rdpi_gym.identification.least_squares import (
    bounded_least_squares,
    gram_matrices,
    tangent_matrices,
)
from rdpi_gym.identification.scale import movements
from rdpi_gym.identification.stack import Stack, command_rate, thin
from rdpi_gym.identification.uncertainty import correlation_length
from rdpi_gym.plant import settled_memory
from rdpi_gym.plant.cores.play import play_columns
from tests.looping import over

N_PLAYS = 5


def make_stack(samples=(700, 900)):
    rng = np.random.default_rng(3)
    edges = np.concatenate([[0], np.cumsum(samples)])
    phase = np.linspace(0.0, 40.0, edges[-1])
    u = (0.5 + 0.1 * phase) * np.sin(phase) + 0.01 * rng.standard_normal(edges[-1])
    v = np.concatenate([command_rate(part, 1e-3, None) for part in np.split(u, edges[1:-1])])
    weight = rng.integers(0, 3, edges[-1]).astype(float)
    return Stack(u, v, rng.standard_normal(edges[-1]), np.sqrt(weight), edges)


def regressors(stack, r, delta1, delta2, extremum):
    part = stack.record(r)
    rest = delta1 * np.arange(1, N_PLAYS + 1)
    columns = np.empty((N_PLAYS, part.stop - part.start))
    memory = settled_memory(rest, [extremum])
    play_columns(stack.u_V[part], stack.rate_V_s[part], rest, delta2, memory, columns)
    return np.vstack([stack.u_V[part], columns])


def weighted_gram(stack, r, columns):
    weight = stack.root_weight[stack.record(r)] ** 2
    centred = columns - np.average(columns, axis=1, weights=weight)[:, None]
    return (centred * weight) @ centred.T


DELTA1, DELTA2 = 0.7, 3e-4
EXTREMA = np.array([2.5, -8.0])
WEIGHTS = np.array([0.6, 0.3, 0.2, 0.1, 0.0, 0.4])
OFFSETS = np.array([0.3, -20.0])


def test_gram_matrices_are_products_of_the_play_columns():
    stack = make_stack()
    gram, means = gram_matrices(stack, N_PLAYS, DELTA1, DELTA2, EXTREMA)
    for r in range(2):
        part = stack.record(r)
        columns = np.vstack([regressors(stack, r, DELTA1, DELTA2, EXTREMA[r]), stack.y_um[part]])
        assert gram[r] == pytest.approx(weighted_gram(stack, r, columns), rel=1e-9, abs=1e-8)
        weight = stack.root_weight[part] ** 2
        assert means[r] == pytest.approx(np.average(columns, axis=1, weights=weight), abs=1e-10)


def test_tangents_are_the_derivatives_of_the_displacement():
    stack = make_stack()
    tangents, means = tangent_matrices(stack, DELTA1, DELTA2, EXTREMA, WEIGHTS, OFFSETS)
    gram, _ = gram_matrices(stack, N_PLAYS, DELTA1, DELTA2, EXTREMA)
    n = N_PLAYS + 1
    assert tangents[:, :n, :n] == pytest.approx(gram[:, :n, :n], rel=1e-9, abs=1e-8)
    for r in range(2):
        point = np.array([DELTA1, DELTA2, EXTREMA[r]])
        derivatives = []
        for k, step in enumerate((1e-7, 1e-10, 1e-7)):
            up, down = point.copy(), point.copy()
            up[k] += step
            down[k] -= step
            change = regressors(stack, r, *up) - regressors(stack, r, *down)
            derivatives.append(WEIGHTS @ change / (2 * step))
        part, own = stack.record(r), regressors(stack, r, *point)
        left = stack.y_um[part] - OFFSETS[r] - WEIGHTS @ own
        columns = np.vstack([own, left, *derivatives])
        assert tangents[r] == pytest.approx(weighted_gram(stack, r, columns), rel=1e-4, abs=1e-3)
        average = np.average(left, weights=stack.root_weight[part] ** 2)
        assert means[r, N_PLAYS + 1] == pytest.approx(average, abs=1e-10)
        assert tangents[r, -1, -1] > 0.1  # the extremum matters in this test


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    columns=st.integers(1, 12),
    zeros=st.floats(0.0, 1.0),
)
def test_bounded_least_squares_is_as_good_as_scipys(seed, columns, zeros):
    rng = np.random.default_rng(seed)
    design = np.cumsum(rng.standard_normal((50, columns)), axis=1)
    design += 0.5 * rng.standard_normal((50, 1))
    weights = np.where(rng.random(columns) < zeros, 0.0, rng.random(columns))
    target = design @ weights + 0.3 * rng.standard_normal(50)
    found, passive = bounded_least_squares(
        design.T @ design, design.T @ target, np.ones(columns, bool), 0.0, rng.random(columns) < 0.5
    )
    reference, residual = nnls(design, target)
    assert (found >= 0).all()
    assert (found[~passive] == 0).all()
    assert np.linalg.norm(design @ found - target) <= residual * (1 + 1e-9)
    assert found == pytest.approx(reference, abs=1e-5)


def test_bounded_least_squares_keeps_its_floor_and_what_is_not_allowed():
    design = np.random.default_rng(0).standard_normal((40, 3))
    target = -2.0 * design[:, 0] + design[:, 1] + design[:, 2]
    found, passive = bounded_least_squares(
        design.T @ design, design.T @ target, np.array([True, False, True]), 0.01, np.ones(3, bool)
    )
    assert found[:2].tolist() == [0.01, 0.0]
    assert passive.tolist() == [False, False, True]


def test_a_column_that_repeats_another_is_left_out():
    column = np.random.default_rng(0).standard_normal(30)
    design = np.column_stack([column, column, np.zeros(30)])
    every = np.ones(3, bool)
    found, _ = bounded_least_squares(design.T @ design, design.T @ column, every, 0.0, every)
    assert design @ found == pytest.approx(column)


def test_thinned_records_keep_turning_points_weight_and_order():
    t = np.linspace(0.0, 3.0, 3000)
    u = np.sin(2 * np.pi * t)
    stack = Stack(u, np.gradient(u, t), u, np.ones(3000), np.array([0, 1200, 3000]))
    coarse = thin(stack, 50)
    assert 50 <= coarse.u_V.size < 300
    assert np.sum(coarse.root_weight**2) == pytest.approx(3000, rel=1e-9)
    assert coarse.u_V.max() == pytest.approx(1.0, abs=1e-5)
    assert coarse.edges[-1] == coarse.u_V.size
    assert thin(stack, 2000) is stack


def test_movements_ignore_ripple_and_cut_ends():
    t = np.linspace(0.0, 3.0, 3001)
    u = np.sin(2 * np.pi * t) + 0.01 * np.sin(2 * np.pi * 100 * t)
    size, peak = movements(u, np.gradient(u, t), 0.05)
    assert size == pytest.approx(np.full(5, 2.0), rel=0.02)
    assert peak.size == 5


@over("length", [1, 20, 500])
def test_the_correlation_length_is_that_of_a_moving_average(length):
    rng = np.random.default_rng(length)
    noise = np.convolve(rng.standard_normal(200_000), np.ones(length), "valid")
    found = correlation_length(noise, np.ones(noise.size, bool))
    assert found == pytest.approx(length, rel=0.25)
