"""Figures of the error's spectrum, harmonics, rests and clock: complete, and labelled with units."""

from html import escape

import numpy as np
import pytest
from rdpi_gym.report.comparison.views import (
    distortion_parts,
    error_over_clock,
    error_since_rest,
    error_spectrum,
)

from rdpi_gym.diagnosis import compare
from rdpi_gym.measurement import Dataset, Quantities, Record
from rdpi_gym.plant import P5, Plant, named_plant
from rdpi_gym.report.comparison_page import write_compare_page

TS = 1e-3


def record(name, u, start_s, role="train"):
    t = start_s + np.arange(u.size) * TS
    return Record(name, t, u, Plant(P5, TS).simulate(u), ts_s=TS, role=role)


@pytest.fixture(scope="module")
def comparison():
    wave = 10.0 * np.sin(2 * np.pi * 5.0 * np.arange(3000) * TS)
    steps = np.repeat([0.0, 8.0, -4.0], 2000)
    records = (
        record("<i>sine</i>", wave, 0.0),
        record("steps", steps, 5.0),
        record("held", 0.5 * wave, 20.0, "validation"),
    )
    return compare(Dataset("three", records), named_plant("P5-static"))


def figures(comparison):
    return {
        "spectrum": error_spectrum(comparison.spectrum),
        "distortion": distortion_parts(comparison.distortion),
        "rest": error_since_rest(comparison.since_rest, comparison.noise_floor_um),
        "clock": error_over_clock(comparison.clock),
    }


def test_every_axis_carries_its_unit(comparison):
    for name, figure in figures(comparison).items():
        titles = [
            Quantities().fill(axis.title.text)
            for axis in (*figure.select_xaxes(), *figure.select_yaxes())
            if axis.title.text
        ]
        assert len(titles) >= 1, name
        for title in titles:
            assert any(f"({unit})" in title for unit in ("µm", "s", "Hz", "%")), title


def test_every_row_is_drawn(comparison):
    drawn = figures(comparison)
    assert len(drawn["spectrum"].data[0].x) == len(comparison.spectrum)
    assert [len(bar.x) for bar in drawn["distortion"].data] == [len(comparison.distortion)] * 5
    points = sum(len(line.x) for line in drawn["clock"].data)
    assert points == len(comparison.clock)
    resting = comparison.since_rest[comparison.since_rest["state"] == "resting"]
    assert len(drawn["rest"].data[0].x) == len(resting)


def test_names_are_text(comparison):
    for figure in figures(comparison).values():
        assert "<i>sine" not in figure.to_json().replace("\\u003c", "<")


def test_page_tells_what_every_check_says(comparison, tmp_path):
    page = write_compare_page(tmp_path / "report.html", comparison).read_text(encoding="utf-8")
    for check in comparison.checks:
        assert escape(check.sentence) in page
    for heading in ("Tests without a model", "Harmonics", "Spectrum and coherence", "Drift over"):
        assert f"<h2>{heading}" in page
