"""Test signals of generated code, what roundings may do to it, and the operations counted in its text."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.firmware.writing.package import count
from rdpi_gym.firmware.writing.source import Source
from rdpi_gym.firmware.writing.vectors import ALLOWED, ROUGH, Roundings, vectors, vectors_text
from rdpi_gym.support.errors import InputError
from tests.firmware.programs import CONTROLLER, PLANT

REACH = (-20.0, 20.0)


def test_they_are_the_same_every_time_and_stay_nearly_within_reach():
    source = Source(CONTROLLER, REACH)
    one, other = vectors(source), vectors(source)
    assert vectors_text(source, one) == vectors_text(source, other)
    reference, measured = one.inputs["reference_um"], one.inputs["measured_um"]
    assert (len(reference), len(measured), len(one.expected)) == (2001, 2000, 2000)
    assert 20.0 < np.abs(reference).max() < 25.0
    assert np.ptp(one.expected) > 20.0
    assert (np.abs(one.expected) == 25.0).mean() < 0.5
    assert 0.0 < np.abs(measured - reference[:2000]).mean() < 3.0


def test_lanes_differ_and_nearly_all_go_beyond():
    many = vectors(Source(CONTROLLER, REACH), 1000, 50)
    reference = many.inputs["reference_um"]
    assert len(np.unique(reference[500])) == 50
    assert (np.abs(reference).max(axis=0) > 20.0).mean() > 0.5


def test_those_of_a_plant_are_commands():
    made = vectors(Source(PLANT), 300, 2)
    assert made.inputs["command_V"].shape == made.expected.shape == (300, 2)


def test_every_number_reads_back_as_it_was():
    source = Source(PLANT)
    made = vectors(source, 50)
    text = vectors_text(source, made)
    body = text[text.index("rdpi_vector_expected_um") :]
    found = [float(word.partition(")")[0]) for word in body.split("RDPI_V(")[1:]]
    assert found == made.expected[:, 0].tolist()


def unstable(reference_um, measured_um):
    """u(k+1) = 1.5 u(k) + r(k+1), wrapped into the range: roundings grow."""
    u = np.zeros_like(measured_um)
    for k in range(1, len(u)):
        u[k] = (1.5 * u[k - 1] + reference_um[k + 1] + 25.0) % 50.0 - 25.0
    return u


def test_what_makes_much_of_roundings_is_told_so():
    calm, wild = (Source(replace(CONTROLLER, twin=t)) for t in (CONTROLLER.twin, unstable))
    assert Roundings.of(calm, vectors(calm)).fine < ROUGH / 3
    assert Roundings.of(calm, vectors(calm)).warning is None
    found = Roundings.of(wild, vectors(wild))
    assert found.fine > 1e6
    assert "times as much of every rounding" in found.warning


def test_what_is_allowed():
    assert Roundings().allowed == ALLOWED
    assert Roundings(1e30).allowed == {64: 1.0, 32: 1.0, 31: 1.0}
    assert 1e-6 < Roundings(1e9).allowed[64] < 1e-4
    assert (Roundings(1e9) | Roundings(1.0, 2.0, True)) == Roundings(1e9, 2.0, True)


def test_single_precision_in_python_is_allowed_for():
    single = replace(CONTROLLER, exact=False, inexact_because="numbers that are float32 in Python")
    found = Roundings.of(Source(single), vectors(Source(single)))
    assert found.single
    assert found.allowed[64] == ALLOWED[32]
    assert Roundings(1.0, 1e3, True).allowed[64] > ALLOWED[32]


def counted(body, *, before="", precision=64):
    return count(
        f"{before}\nstatic rdpi_real f(rdpi_real x)\n{{\n{body}\n}}\n", "f", precision=precision
    )


COUNTED = {
    "return -x;": {},
    "return x - -x * RDPI_C(2e-3);": {"additions": 1, "multiplications": 1},
    "x += a[3 * i + 1] * b[2];": {"additions": 1, "multiplications": 1},
    "return RDPI_OVER(x, RDPI_C(3.0)) / x;": {"divisions": 1, "by_constants": 1},
    "if (x > y) { x = x * x; } else { x = x + x + x; }": {
        "additions": 2,
        "multiplications": 1,
        "comparisons": 1,
    },
    "if (x) x = x * x;": {"multiplications": 1},
    "if (a < b) { x = y; } else if (b < c) { x = y + y; }": {"additions": 1, "comparisons": 2},
    "const rdpi_real *y = &x; rdpi_plant_memory *m = (rdpi_plant_memory *)y;": {},
    "x = (rdpi_real)(y) * (z);": {"multiplications": 1},
    "for (int32_t i = 0; i < 4; ++i) { for (int32_t j = 0; j <= i; ++j) { x += y; } }": {
        "additions": 16
    },
    "for (int32_t i = 9; i >= 1; --i) { x += y; }": {"additions": 9},
    "for (int32_t i = 0; i < 0; ++i) { x += y; }": {},
    "for (int32_t i = 0; i < 4; ++i) { const int32_t now = i + 1; for (int32_t j = 0; j < now; ++j) { x += y; } }": {
        "additions": 16
    },
    "for (int32_t i = 0; i < (due[0] ? 1 : 0); ++i) { x += y; }": {"additions": 1},
    "/* a * b */ return x;": {},
}


def test_operators():
    for body, expected in COUNTED.items():
        assert counted(body) == expected, body


def test_calls_count_as_what_they_call():
    helper = "static rdpi_real g(rdpi_real x)\n{\n    return x * RDPI_SIN(x);\n}\n"
    assert counted("return g(g(x));", before=helper) == Counter(multiplications=2, mathematics=2)


def test_the_preprocessor_chooses_by_precision():
    body = "#if RDPI_PRECISION == 64\nx = x / y;\n#elif RDPI_PRECISION == 32\nx = x * y;\n#else\nx = x + y;\n#endif\nreturn x;"
    assert counted(body) == Counter(divisions=1)
    assert counted(body, precision=32) == Counter(multiplications=1)
    assert counted(body, precision=31) == Counter(additions=1)


def test_bounds_that_are_defined_or_are_a_fields_length():
    before = "#define N 3\ntypedef struct {\n    int32_t plays[5];\n} rdpi_memory;\n"
    assert counted("for (int32_t i = 0; i < N; ++i) { x += y; }", before=before) == Counter(
        additions=3
    )
    loop = "for (uint32_t i = 0u; i < sizeof m->plays / sizeof m->plays[0]; ++i) { x += y; }"
    assert counted(loop, before=before) == Counter(additions=5)


def test_a_loop_without_a_bound_is_not_guessed():
    for body in ("while (x > y) { x = y; }", "for (int32_t i = 0; i < n; ++i) { x += y; }"):
        with pytest.raises(InputError, match="cannot be counted"):
            counted(body)
