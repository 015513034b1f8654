"""Header and source: clean in every precision, and a wall around whatever comes in."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rdpi_gym.firmware.program import Table
from rdpi_gym.firmware.writing.source import Source, header_text, safe, source_text
from tests.firmware.programs import (
    COMPILERS,
    CONTROLLER,
    GREEDY,
    PLANT,
    Running,
    compiles,
    needs_gcc,
    needs_gcc_or_clang,
    write,
)

CLAMPED, SATURATED, OUT_OF_RANGE = 1, 2, 4


@needs_gcc_or_clang
def test_it_compiles_without_a_warning_and_refuses_wrong_flags(tmp_path):
    for compiler in COMPILERS:
        for program in (CONTROLLER, PLANT, GREEDY):
            path = write(program, tmp_path)
            for precision in (64, 32):
                for flags in ((), ("-O2", "-DRDPI_NO_DIVISION")):
                    assert compiles(compiler, path, precision, *flags) == "", program.title
        path = write(CONTROLLER, tmp_path)
        assert "has no form on whole numbers" in compiles(compiler, path, 31)
        assert "without -ffast-math" in compiles(compiler, path, 64, "-ffast-math")


def test_helpers_are_written_where_they_are_called_alone():
    text = source_text(Source(CONTROLLER))
    assert "rdpi_min" in text
    assert not [each for each in ("math.h", "rdpi_copysign", "RDPI_OVER") if each in text]
    assert "#include <math.h>" in source_text(Source(GREEDY))


def test_a_field_has_a_name_of_c_of_its_own():
    for name in ("double", "Gain", "a b", "1st", "gain"):
        tables = [*CONTROLLER.tables, Table(name, np.ones(1))]
        with pytest.raises(ValueError, match="no new identifier"):
            header_text(Source(replace(CONTROLLER, tables=tables)))


NASTY = [
    "*/ #error x /*",
    "\\\n#error x",
    "??/\n#error x",
    '"); system("',
    "\x00\x1b[2J",
    "µm · \u2028",
    "//",
    "%s%n",
]


def bare(text):
    assert text.isascii()
    assert "??" not in text
    assert "\\" not in text
    return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)


@settings(max_examples=100, deadline=None)
@given(st.one_of(st.text(), st.sampled_from(NASTY), st.text("*/\\?\n%\"'@")))
def test_no_name_of_a_model_reaches_the_code(name):
    for program in (CONTROLLER, PLANT):
        for text in (header_text, source_text):
            named = text(Source(replace(program, title=name, model=name)))
            assert bare(named) == bare(text(Source(program)))
    assert len(safe(name)) <= 60


@needs_gcc_or_clang
def test_nasty_names_compile(tmp_path):
    for k, name in enumerate(NASTY):
        path = write(replace(CONTROLLER, title=name, model=name), tmp_path / str(k))
        for compiler in COMPILERS:
            assert compiles(compiler, path, 64, "-trigraphs") == "", name


@pytest.fixture
def running(tmp_path):
    return Running(write(CONTROLLER, tmp_path, reach_um=(-20.0, 20.0)), 2.0)


@needs_gcc
def test_memory_advances_only_where_a_step_is_acknowledged(running):
    first = running.step(2.0, [4.0], 1.0)
    assert first == 0.5 * 4.0 + (2.0 + 0.25)
    assert running.step(2.0, [4.0], 1.0) == first
    running.acknowledge(math.nan)  # was not written
    assert running.step(2.0, [4.0], 1.0) == first
    running.acknowledge(first)
    running.acknowledge(first)  # once is enough
    assert running.step(2.0, [4.0], 1.0) == first + 0.25


@needs_gcc
def test_an_input_that_is_no_number_holds_the_last_command(running):
    first = running.step(2.0, [4.0], 1.0)
    running.acknowledge(first)
    expected = running.step(2.0, [4.0], 1.0)
    for strange in (math.nan, math.inf, -math.inf, 1e300, 1e9):
        for inputs in ((strange, [4.0], 1.0), (2.0, [strange], 1.0), (2.0, [4.0], strange)):
            assert running.step(*inputs) == first, inputs
            assert running.flags == OUT_OF_RANGE
            running.acknowledge(first)
            assert running.step(2.0, [4.0], 1.0) == expected, inputs
            assert running.flags == 0


@needs_gcc
def test_flags_of_limits_and_of_a_first_reference_that_is_no_number(running, tmp_path):
    assert running.step(2.0, [21.0], 2.0) == 12.5
    assert running.flags == SATURATED
    assert running.step(2.0, [-70.0], 2.0) == -25.0
    assert running.flags == SATURATED | CLAMPED
    strange = Running(write(CONTROLLER, tmp_path / "strange"), math.nan)
    assert strange.flags == OUT_OF_RANGE
    assert strange.step(0.0, [1.0], 0.0) == 0.5


@needs_gcc
def test_a_body_that_goes_astray_does_not_leave_the_range(tmp_path):
    for k, answer in enumerate(("RDPI_NAN", "RDPI_INFINITY", "RDPI_C(1e9)", "RDPI_C(-26.0)")):
        path = write(replace(CONTROLLER, step=f"return {answer};"), tmp_path / str(k))
        astray = Running(path)
        assert -25.0 <= astray.step(0.0, [0.0], 0.0) <= 25.0, answer
        assert astray.flags in (CLAMPED, OUT_OF_RANGE), answer
