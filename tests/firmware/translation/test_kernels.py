"""The C of a kernel gives the kernel's bits: every effect, every form, and the laws of the translation."""

import ctypes
from itertools import pairwise

import numpy as np
import pytest
from numba import njit

from rdpi_gym.firmware.program import Block, Known, Number
from rdpi_gym.firmware.translation.kernels import Functions
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import forms_of
from rdpi_gym.support.errors import InputError
from tests.firmware.programs import head, library, needs_gcc

TS_S = 1e-4
SAMPLES = 3000
FORMS = [form for name in CATALOGUE for form in forms_of(CATALOGUE[name]) if form.slot != "memory"]


def _no_local(kind, count):
    raise AssertionError("an effect returns nothing")


def _record(seed):
    """A command with jumps, holds and turns, and the displacement that goes with it."""
    rng = np.random.default_rng(seed)
    t = TS_S * np.arange(SAMPLES)
    u = 20.0 * np.sin(2 * np.pi * 37.0 * t) + np.repeat(rng.normal(0, 5, SAMPLES // 100), 100)
    return u, 1.1 * u + 2.0 * np.sin(2 * np.pi * 11.0 * t)


@needs_gcc
def test_every_form_of_every_effect_is_equal_bit_by_bit(tmp_path):
    functions, drivers = Functions(), []
    for k, form in enumerate(FORMS):
        effect = form()
        p = np.array(effect.coefficients(TS_S, P10.hysteresis))[:, None]
        rows = effect.state_rows_with(TS_S, P10.hysteresis)
        values = [
            Block("x + t", (1, 1)), Block("u + t", (1, 1)), Block("p", p.shape, known=p),
            Block("state", (rows, 1)), Known(TS_S), Block("y + t", (1, 1)),
        ]  # fmt: skip
        called = functions.call(form.block, values, _no_local)
        kinds = "const double *x, const double *u, const double *p, double *state, double *y"
        drivers.append(
            f"void form_{k}(int32_t n, {kinds});\nvoid form_{k}(int32_t n, {kinds}) {{\n"
            "(void)x; (void)u; (void)p; (void)state;\n"
            f"for (int32_t t = 0; t < n; ++t) {called.statement}\n}}\n"
        )
    effects = library("\n".join([head(tmp_path), functions.text, *drivers]), tmp_path)
    u, x = _record(5)
    for k, form in enumerate(FORMS):
        effect = form()
        p = np.array(effect.coefficients(TS_S, P10.hysteresis))
        state = np.full(max(effect.state_rows_with(TS_S, P10.hysteresis), 1), np.nan)
        y = np.empty(SAMPLES)
        arrays = [each.ctypes.data_as(ctypes.c_void_p) for each in (x, u, p, state, y)]
        getattr(effects, f"form_{k}")(SAMPLES, *arrays)
        expected = effect.run(x, TS_S, u=u, hysteresis=P10.hysteresis)
        # the first sum over vectors
        over_vectors = form.block.targetoptions.get("fastmath")
        if over_vectors or form.full_name() in {"creep", "asymmetry, unlike envelopes"}:
            assert np.abs(y - expected).max() < 1e-13 * np.ptp(expected), form.full_name()
        else:
            assert (y == expected).all(), form.full_name()


@njit
def _exchanged(x, y):
    a, b = x[0], x[1]
    a, b = b + a, a
    y[0], y[1] = b, a
    y[1], y[0] = y[0] + 1.0, y[1]


@njit
def _counted(x, y):
    most, row = 0, 0
    for i in range(x.shape[0]):
        if x[i] > 0.5:
            most = i
        elif x[i] < -0.5:
            continue
        row += 2
    y[0], y[1] = most, row
    kind = 0
    while kind < 3 and x[kind] < 0.0:
        kind += 1
    y[2] = 0.5 * kind


@njit
def _wider(x, y):
    total = 0
    for i in range(x.shape[0]):
        total += x[i]
    y[0] = total / 3.0
    y[1] = x[0] ** 3 + abs(x[1]) ** 2
    y[2] = min(max(x[0], -1.0), 1.0)


@njit
def _decided(x, y):
    n = x.shape[0]
    y[0] = 1.0 if x[0] > 0.0 and n > 3 else 2.0
    y[1] = 1.0 if x[1] > 0.0 or n > 9 else 2.0
    y[2] = 1.0 if x[0] > 0.0 and n > 9 else 2.0
    y[3] = 1.0 if x[1] > 0.0 or n > 3 else 2.0


@needs_gcc
def test_kernels_mean_in_c_what_they_mean_in_python(tmp_path):
    for kernel in (_exchanged, _counted, _wider, _decided):
        functions = Functions()
        called = functions.call(kernel, [Block("x", (4,)), Block("y", (4,))], _no_local)
        text = f"{head(tmp_path)}\n{functions.text}\nvoid go(const double *x, double *y);\n"
        text += f"void go(const double *x, double *y) {{ {called.statement} }}\n"
        compiled = library(text, tmp_path, kernel.__name__)
        rng = np.random.default_rng(1)
        for _ in range(50):
            x, expected, y = rng.normal(size=4), np.zeros(4), np.zeros(4)
            kernel(x, expected)
            compiled.go(x.ctypes.data_as(ctypes.c_void_p), y.ctypes.data_as(ctypes.c_void_p))
            assert (y == expected).all(), kernel.__name__


def test_known_numbers_are_folded_and_divisions_by_them_are_none():
    functions = Functions()
    block = CATALOGUE["rate_law"].block
    p = np.array([[-0.5], [100.0]])
    arguments = [Block("x", (1, 1)), Block("x", (1, 1)), Block("p", (2, 1), known=p)]
    empty = Block("0", (0, 1))
    functions.call(block, [*arguments, empty, Known(TS_S), Block("y", (1, 1))], _no_local)
    assert "RDPI_OVER(rdpi_abs(v), RDPI_C(100.0))" in functions.text
    assert "for" not in functions.text
    assert functions.mathematics == {"POW"}


def test_a_kernel_is_translated_once_for_the_same_arguments():
    functions = Functions()
    block = CATALOGUE["backlash"].block
    x, y, p = Block("x", (1, 1)), Block("y", (1, 1)), Block("p", (1, 1), known=np.array([[0.1]]))
    for name in ("m->one", "m->other"):
        functions.call(block, [x, x, p, Block(name, (1, 1)), Known(TS_S), y], _no_local)
    assert functions.text.count("static void") == 1


@njit
def _solved(x, y):
    y[0] = np.linalg.norm(x)


@njit
def _sized(x, n, y):
    y[0] = np.empty(n)[0]


def test_kernels_without_c_are_refused_with_their_place():
    one, size = Block("x", (2,)), Number("n", "int")
    for kernel, arguments, words in (
        (_solved, [one, Block("y", (2,))], r"np\.linalg"),
        (_sized, [one, size, Block("y", (2,))], "size known only"),
    ):
        with pytest.raises(InputError, match=rf"test_kernels\.py\), line \d+: .*{words}"):
            Functions().call(kernel, arguments, _no_local)


def test_callees_stand_before_their_callers():
    functions = Functions()
    form = next(f for f in FORMS if f.full_name() == "slew_limit")
    p, state = Block("p", (2, 1), known=np.array([[0.5], [0.5]])), Block("m", (2, 1))
    x, y = Block("x", (1, 1)), Block("y", (1, 1))
    functions.call(form.block, [x, x, p, state, Known(TS_S), y], _no_local)
    places = [
        functions.text.index(name) for name in (" step_follow(const", " step_slew_limit_block(")
    ]
    assert all(a < b for a, b in pairwise(places))
