"""The independent formulation and the fitted stages agree to within the sampling error."""

import ast
import dataclasses
from pathlib import Path

import numpy as np
import pytest

from rdpi_gym.plant import P10, Plant
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab import independent
from rdpi_gym.virtual_lab.independent import simulate_truth, simulation, twins
from tests.looping import over

H = P10.hysteresis

# RMS disagreement (nm) on 43 µm peak to peak at Ts = 50 µs, literal and band-limited rate. Most
# effects are exact for a command linear between samples; the others see the corners that plays
# (or an amplifier) put between two samples. Creep is a ladder against a continuous spectrum, and
# does not depend on Ts.
EXACT, USUAL = 0.01, 3.0
EXACT_ONES = (
    *("rate_law", "initial_memory", "congruency", "asymmetry", "backlash", "gain_drift"),
    *("thermal_drift", "mains_hum"),
)
BOUND_NM = {
    **dict.fromkeys(EXACT_ONES, EXACT),
    "saturation": 0.1,
    "slew_limit": 1.5,
    "actuator_lag": 2.5,
    "creep": 3.0,
    "resonance": 3.0,
    "delay": 2.0,
    "sensor_lag": 1.0,
}
VALUES = {"delay": {"delay_s": 1.37e-4}}


def record(ts: float) -> tuple[np.ndarray, np.ndarray]:
    """Two sines of 50 and 170 Hz that begin smoothly."""
    t = np.arange(round(0.1 / ts) + 1) * ts
    tones = 22 * np.sin(2 * np.pi * 50 * t) + 6 * np.sin(2 * np.pi * 170 * t + 1)
    return t, (1 - np.exp(-t / 0.005)) * tones


def numbers(hz: float | None = None) -> dict:
    fields = ("weights", "thresholds_V", "delta2_s", "rate_bandwidth_hz")
    return {name: getattr(H.band_limited(hz), name) for name in fields}


def disagreement_nm(effects: tuple[Effect, ...], ts: float, hz: float | None) -> float:
    t, u = record(ts)
    model = dataclasses.replace(P10.with_hysteresis(H.band_limited(hz)), effects=effects)
    y = Plant(model, ts).simulate(u)
    truth = simulate_truth(numbers(hz), [e.to_dict() for e in effects], t, u, 2e-6)
    return float(1e3 * np.sqrt(np.mean((y - truth) ** 2)))


@over("hz", [None, 800.0])
@over("name", twins())
def test_stage_and_truth_agree_and_the_difference_falls_with_ts(name, hz):
    effects = (CATALOGUE[name](**VALUES.get(name, {})),)
    coarse, fine = (disagreement_nm(effects, ts, hz) for ts in (2e-4, 5e-5))
    assert fine < BOUND_NM.get(name, USUAL)
    if name != "creep":
        assert fine < max(coarse / 6, EXACT)  # of second order: a sixteenth


def test_without_effects_the_sampled_model_is_exact():
    for ts in (1e-3, 1e-4):
        assert disagreement_nm((), ts, None) < 1e-9
        assert disagreement_nm((), ts, 800.0) < 0.02


def test_all_effects_together_agree():
    everything = tuple(CATALOGUE[name](**VALUES.get(name, {})) for name in twins())
    coarse, fine = (disagreement_nm(everything, ts, None) for ts in (1e-4, 2.5e-5))
    assert fine < coarse / 6
    assert fine < 5.0


def test_stairs_with_slow_effects_agree():
    ts = 5e-3
    t = np.arange(6000) * ts
    u = np.repeat([0.0, 25.0, -25.0, 10.0, 40.0, 0.0], 1000)
    names = ("creep", "gain_drift", "thermal_drift", "asymmetry", "initial_memory")
    effects = tuple(CATALOGUE[name]() for name in names)
    y = Plant(dataclasses.replace(P10, effects=effects), ts).simulate(u)
    truth = simulate_truth(
        numbers(P10.hysteresis.rate_bandwidth_hz), [e.to_dict() for e in effects], t, u
    )
    assert 1e3 * np.sqrt(np.mean((y - truth) ** 2)) < 2.0


def test_a_delay_between_grid_points_is_kept():
    t, u = record(1e-4)
    late = simulate_truth(numbers(), [{"effect": "delay", "delay_s": 1.234e-4}], t, u)
    now = simulate_truth(numbers(), [], t, u)
    np.testing.assert_allclose(late[5:], np.interp(t - 1.234e-4, t, now)[5:], atol=0.02)


def test_slow_changes_follow_the_clock_of_the_experiment():
    hysteresis = {"weights": [1.0], "thresholds_V": [], "delta2_s": 0.0}
    drift = {"effect": "thermal_drift", "rate_um_s": 0.01, "time_constant_s": 50.0}
    ageing = {"effect": "gain_drift", "rate_per_s": 1e-3}
    t = 120.0 + np.arange(20) * 0.1
    y = simulate_truth(hysteresis, [drift, ageing], t, np.full(20, 7.0))
    np.testing.assert_allclose(y, 7 * (1 + 1e-3 * t) + 0.5 * (1 - np.exp(-t / 50)), rtol=1e-12)


def test_working_in_blocks_changes_nothing(monkeypatch):
    t, u = record(2e-4)
    effects = [CATALOGUE[name]().to_dict() for name in twins()]
    whole = simulate_truth(numbers(800.0), effects, t, u)
    monkeypatch.setattr(simulation, "_BLOCK", 97)
    np.testing.assert_allclose(simulate_truth(numbers(800.0), effects, t, u), whole, atol=1e-10)


def test_a_finer_grid_changes_little():
    t, u = record(2e-4)
    effects = [CATALOGUE[name]().to_dict() for name in twins()]
    used, finer = (simulate_truth(numbers(), effects, t, u, step) for step in (1e-5, 1e-6))
    assert 1e3 * np.abs(used - finer).max() < 3.0


def test_every_twin_is_of_an_effect_and_has_a_number_of_its_own():
    assert set(twins()) <= set(CATALOGUE)
    numbers = [twin.number for twin in twins().values()]
    assert numbers == sorted(set(numbers))


def test_nothing_is_shared_with_what_is_fitted():
    allowed = {f"rdpi_gym.support.{name}" for name in ("arrays", "errors", "plugins")}
    for path in Path(independent.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                if name.startswith(("rdpi_gym", "benchmarks", "baselines", "scipy")):
                    assert name in allowed or name.startswith("rdpi_gym.virtual_lab.independent")


@over(
    "effects, u, words",
    [
        ([{"effect": "crep"}], [0.0, 1.0], "no effect is named 'crep'"),
        ([{"effect": "creep"}], [0.0, 1.0], "gain_per_decade"),
        ([{"effect": "delay", "delay": 1.0}], [0.0, 1.0], "delay"),
        ([], [0.0], "give two samples or more"),
    ],
)
def test_bad_input_is_refused_in_one_line(effects, u, words):
    with pytest.raises(InputError, match=words) as refusal:
        simulate_truth(numbers(), effects, np.arange(len(u)) * 1e-3, u)
    assert "\n" not in str(refusal.value)


@over("name", ["sensor_lag", "gain_drift", "mains_hum"])
def test_a_further_form_is_refused_and_never_taken_for_the_simplest(name):
    form = CATALOGUE[name].forms[0]
    with pytest.raises(InputError, match=f"{name} in the form '{form.form}' is not in the indep"):
        simulate_truth(
            {"weights": [1.0], "thresholds_V": [], "delta2_s": 0.0},
            [form().to_dict()],
            np.arange(3) * 1e-3,
            np.zeros(3),
        )
