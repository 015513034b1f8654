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
from tests.firmware.hand_made import (
    COMPILERS,
    CONTROLLER,
    GREEDY,
    PLANT,
    Running,
    compiles,
    needs_gcc,
    write,
)

CLAMPED, SATURATED, OUT_OF_RANGE = 1, 2, 4


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("precision", [64, 32])
@pytest.mark.parametrize("program", [CONTROLLER, PLANT, GREEDY], ids=lambda p: p.title)
def test_it_compiles_without_a_warning(compiler, precision, program, tmp_path):
    path = write(program, tmp_path)
    assert compiles(compiler, path, precision) == ""
    assert compiles(compiler, path, precision, "-O2", "-DRDPI_NO_DIVISION") == ""


@pytest.mark.parametrize("compiler", COMPILERS)
def test_what_would_be_wrong_is_refused_by_the_code_itself(compiler, tmp_path):
    path = write(CONTROLLER, tmp_path)
    assert "has no form on whole numbers" in compiles(compiler, path, 31)
    assert "without -ffast-math" in compiles(compiler, path, 64, "-ffast-math")


def test_only_what_is_asked_for_is_written():
    text = source_text(Source(CONTROLLER))
    assert "rdpi_min" in text
    assert "math.h" not in text
    assert "rdpi_copysign" not in text
    assert "RDPI_OVER" not in text
    assert "#include <math.h>" in source_text(Source(GREEDY))


@pytest.mark.parametrize("name", ["double", "Gain", "a b", "1st", "gain"])
def test_a_field_has_a_name_of_c_of_its_own(name):
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


@pytest.mark.parametrize("compiler", COMPILERS)
def test_nasty_names_compile(compiler, tmp_path):
    for k, name in enumerate(NASTY):
        path = write(replace(CONTROLLER, title=name, model=name), tmp_path / str(k))
        assert compiles(compiler, path, 64, "-trigraphs") == ""


@pytest.fixture
def running(tmp_path):
    return Running(write(CONTROLLER, tmp_path, reach_um=(-20.0, 20.0)), 2.0)


@needs_gcc
class TestWall:
    def test_memory_advances_only_where_a_step_is_acknowledged(self, running):
        first = running.step(2.0, [4.0], 1.0)
        assert first == 0.5 * 4.0 + (2.0 + 0.25)
        assert running.step(2.0, [4.0], 1.0) == first
        running.acknowledge(first)
        running.acknowledge(first)  # once is enough
        assert running.step(2.0, [4.0], 1.0) == first + 0.25

    @pytest.mark.parametrize("strange", [math.nan, math.inf, -math.inf, 1e300, 1e9])
    @pytest.mark.parametrize("place", range(3))
    def test_an_input_that_is_no_number_holds_the_last_command(self, running, strange, place):
        first = running.step(2.0, [4.0], 1.0)
        running.acknowledge(first)
        expected = running.step(2.0, [4.0], 1.0)
        given = [2.0, [4.0], 1.0]
        given[place] = [strange] if place == 1 else strange
        assert running.step(*given) == first
        assert running.flags == OUT_OF_RANGE
        running.acknowledge(first)
        assert running.step(2.0, [4.0], 1.0) == expected
        assert running.flags == 0

    def test_what_was_not_written_is_not_remembered(self, running):
        first = running.step(2.0, [4.0], 1.0)
        running.acknowledge(math.nan)
        assert running.step(2.0, [4.0], 1.0) == first

    def test_flags(self, running):
        assert running.step(2.0, [21.0], 2.0) == 12.5
        assert running.flags == SATURATED
        assert running.step(2.0, [-70.0], 2.0) == -25.0
        assert running.flags == SATURATED | CLAMPED

    def test_a_first_reference_that_is_no_number_is_the_centre(self, tmp_path):
        path = write(CONTROLLER, tmp_path)
        strange = Running(path, math.nan)
        assert strange.flags == OUT_OF_RANGE
        assert strange.step(0.0, [1.0], 0.0) == 0.5

    @pytest.mark.parametrize(
        "answer", ["RDPI_NAN", "RDPI_INFINITY", "RDPI_C(1e9)", "RDPI_C(-26.0)"]
    )
    def test_a_body_that_goes_astray_does_not_leave_the_range(self, tmp_path, answer):
        running = Running(write(replace(CONTROLLER, step=f"return {answer};"), tmp_path))
        command = running.step(0.0, [0.0], 0.0)
        assert -25.0 <= command <= 25.0
        assert running.flags in (CLAMPED, OUT_OF_RANGE)
