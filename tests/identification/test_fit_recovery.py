"""What Eq. 10 promises: from data of the model, the model comes back."""

import numpy as np
import pytest

from rdpi_gym.identification import fit
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P10, RDPI, Plant, PlantModel, settled_memory
from tests.looping import over

# frequency (Hz), amplitude (V), sampling time (s)
SINES = ((1.0, 40.0, 1e-3), (10.0, 30.0, 2e-4), (50.0, 40.0, 5e-5), (100.0, 20.0, 2e-5))


def sine(model, frequency_hz, amplitude_V, ts_s, *, periods=2.0, offset_um=0.0, extremum_V=0.0):
    t = np.arange(0.0, periods / frequency_hz, ts_s)
    u = amplitude_V * np.sin(2 * np.pi * frequency_hz * t)
    plant = Plant(model, ts_s)
    plant.reset(memory=settled_memory(model.hysteresis.thresholds_V, [extremum_V]))
    name = f"{frequency_hz:g} Hz, {amplitude_V:g} V"
    return Record(name, t, u, plant.simulate(u) + offset_um, ts_s=ts_s)


def sines(model=P10, noise_um=0.0, seed=0, **keywords):
    rng = np.random.default_rng(seed)
    records = [sine(model, *case, **keywords) for case in SINES]
    for record in records:
        record.y_um[:] += noise_um * rng.standard_normal(record.y_um.size)
    return records


def truth(law):
    weights = {f"a_{i}": a for i, a in enumerate(law.weights)}
    return {"delta1_V": law.thresholds_V[0], "delta2_s": law.delta2_s, **weights}


def worst_error(result, law):
    return max(abs(result.parameters[k] / v - 1) for k, v in truth(law).items() if v)


def test_noise_free_data_give_all_13_parameters_back():
    result = fit(sines())
    assert len(result.parameters) == 13
    assert worst_error(result, P10.hysteresis) < 1e-3 / 100
    assert result.train_rmse_um < 1e-6
    assert result.warnings == ()


@over("ts_s", [1e-4, 4e-4])
def test_rates_are_per_second_so_the_sampling_time_does_not_matter(ts_s):
    records = [sine(P10, 5.0, 40.0, ts_s), sine(P10, 40.0, 25.0, 1e-4)]
    assert worst_error(fit(records), P10.hysteresis) < 1e-8


def test_each_record_has_its_own_offset():
    offsets = [3.0, -120.0, 0.0, 55.5]
    records = [sine(P10, *case, offset_um=o) for case, o in zip(SINES, offsets, strict=True)]
    result = fit(records)
    assert list(result.offsets_um.values()) == pytest.approx(offsets, abs=1e-6)
    assert list(result.offsets_um) == [record.name for record in records]


