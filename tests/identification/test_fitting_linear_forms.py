"""Further forms of linear and slow effects are found from what a refit of the simplest left."""

import math

import numpy as np
import pytest

from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE, forms_of, load_effect
from tests.looping import over

NOISE_UM = 2e-3
CORE = P10.hysteresis


def swept(ts_s, samples, start_s):
    """A slow sine and a smaller sweep up to a tenth of the sampling frequency."""
    k = np.arange(samples)
    u = 25 * np.sin(24 * np.pi * k / samples)
    u += 8 * np.sin(2 * np.pi * (20 * k / samples + 0.01 * k**2 / samples))
    return start_s + k * ts_s, u


def slow(start_s, amplitude_V):
    k = np.arange(400)
    return start_s + 0.05 * k, amplitude_V * np.sin(10 * np.pi * k / 400)


FAST = (swept(1e-4, 4000, 0.0), swept(5e-5, 6000, 1.0))
SLOW = tuple(slow(50.0 * i, 16.0 + 12.0 * i) for i in range(3))

CASES = {
    ("sensor_lag", "second order"): (FAST, {"time_constant_s": 4e-4, "second_ratio": 0.5}),
    ("actuator_lag", "second order"): (FAST, {"time_constant_s": 4e-4, "second_ratio": 0.5}),
    ("sensor_lag", "fourth order"): (
        FAST,
        {"time_constant_s": 6e-4, "second_share": 3 / 7, "third_share": 2 / 9, "fourth_share": 0.3},
    ),
    ("delay", "whole samples"): (FAST, {"samples": 1.0}),
    ("resonance", "with a zero"): (
        FAST,
        {"f0_hz": 800.0, "damping": 0.05, "static_share": 0.3},
    ),
    ("resonance", "two modes"): (
        FAST,
        {"f0_hz": 600.0, "damping": 0.04, "second_hz": 1300.0, "second_damping": 0.03,
         "second_share": 0.2},
    ),
    ("gain_drift", "to a limit"): (SLOW, {"rate_per_s": 1e-3, "time_constant_s": 25.0}),
    ("gain_drift", "piecewise linear"): (
        tuple(slow(20.0 * i, 30.0) for i in range(6)),
        {"at_1": 0.03, "at_2": -0.02, "at_3": 0.01, "at_4": 0.05, "at_5": 0.04, "at_6": 0.0},
    ),
    ("gain_drift", "smooth curve"): (
        tuple(slow(20.0 * i, 30.0) for i in range(6)),
        {f"at_{k}": 0.03 * math.sin(0.9 * k) for k in range(1, 15)},
    ),
    ("mains_hum", "with harmonics"): (
        FAST,
        {"amplitude_um": 0.05, "frequency_hz": 49.95, "phase_rad": 0.9, "second_sine_um": 0.02,
         "third_cosine_um": 0.03},
    ),
}  # fmt: skip
# Where the simplest form starts, beside the start of its own that leads to the same.
NEAR = {"resonance": {"f0_hz": 700.0}}


@over("case", CASES)
def test_a_form_is_found_to_the_noise_from_the_simplest_that_left_more(case):
    protocol, values = CASES[case]
    simplest, kind = (
        next(form for form in forms_of(CATALOGUE[case[0]]) if form.form == words)
        for words in ("", case[1])
    )
    if "duration_s" in kind().values:  # as the scale of these records will have it
        values = {"duration_s": protocol[-1][0][-1]} | values
    hidden, rng, records = kind(**values), np.random.default_rng(0), []
    for t, u in protocol:
        ts = (t[-1] - t[0]) / (len(t) - 1)
        y = simulate_effects([Variant(CORE, (hidden,))], Record("made", t, u, u, ts_s=ts))[:, 0]
        y += rng.normal(0.0, NOISE_UM, len(t))
        records.append(Record(f"made-{len(records)}", t, u, y, ts_s=ts))
    scale = data_scale(records)
    start = simplest.starts(scale)[0].with_values(NEAR.get(case[0], {}))
    simpler = fit_joint(records, CORE, (start,))
    assert simpler.train_rmse_um > 3.0 * NOISE_UM
    starts = kind.from_simpler(simpler.variant.effects[0], scale)
    fits = [fit_joint(records, simpler.variant.hysteresis, (start,)) for start in starts]
    best = min(fits, key=lambda fit: fit.train_rmse_um)
    assert best.train_rmse_um < 1.05 * NOISE_UM
    found = best.variant.effects[0].values
    assert {k: found[k] for k in values} == pytest.approx(values, rel=0.02, abs=1e-3)
    assert best.at_bound == ()


@over("name", ["thermal_drift", "gain_drift"])
@over("words", ["piecewise linear", "smooth curve"])
def test_where_no_record_is_a_drift_goes_on_as_it_went(name, words):
    """Two records with a pause between them and as long a time after them tell knots of neither."""
    rng, records = np.random.default_rng(0), []
    pace = 0.02 if name == "thermal_drift" else 1e-3
    for begin in (0.0, 40.0):
        t, u = slow(begin, 30.0)
        y = simulate_effects([Variant(CORE, ())], Record("made", t, u, u, ts_s=0.05))[:, 0]
        y += pace * t * (1.0 if name == "thermal_drift" else y)
        y += rng.normal(0.0, NOISE_UM, len(t))
        records.append(Record(f"made-{begin}", t, u, y, ts_s=0.05))
    kind = load_effect(name, words)
    knots = [p.name for p in kind.parameters if not p.fixed]
    start = kind(duration_s=90.0, **dict.fromkeys(knots, 0.0))
    fit = fit_joint(records, CORE, (start,))
    assert fit.train_rmse_um < 1.02 * NOISE_UM
    found = [fit.variant.effects[0].values[knot] for knot in knots]
    straight = pace * 90.0 * np.arange(1, len(knots) + 1) / len(knots)
    assert found == pytest.approx(straight, abs=0.1 * straight[-1])
