"""What came before the first sample: a start that is left out is simulated, never compared."""

import numpy as np
import pytest

from rdpi_gym.identification import simulate_record
from rdpi_gym.identification.jacobian import Neighbours, Variant, simulate_effects
from rdpi_gym.measurement import DataOptions, Record, load
from rdpi_gym.plant import P5, Plant
from rdpi_gym.plant.effects import CATALOGUE
from tests.looping import over

TS, EARLY = 1e-2, 37


def moving(length: int = 400) -> np.ndarray:
    t = np.arange(length) * TS
    return 20.0 + 15.0 * np.sin(7.0 * t)


def test_a_record_with_its_history_runs_as_the_end_of_the_whole():
    u = moving()
    effects = (CATALOGUE["creep"](), CATALOGUE["thermal_drift"]())
    t = np.arange(len(u)) * TS
    whole = Record("whole", t, u, u, ts_s=TS)
    late = Record("late", t[EARLY:], u[EARLY:], u[EARLY:], ts_s=TS, before_V=u[:EARLY])
    variant = Variant(P5.hysteresis, effects)
    changed = Variant(P5.hysteresis, (CATALOGUE["creep"](0.02), effects[1]))
    expected = simulate_effects([variant], whole)[EARLY:]
    np.testing.assert_allclose(simulate_effects([variant], late), expected, rtol=1e-12)
    kept = np.arange(0, len(late.u_V), 3)
    gain_steps = np.full(len(P5.hysteresis.gains), 1e-4)
    rows = [
        Neighbours(variant, [changed], np.array([0.005]), gain_steps).derivatives(record, at)
        for record, at in ((late, kept), (whole, kept + EARLY))
    ]
    np.testing.assert_allclose(*rows, rtol=1e-9, atol=1e-9)
    left = simulate_record(P5, late).simulated_um
    np.testing.assert_array_equal(left, Plant(P5, TS).simulate(u)[EARLY:])


def write(path, u, y):
    rows = "\n".join(
        f"{k * TS:.9g},{a:.9g},{b:.9g}" for k, (a, b) in enumerate(zip(u, y, strict=True))
    )
    path.write_text(f"t [s],u [V],y [um]\n{rows}\n")


@over("gain", [0.8, -0.8])
def test_a_start_that_is_skipped_is_the_history_and_shows_a_step_from_0_V(tmp_path, gain):
    u = moving()
    y = gain * u
    write(tmp_path / "settled.csv", u, y)
    options = DataOptions(skip_s=EARLY * TS)
    record = load(tmp_path / "settled.csv", options).records[0]
    np.testing.assert_allclose(record.before_V, u[:EARLY], rtol=1e-8)
    assert record.u_V[0] == pytest.approx(u[EARLY])
    stood = y.copy()
    stood[0] = 0.0  # the sensor shows the plant before the step to 20 V
    write(tmp_path / "stood.csv", u, stood)
    record = load(tmp_path / "stood.csv", options).records[0]
    np.testing.assert_allclose(record.before_V, [0.0, *u[:EARLY]], rtol=1e-8)
    assert "it begins with a step from 0 V" in " ".join(record.remarks)


def test_without_a_skip_there_is_no_history(tmp_path):
    write(tmp_path / "whole.csv", moving(), moving())
    assert load(tmp_path / "whole.csv").records[0].before_V.size == 0
