"""Each result prints itself, shows itself in a notebook, draws, and becomes a table, a page, a file."""

import re
from dataclasses import fields, is_dataclass

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

import rdpi_gym as rg
from rdpi_gym.diagnosis.checks import Check


def same(one, other):
    """Whether two values are equal in every number, text and array; checks by their sentences.

    A file holds a check's sentence as it was written, and not the values that the sentence was made of.
    """
    if isinstance(one, Check):
        return isinstance(other, Check) and one.to_dict() == other.to_dict()
    if is_dataclass(one) and not isinstance(one, type):
        return type(one) is type(other) and all(
            same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one)
        )
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(
            one, other, equal_nan=one.dtype.kind == "f"
        )
    if isinstance(one, pd.DataFrame):
        pd.testing.assert_frame_equal(one, other)
        return True
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[k], other[k]) for k in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other or (one != one and other != other)


def test_is_a_result(results, subtests):
    for name, result in results.items():
        with subtests.test(name):
            assert isinstance(result, rg.Result)


def test_first_line_is_short_and_has_a_number(results, subtests):
    for name, result in results.items():
        with subtests.test(name):
            first = repr(result).splitlines()[0]
            assert re.search(r"\d", first)
            assert len(first) <= 400
            assert "object at 0x" not in repr(result)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("model", "µm"),
        ("comparison", "µm"),
        ("models", "µm"),
        ("found", "µm"),
        ("scores", "%"),
        ("paper", "µm"),
        ("data", "samples"),
    ],
)
def test_the_number_has_its_unit(results, name, unit):
    assert unit in repr(results[name]).splitlines()[0]


def test_a_notebook_shows_the_answer_a_table_and_a_figure(results, subtests):
    for name, result in results.items():
        with subtests.test(name):
            html = result._repr_html_()
            assert html.startswith("<div><p><strong>")
            assert "<table" in html
            assert 'src="data:image/png;base64,' in html


def test_what_a_user_wrote_is_escaped_in_a_notebook(data):
    from dataclasses import replace

    named = replace(data, title="<script>alert(1)</script>")
    assert "<script>" not in named._repr_html_()
    assert "&lt;script&gt;" in named._repr_html_()


def test_plot_gives_axes_with_lines_and_units(results, subtests):
    for name, result in results.items():
        with subtests.test(name):
            try:
                axes = np.atleast_1d(result.plot())
                assert all(isinstance(each, Axes) for each in axes)
                assert all(each.has_data() for each in axes)
                assert any("(" in each.get_xlabel() for each in axes)
            finally:
                plt.close("all")


def test_becomes_a_table(results, subtests):
    for name, result in results.items():
        with subtests.test(name):
            table = result.to_dataframe()
            assert isinstance(table, pd.DataFrame)
            assert len(table)


def test_table_is_the_callers_own(comparison):
    table = comparison.to_dataframe()
    table["rmse_um"] = 0.0
    assert comparison.rmse_um() > 0


@pytest.mark.slow
def test_becomes_a_page_that_fetches_nothing(results, tmp_path, subtests):
    for name, result in results.items():
        with subtests.test(name):
            path = result.page(tmp_path / "page.html")
            text = path.read_text(encoding="utf-8")
            assert text.startswith("<!DOCTYPE html>")
            assert "default-src 'none'" in text


def test_is_saved_and_loaded_to_the_last_bit(results, tmp_path, subtests):
    for name, result in results.items():
        with subtests.test(name):
            path = result.save(tmp_path / "result.npz")
            assert same(rg.load_result(path), result)
            assert same(type(result).load(path), result)


def test_a_loaded_result_goes_on(data, tmp_path):
    again = rg.load_result(data.save(tmp_path / "data.npz"))
    assert rg.fit(again, plays=5).parameters == rg.fit(data, plays=5).parameters


def test_records_are_written_as_files_that_are_read_back(data, tmp_path):
    again = rg.load(data.write(tmp_path / "records"))
    assert {(r.name, r.role) for r in again.train} == {(r.name, r.role) for r in data.train}
    (one,) = [r for r in again.records if r.name == "sine-50hz"]
    (before,) = [r for r in data.records if r.name == "sine-50hz"]
    np.testing.assert_allclose(one.y_um, before.y_um, rtol=1e-14)
