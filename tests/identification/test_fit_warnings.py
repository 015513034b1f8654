"""What the data cannot determine is said; what they can is not doubted."""

import numpy as np
import pytest

from rdpi_gym.identification import MIN_MOTION, fit
from rdpi_gym.identification.least_squares import gram_matrices
from rdpi_gym.identification.stack import stack_records
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P10, RDPI, Plant, PlantModel
from tests.looping import over

NOISE_UM = 0.02


def record(u, ts_s, model=P10, seed=0, name="run"):
    y = Plant(model, ts_s).simulate(u)
    y += NOISE_UM * np.random.default_rng(seed).standard_normal(y.size)
    return Record(name, np.arange(u.size) * ts_s, u, y, ts_s=ts_s)


def sine(frequency_hz, amplitude_V, **keywords):
    ts_s = 1 / frequency_hz / 800
    u = amplitude_V * np.sin(2 * np.pi * frequency_hz * np.arange(2400) * ts_s)
    return record(u, ts_s, name=f"{frequency_hz:g} Hz, {amplitude_V:g} V", **keywords)


def triangle(frequency_hz, amplitude_V):
    ts_s = 1 / frequency_hz / 800
    phase = 2 * np.pi * frequency_hz * np.arange(2400) * ts_s
    return record(
        amplitude_V * 2 / np.pi * np.arcsin(np.sin(phase)), ts_s, name=f"{frequency_hz:g}"
    )


def warns(records, words, **keywords):
    return any(words in warning for warning in fit(records, **keywords).warnings)


NOT_DETERMINED = "δ2 is not determined by these data"


@over("frequency_hz", [1.0, 10.0, 50.0])
def test_one_rate_does_not_determine_delta2(frequency_hz):
    assert warns([sine(frequency_hz, 40.0)], NOT_DETERMINED)
    assert warns([sine(frequency_hz, 40.0), sine(1.2 * frequency_hz, 40.0)], NOT_DETERMINED)


def test_neither_do_several_amplitudes_at_one_frequency():
    records = [sine(10.0, amplitude_V) for amplitude_V in (40.0, 25.0, 15.0)]
    assert warns(records, NOT_DETERMINED)
    assert warns(records, "every movement takes about the same time")


def test_nor_triangles_of_one_rate():
    assert warns(
        [triangle(10.0, 40.0), triangle(40.0, 10.0)], "all rates are alike, the command keeps one"
    )
    assert not warns([triangle(10.0, 40.0), triangle(40.0, 40.0)], NOT_DETERMINED)


@over(
    "cases",
    [
        [(10.0, 40.0), (100.0, 40.0)],
        [(5.0, 40.0), (20.0, 30.0), (80.0, 35.0)],
    ],
)
def test_several_rates_determine_it(cases):
    assert fit([sine(*case) for case in cases]).warnings == ()


def test_one_record_with_several_rates_is_enough():
    t = np.arange(0.0, 1.0, 1e-4)
    sweep = 40 * np.sin(2 * np.pi * (5 * t + 30 * t**2))
    assert fit([record(sweep, 1e-4)]).warnings == ()


def test_so_are_two_tones_in_one_record():
    t = np.arange(0.0, 0.6, 1e-4)
    tones = 25 * np.sin(2 * np.pi * 5 * t) + 12 * np.sin(2 * np.pi * 60 * t)
    assert fit([record(tones, 1e-4)]).warnings == ()


def test_noise_on_the_measured_command_makes_no_rates():
    slow = sine(1.0, 40.0)
    ripple = 0.05 * np.random.default_rng(2).standard_normal(slow.u_V.size)
    shaken = Record("run", slow.t_s, slow.u_V + ripple, slow.y_um, ts_s=slow.ts_s)
    assert warns([shaken], NOT_DETERMINED)


def test_an_effect_of_delta2_below_the_noise_is_no_finding():
    records = [sine(1e-4, 40.0), sine(5e-4, 40.0, seed=1)]
    assert warns(records, "95 % interval of δ2 reaches 0") or warns(records, "δ2 is at its bound 0")
    assert not warns(records, NOT_DETERMINED)


def test_thresholds_beyond_the_amplitude_are_named_and_held():
    result = fit([sine(0.5, 6.0), sine(5.0, 6.0)], n=30)
    held = [i for i in range(1, 31) if result.parameters["delta1_V"] * i > 6.0]
    assert held
    assert any("held at 0" in warning for warning in result.warnings)
    assert all(result.parameters[f"a_{i}"] == 0.0 for i in held)
    assert all(np.isinf(result.standard_errors[f"a_{i}"]) for i in held)
    assert all(result.plant.identification["standard_errors"][f"a_{i}"] is None for i in held)


def test_a_sliver_of_motion_gets_no_weight():
    """Plays that only move near the extremes would fit whatever else happens there."""
    steep = RDPI.from_law([0.5, 0.2, 0.2, 30.0], 13.2, 1e-4)
    model = PlantModel(steep, "steep", (-50.0, 50.0), (0.0, 40.0))
    records = [sine(10.0, 40.0, model=model), sine(60.0, 40.0, model=model)]
    stack, _ = stack_records(records, None)
    found = fit(records, n=3).plant.hysteresis
    gram, _ = gram_matrices(stack, 3, found.thresholds_V[0], found.delta2_s, np.zeros(2))
    moved = np.sqrt((gram.diagonal(axis1=1, axis2=2) / gram[:, :1, 0]).max(axis=0))[:4]
    assert all(moved[i] >= MIN_MOTION for i in range(4) if found.weights[i] > 0)
    assert fit(records, n=3, min_motion=0.0).parameters["a_3"] == pytest.approx(30.0, rel=0.01)


def test_backlash_shows_as_a0_at_its_bound():
    law = RDPI.from_law([1e-9, 0.8, 0.3], 4.0, 1e-4)
    model = PlantModel(law, "backlash", (-50.0, 50.0), (0.0, 40.0))
    records = [sine(f, 40.0, model=model) for f in (5.0, 50.0)]
    assert warns(records, "a_0 is at its bound", n=2)
    assert fit(records, n=2).plant.hysteresis.a0 > 0


def test_a_missing_effect_is_said_to_be_no_noise():
    records = [sine(5.0, 40.0), sine(50.0, 40.0)]
    for run in records:
        run.y_um[:] += 5e-4 * run.u_V**2
    assert warns(records, "residuals are correlated over about")