def test_masked_samples_do_not_count_but_are_simulated():
    records = sines()
    for record in records:
        spoiled = np.zeros(record.t_s.size, dtype=bool)
        spoiled[: record.t_s.size // 3] = True
        record.y_um[spoiled] += 50.0
        record.error_mask[spoiled] = False
    assert worst_error(fit(records), P10.hysteresis) < 1e-5


@over("n", [1, 3, 30])
def test_any_number_of_plays(n):
    rng = np.random.default_rng(n)
    weights = [0.6, *(rng.uniform(0.2, 1.0, n) / n)]
    law = RDPI.from_law(weights, 30.0 / n, 3e-4)
    model = PlantModel(law, "any", (-60.0, 60.0), (0.0, 30.0))
    result = fit(sines(model), n=n)
    assert worst_error(result, law) < 1e-3


def test_more_plays_than_the_plant_has_stay_at_zero():
    result = fit(sines(), n=14)
    assert result.parameters["delta1_V"] == pytest.approx(1.0136, rel=1e-4)
    assert max(result.parameters[f"a_{i}"] for i in range(11, 15)) < 1e-4


def test_a_band_limited_rate_is_fitted_as_such():
    model = P10.with_hysteresis(P10.hysteresis.band_limited(200.0))
    result = fit(sines(model), rate_bandwidth_hz=200.0)
    assert worst_error(result, P10.hysteresis) < 1e-5
    assert result.plant.hysteresis.rate_bandwidth_hz == 200.0
    assert fit(sines(model)).train_rmse_um > 1e-3


def test_intervals_hold_the_truth_and_standard_errors_the_spread():
    results = [fit(sines(noise_um=0.02, seed=seed)) for seed in range(20)]
    for name, value in truth(P10.hysteresis).items():
        inside = [
            low <= value <= high for low, high in (result.intervals_95[name] for result in results)
        ]
        assert np.mean(inside) >= 0.8  # 20 draws: below it in 1 of 400 at the stated 95 %
        spread = np.std([result.parameters[name] for result in results], ddof=1)
        stated = np.mean([result.standard_errors[name] for result in results])
        assert 0.5 < stated / spread < 2.0
    overall = [
        low <= truth(P10.hysteresis)[name] <= high
        for result in results
        for name, (low, high) in result.intervals_95.items()
    ]
    assert np.mean(overall) >= 0.9
    assert results[0].train_rmse_um == pytest.approx(0.02, rel=0.05)


def test_the_initial_memory_is_found_on_request():
    came_from = [12.0, -9.0, 15.0, 0.0]
    records = [
        sine(P10, f, a, ts, extremum_V=e) for (f, a, ts), e in zip(SINES, came_from, strict=True)
    ]
    free = fit(records, free_memory=True)
    assert list(free.extrema_V.values())[:3] == pytest.approx(came_from[:3], abs=1e-3)
    assert worst_error(free, P10.hysteresis) < 1e-4
    # 0 V and every extremum below the first threshold leave the same memory
    assert abs(free.extrema_V["100 Hz, 20 V"]) <= 1.0137
    assert np.isinf(free.extremum_errors_V["100 Hz, 20 V"])
    held = fit(records)
    assert held.train_rmse_um > 0.02
    assert set(held.extrema_V.values()) == {0.0}
    assert held.extremum_errors_V == {}


def test_correlated_errors_widen_the_standard_errors():
    rng = np.random.default_rng(1)
    white, slow = sines(noise_um=0.02), sines()
    for record in slow:
        smooth = np.convolve(rng.standard_normal(record.y_um.size + 49), np.ones(50), "valid")
        record.y_um[:] += 0.02 * smooth / np.sqrt(50)
    ratio = fit(slow).standard_errors["a_0"] / fit(white).standard_errors["a_0"]
    assert 4 < ratio < 10  # sqrt(50) = 7


def test_a_data_set_is_fitted_on_train_and_judged_on_validation():
    train, held = sines(noise_um=0.02)[:3], sine(P10, 30.0, 35.0, 1e-4, offset_um=4.0)
    held = Record("validation", held.t_s, held.u_V, held.y_um, ts_s=held.ts_s, role="validation")
    result = fit(Dataset("sines", (*train, held)))
    assert set(result.offsets_um) == {record.name for record in train}
    assert result.validation_rmse_um == pytest.approx(result.rmse_um["validation"])
    assert result.validation_rmse_um < 0.01


def test_without_validation_records_the_last_quarters_are_held_out():
    result = fit(Dataset("sines", tuple(sines(noise_um=0.02))))
    assert result.validation_rmse_um == pytest.approx(0.02, rel=0.1)
    assert len(result.rmse_um) == 8


def test_the_plant_that_comes_out_simulates_saves_and_loads(tmp_path):
    result = fit(sines(noise_um=0.02), name="mine")
    model = PlantModel.load(result.plant.save(tmp_path / "model.json"))
    assert model == result.plant
    assert model.name == "mine"
    assert model.command_range_V == pytest.approx((-44.0, 44.0), rel=1e-3)
    assert model.reference_um[1] == pytest.approx(0.9 * 46.6, rel=0.01)
    stated = model.identification
    assert stated["records"] == list(result.offsets_um)
    assert stated["train_rmse_um"] == result.train_rmse_um
    assert stated["standard_errors"].keys() == result.parameters.keys()
    assert stated["slowest_peak_rate_V_s"] < 260 < 12000 < stated["fastest_peak_rate_V_s"]


def test_the_progress_ends_at_one():
    seen = []
    fit(sines()[:1], progress=lambda *step: seen.append(step))
    assert seen[-1] == ("fitting", 100, 100)
    assert all(0 < done <= total for _, done, total in seen)
