"""Records made in Python: a value that is none, or of an absurd size, is named where the record is made."""

from __future__ import annotations

import itertools
from contextlib import suppress

import numpy as np
import pytest

import rdpi_gym as rg
from rdpi_gym.measurement import LARGEST, Record
from tests.looping import over

SCALES = [1e-300, 1e-100, 1e-30, 1.0, 1e30, 1e100, 1e300]
ROWS = {"single": [200], "run": range(100, 120), "start": [0], "end": [399], "all": range(400)}


def columns():
    t = np.arange(400) * 5e-3
    u = 20.0 * np.sin(2.0 * np.pi * t) * np.linspace(0.3, 1.0, t.size)
    return {"t_s": t, "u_V": u, "y_um": 0.6 * u + 0.8 * np.abs(np.sin(u / 7.0))}


def made(ts_s=5e-3, **changed):
    return rg.Dataset("mine", (Record("run", **{**columns(), **changed}, ts_s=ts_s),))


@over("rows", ROWS.values())
@over("column", ["t_s", "u_V", "y_um"])
@over("value", [np.nan, np.inf, -np.inf, 2 * LARGEST])
def test_the_first_value_that_is_none_is_named(column, rows, value):
    values = columns()[column]
    values[list(rows)] = value
    with pytest.raises(rg.InputError) as refused:
        rg.fit(made(**{column: values}))
    said = str(refused.value)
    assert said.startswith(f"record run: {column}[{rows[0]}] is {value:g}, ")
    assert ("no finite number" in said) == (not np.isfinite(value))


@over("column", ["reference_um", "temperature_C", "before_V", "others"])
def test_further_columns_are_read_too(column):
    values = np.append(np.zeros(399), np.nan)
    given = {"u2": values} if column == "others" else values
    name = "u2" if column == "others" else column
    with pytest.raises(rg.InputError, match=rf"record run: {name}\[399\] is nan"):
        made(**{column: given})


@over("ts_s", [0.0, -1.0, np.nan, np.inf, 1e-31, 1e31])
def test_a_sampling_time_that_is_none_is_refused(ts_s):
    with pytest.raises(rg.InputError, match=r"ts_s is [-0-9a-z+.]+; give a sampling time"):
        made(ts_s=ts_s)


@pytest.mark.slow
def test_a_fit_at_any_size_ends():
    """A stroke of 1e300 had kept the search for weights in a loop without end."""
    for u, y, t in itertools.product(SCALES, repeat=3):
        with np.errstate(over="ignore"):
            here = {"u_V": u, "y_um": y, "t_s": t}
            scaled = {name: size * columns()[name] for name, size in here.items()}
        with suppress(rg.InputError):
            assert rg.fit(made(ts_s=5e-3 * t, **scaled)).train_rmse_um < y


@over("size", [1e-29, 1.0, 1e28])
def test_a_displacement_within_the_bounds_is_fitted_alike(size):
    found = rg.fit(made(y_um=size * columns()["y_um"]))
    assert found.train_rmse_um == pytest.approx(size * rg.fit(made()).train_rmse_um)


def test_a_displacement_of_nothing_is_no_motion():
    with pytest.raises(rg.InputError, match="the displacement never changes: it is 0 µm in run"):
        rg.fit(made(y_um=1e-300 * columns()["y_um"]))


@over("fitted", [rg.fit, lambda data: rg.fit_core(data, "stop")])
def test_records_at_rest_are_no_records_to_fit(fitted):
    with pytest.raises(rg.InputError, match="no record to fit"):
        fitted(made(u_V=np.full(400, 2.0)))


def test_a_saved_data_set_is_read_as_strictly(tmp_path):
    path = made().save(tmp_path / "data.npz")
    kept = dict(np.load(path, allow_pickle=False))
    for name, values in kept.items():
        if values.dtype == np.float64 and values.shape == (400,):
            kept[name] = 1e300 * (1.0 + values)
    np.savez(path, **kept)
    with pytest.raises(rg.InputError, match="too large for a measurement"):
        rg.load_result(path)
