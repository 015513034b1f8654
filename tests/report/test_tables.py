"""Tables: escaped, sortable by the full number, readable headings."""

import math
import re

import numpy as np
import pandas as pd

from rdpi_gym.measurement import Quantities
from rdpi_gym.report.tables import SEARCH_FROM_ROWS, format_number, heading, table_html
from tests.looping import over


@over(
    "name, shown",
    [
        ("rmse_um", "RMSE (µm)"),
        ("nrmse_percent", "NRMSE (%)"),
        ("ts_s", "Ts (s)"),
        ("frequency_hz", "Frequency (Hz)"),
        ("command_total_variation", "Command total variation"),
        ("max_command_step_V", "Max command step (V)"),
        ("status", "Status"),
        ("Error at 50 Hz (µm)", "Error at 50 Hz (µm)"),
    ],
)
def test_heading(name, shown):
    assert Quantities().fill(heading(name)) == shown


def test_full_number_is_kept_for_sorting():
    html = table_html(pd.DataFrame({"rmse_um": [1 / 3, 2e-9]}))
    assert [float(x) for x in re.findall(r'data-sort="([^"]+)"', html)] == [1 / 3, 2e-9]
    assert ">0.3333<" in html


def test_missing_values_are_a_dash_and_sort_as_nothing():
    frame = pd.DataFrame({"a": [1.0, np.nan], "b": pd.Series(["x", None], dtype=object)})
    assert table_html(frame).count('data-sort="">–<') == 2


def test_long_tables_can_be_searched():
    assert "search" not in table_html(pd.DataFrame({"a": range(SEARCH_FROM_ROWS - 1)}))
    assert "search" in table_html(pd.DataFrame({"a": range(SEARCH_FROM_ROWS)}))


def test_booleans_are_words():
    html = table_html(pd.DataFrame({"ok": [True, False]}))
    assert ">yes<" in html
    assert ">no<" in html


@over("value", [1.5e-7, 3.14159, -2.0, 12345678.0, 0.0])
def test_four_digits_are_true(value):
    shown = float(format_number(value).replace("\N{MINUS SIGN}", "-"))
    assert math.isclose(shown, value, rel_tol=5e-4)
