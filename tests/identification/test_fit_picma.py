"""The measured stack: the figures that identification is to reach."""

import math

import pytest

from rdpi_gym.identification import fit, validation_rmse
from rdpi_gym.measurement import example_folder, load
from rdpi_gym.plant import named_plant

FOLDER = example_folder("picma")


def test_errors_on_both_files_time_and_warning():
    data = load(FOLDER)
    fit(data)
    result = min((fit(data) for _ in range(3)), key=lambda r: r.seconds)
    assert result.train_rmse_um <= 0.39
    assert result.validation_rmse_um <= 0.38
    assert result.seconds <= 0.3
    assert "δ2 is not determined by these data: all rates are alike" in result.warnings[0]
    assert any("residuals are correlated" in warning for warning in result.warnings)


def test_the_plant_that_ships_is_the_one_that_is_identified():
    data = load(FOLDER)
    shipped, fitted = named_plant("picma"), fit(data).plant
    assert validation_rmse(shipped, data.train) == pytest.approx(fit(data).train_rmse_um, rel=1e-3)
    assert shipped.hysteresis.a0 == pytest.approx(fitted.hysteresis.a0, rel=0.1)


def test_the_plant_that_ships_says_what_it_does_not_know():
    shipped = named_plant("picma")
    assert shipped.name == "picma"
    assert "δ2 is not determined" in shipped.note
    stated = shipped.identification
    assert stated["train_rmse_um"] <= 0.39
    assert stated["validation_rmse_um"] <= 0.38
    assert math.isfinite(stated["fastest_peak_rate_V_s"])
    assert stated["warnings"]
