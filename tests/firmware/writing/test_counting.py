"""Operations of a step, counted from text."""

import pytest

from rdpi_gym.firmware.writing.manual import Operations, count
from rdpi_gym.support.errors import InputError


def counted(body, *, before="", precision=64):
    return count(
        f"{before}\nstatic rdpi_real f(rdpi_real x)\n{{\n{body}\n}}\n", "f", precision=precision
    )


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("return -x;", Operations()),
        ("return x - -x * RDPI_C(2e-3);", Operations(additions=1, multiplications=1)),
        ("x += a[3 * i + 1] * b[2];", Operations(additions=1, multiplications=1)),
        ("return RDPI_OVER(x, RDPI_C(3.0)) / x;", Operations(divisions=1, by_constants=1)),
        ("if (x > y) { x = x * x; } else { x = x + x + x; }", Operations(2, 1, 1)),
        ("if (x) x = x * x;", Operations(multiplications=1)),
        ("if (a < b) { x = y; } else if (b < c) { x = y + y; }", Operations(1, 0, 2)),
        ("const rdpi_real *y = &x; rdpi_plant_memory *m = (rdpi_plant_memory *)y;", Operations()),
        ("x = (rdpi_real)(y) * (z);", Operations(multiplications=1)),
        ("for (int32_t i = 0; i < 4; ++i) { for (int32_t j = 0; j <= i; ++j) { x += y; } }", Operations(16)),
        ("for (int32_t i = 9; i >= 1; --i) { x += y; }", Operations(9)),
        ("for (int32_t i = 0; i < 0; ++i) { x += y; }", Operations()),
        ("for (int32_t i = 0; i < 4; ++i) { const int32_t now = i + 1; for (int32_t j = 0; j < now; ++j) { x += y; } }", Operations(16)),
        ("for (int32_t i = 0; i < (due[0] ? 1 : 0); ++i) { x += y; }", Operations(1)),
        ("/* a * b */ return x;", Operations()),
    ],
)  # fmt: skip
def test_operators(body, expected):
    assert counted(body) == expected


def test_calls_count_as_what_they_call():
    helper = "static rdpi_real g(rdpi_real x)\n{\n    return x * RDPI_SIN(x);\n}\n"
    assert counted("return g(g(x));", before=helper) == Operations(multiplications=2, mathematics=2)


def test_the_preprocessor_chooses_by_precision():
    body = "#if RDPI_PRECISION == 64\nx = x / y;\n#elif RDPI_PRECISION == 32\nx = x * y;\n#else\nx = x + y;\n#endif\nreturn x;"
    assert counted(body) == Operations(divisions=1)
    assert counted(body, precision=32) == Operations(multiplications=1)
    assert counted(body, precision=31) == Operations(additions=1)


def test_bounds_that_are_defined_or_are_a_fields_length():
    before = "#define N 3\ntypedef struct {\n    int32_t plays[5];\n} rdpi_memory;\n"
    assert counted("for (int32_t i = 0; i < N; ++i) { x += y; }", before=before) == Operations(3)
    loop = "for (uint32_t i = 0u; i < sizeof m->plays / sizeof m->plays[0]; ++i) { x += y; }"
    assert counted(loop, before=before) == Operations(5)


@pytest.mark.parametrize(
    "body", ["while (x > y) { x = y; }", "for (int32_t i = 0; i < n; ++i) { x += y; }"]
)
def test_a_loop_without_a_bound_is_not_guessed(body):
    with pytest.raises(InputError, match="cannot be counted"):
        counted(body)
