"""The laboratory names a hidden effect, stays silent without one, and says what it cannot know."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.beam.constants import FOUND, LIKELY
from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.diagnosis.search.discover import add_effect, diagnose, discover
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P10, Plant, PlantModel
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.sensor_lag import SensorLag
from rdpi_gym.signals import BandLimitedNoise, DecayingSine, Multisine, Sine
from rdpi_gym.signals.experiments import polyline
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab.independent import simulate_truth
from tests.looping import over

NOISE_UM = 0.012
_WALK = polyline([0.0, 40.0, -40.0, 30.0, -20.0, 12.0, -8.0, 3.0, 0.0], 400.0)
_SMALL = Multisine(amplitude_um=0.7, frequency_hz=20.0, lines=25, odd=True, seed=1)
_RECORDS = {
    "walk": (_WALK, 5e-4, 0.8),
    "sine-50hz": (Sine(amplitude_um=40.0, frequency_hz=50.0), 2.5e-5, 0.1),
    "sine-200hz": (Sine(amplitude_um=10.0, frequency_hz=200.0), 2.5e-5, 0.05),
    "small": (_SMALL, 5e-5, 0.1),
    "validation-noise": (
        BandLimitedNoise(
            amplitude_um=32.0, high_hz=150.0, repeat_s=0.2, seed=3, smooth_start_s=0.02
        ),
        5e-5,
        0.2,
    ),
    "validation-sine": (DecayingSine(amplitude_um=38.0, frequency_hz=30.0, decay_s=0.1), 5e-5, 0.2),
}


def laboratory_data(
    effects: list[dict[str, object]], seed: int = 0, disturbance_um: float = 0.0
) -> Dataset:
    """Records of P10 with effects, 12 nm of noise, and a force that nobody recorded."""
    rng = np.random.default_rng(seed)
    records, clock = [], 0.0
    for name, (signal, ts, duration) in _RECORDS.items():
        t = np.arange(round(duration / ts)) * ts
        u = np.asarray(signal(t))
        y = simulate_truth(asdict(P10.hysteresis), effects, t + clock, u)
        y = y + NOISE_UM * rng.standard_normal(len(t))
        if disturbance_um:
            y += disturbance_um * np.sin(2 * np.pi * rng.uniform(20, 60) * t + rng.uniform(0, 6))
        role = "validation" if name.startswith("validation") else "train"
        records.append(Record(name, t + clock, u, y, ts_s=ts, role=role))
        clock += duration + 1.0
    return Dataset("a small study", tuple(records))


FEW = {name: CATALOGUE[name] for name in ("sensor_lag", "asymmetry", "gain_drift", "backlash")}
LAG = {"effect": "sensor_lag", "time_constant_s": 1.5e-4}
BEND = {"effect": "asymmetry", "coefficient": 0.03, "span_um": 40.0}


@pytest.fixture(scope="module")
def lagging():
    return laboratory_data([LAG])


@pytest.fixture(scope="module")
def found(lagging):
    return discover(lagging, catalogue=FEW)


@pytest.fixture(scope="module")
def made(found):
    """The content of discovery.json."""
    return json.dumps(found.to_dict())


def test_a_hidden_effect_is_named_with_its_parameter(found):
    assert [c.effect for c in found.added] == ["sensor_lag"]
    step = found.added[0]
    assert step.parameters["time_constant_s"] == pytest.approx(1.5e-4, rel=0.02)
    assert step.confidence >= 0.95
    assert found.verdict == "explained"
    assert step.errors.validation_rmse_um < 1.15 * NOISE_UM
    assert found.base.validation_rmse_um > 5 * NOISE_UM
    chances = dict(found.probabilities.effects)
    assert found.probabilities.classes["sensor_lag"] > 0.9
    assert chances.pop("sensor_lag") > FOUND
    assert step.grade == "found"
    assert max(chances.values()) < LIKELY
    assert found.probabilities.probable[0] == "sensor_lag"


def test_two_hidden_effects_are_both_found():
    found = discover(laboratory_data([LAG, BEND]), catalogue=FEW)
    assert {c.effect for c in found.added} == {"sensor_lag", "asymmetry"}
    assert found.verdict == "explained"


def test_nothing_hidden_is_called_nothing():
    found = discover(laboratory_data([]), catalogue=FEW)
    assert found.steps == ()
    assert found.verdict == "no missing effect"
    assert found.noise_floor_um == pytest.approx(NOISE_UM, rel=0.1)


@pytest.mark.slow
def test_a_force_that_nobody_recorded_is_not_renamed():
    found = discover(laboratory_data([], disturbance_um=0.2), catalogue=FEW)
    assert found.verdict == "unexplained"
    assert found.unexplained_rmse_um > 2 * NOISE_UM
    assert "These records cannot tell" in found.remainder
    assert "predicts 0 % of it" in found.remainder


def test_the_sign_of_y_and_the_order_of_records_do_not_matter(lagging):
    turned = tuple(replace(r, y_um=-r.y_um) for r in reversed(lagging.records))
    found = discover(Dataset("turned", turned), catalogue=FEW)
    assert [c.effect for c in found.added] == ["sensor_lag"]
    assert any("sign was turned" in note for note in found.notes)


def test_the_model_found_runs_as_a_plant(found, lagging, tmp_path):
    model = PlantModel.load(found.plant.save(tmp_path / "model.json"))
    record = lagging.records[1]
    left = record.y_um - Plant(model, record.ts_s).simulate(record.u_V)
    assert np.std(left) < 1.5 * NOISE_UM


@pytest.mark.slow
def test_the_number_of_processes_changes_no_number(found, lagging, monkeypatch):
    monkeypatch.setattr("rdpi_gym.support.parallel._WORTH_S", 1e-9)
    apart = discover(lagging, catalogue=FEW, jobs=2)
    assert _to_six_digits(apart) == _to_six_digits(found)


def _to_six_digits(result):
    """Return a document: products of matrices in one thread round otherwise than those in two."""
    text = json.dumps(result.to_dict() | {"seconds": 0.0})
    return json.loads(text, parse_float=lambda digits: f"{round(float(digits), 12):.6g}")


def test_the_files_hold_json_and_the_promised_keys(found):
    document = found.to_dict()
    assert json.loads(json.dumps(document, allow_nan=False))["format"] == "rdpi-discovery"
    promised = {
        "format", "version", "units", "noise_floor", "base", "steps", "verdict",
        "unexplained_rmse", "next_experiment", "seconds",
    }  # fmt: skip
    assert promised <= set(document)
    step = {
        "effect", "train_rmse", "validation_rmse", "validation_nrmse_percent", "parameters",
        "standard_errors", "confidence", "indistinguishable", "evidence",
    }  # fmt: skip
    assert step <= set(document["steps"][0])


def saved_and_loaded(found, path):
    again = SearchResult.load(found.save(path))
    assert again == replace(found, views=())
    return json.loads(path.read_text(encoding="utf-8"))


def test_results_are_saved_and_loaded_back(lagging, tmp_path):
    for search, key in ((diagnose, "candidates"), (discover, "rounds")):
        written = saved_and_loaded(search(lagging, catalogue=FEW), tmp_path / "found.json")
        assert written[key]
    added = saved_and_loaded(add_effect(lagging, SensorLag, P10), tmp_path / "add.json")
    assert added["effect"] == "sensor_lag"


@over(
    "key, value, said",
    [
        ("verdict", "perhaps", "verdict is 'perhaps'; expected one of 'explained', "),
        ("noise_floor", "small", "noise_floor is 'small'; expected a number"),
        ("noise_floor", 10**400, "too large for a whole number"),
        ("base", None, "base is None; expected an object"),
        ("steps", [{"effect": 3}], r"steps\[0\].effect is 3; expected text"),
        ("candidates", [1], r"candidates\[0\] is 1; expected an object"),
        ("rounds", [[1]], r"rounds\[0\]\[0\] is 1; expected an object"),
        ("indistinguishable", ["creep"], r"indistinguishable\[0\] is 'creep'; expected a list"),
        ("model", {}, "needs the keys hysteresis"),
    ],
)
def test_a_damaged_result_is_refused_in_one_line(key, value, said, made, tmp_path):
    document = json.loads(made) | {key: value}
    path = tmp_path / "found.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError, match=said) as refusal:
        SearchResult.load(path)
    assert "\n" not in str(refusal.value)


def test_a_diagnosis_ranks_every_candidate(lagging):
    found = diagnose(lagging, catalogue=FEW)
    assert next(c.effect for c in found.candidates) == "sensor_lag"
    assert {c.effect for c in found.candidates} == set(FEW)
    assert found.to_dict()["format"] == "rdpi-diagnosis"


def test_diagnose_and_add_judge_the_model_that_is_saved(lagging):
    diagnosis = diagnose(lagging, P10, catalogue={"sensor_lag": SensorLag})
    addition = add_effect(lagging, SensorLag, P10)
    assert diagnosis.verdict == addition.verdict == "explained"
    assert diagnosis.final == addition.final == addition.steps[-1].errors
    assert diagnosis.plant == addition.plant
    assert diagnosis.headline == addition.headline.replace("Added", "Missing")


@pytest.mark.slow
def test_an_interrupted_run_goes_on_from_its_candidates(lagging, tmp_path):
    path = tmp_path / "candidates.jsonl"
    first = diagnose(lagging, catalogue=FEW, checkpoint=path)
    lines = path.read_text().splitlines()
    path.write_bytes("\n".join(lines[:3]).encode() + b'\n\xff{"key": "cut o')
    stages: list[tuple[str, int, int]] = []
    again = diagnose(
        lagging, catalogue=FEW, checkpoint=path,
        progress=lambda *stage: stages.append(stage),
    )  # fmt: skip
    assert stages == []
    assert any("1 row was damaged" in note for note in again.notes)
    assert [c.effect for c in again.candidates] == [c.effect for c in first.candidates]


def test_a_checkpoint_that_is_a_folder_is_named(lagging, tmp_path):
    with pytest.raises(InputError, match="is no regular file"):
        diagnose(lagging, catalogue=FEW, checkpoint=tmp_path)


@pytest.mark.slow
def test_adding_an_effect_that_is_not_earned_is_said(lagging):
    bare = laboratory_data([])
    for name in ("gain_drift", "asymmetry"):
        found = add_effect(bare, FEW[name], P10)
        assert [c.effect for c in found.added] == [name]
        assert "do not earn it" in found.notes[0]
    assert "which does not improve held-out error" in found.headline
    with pytest.raises(InputError, match="already"):
        add_effect(lagging, FEW["sensor_lag"], replace(P10, effects=(SensorLag(),)))


def one_sine(bend: float) -> Dataset:
    """Forty periods of 10 Hz in one file, with noise."""
    t = np.arange(8000) * 5e-4
    u = 30.0 * np.sin(2 * np.pi * 10.0 * t)
    y = Plant(P10, 5e-4).simulate(u)
    y = y + bend * y**2 / 40.0 + NOISE_UM * np.random.default_rng(0).standard_normal(8000)
    return Dataset("one sine", (Record("sine", t, u, y, ts_s=5e-4),))


def test_one_sine_shows_its_even_harmonics():
    found = discover(one_sine(0.03), catalogue=FEW)
    assert [c.effect for c in found.added] == ["asymmetry"]
    assert found.final.validation_rmse_um < 1.15 * NOISE_UM
    assert found.candidates


def test_one_sine_of_the_bare_model_misses_nothing():
    found = discover(one_sine(0.0), catalogue=FEW)
    assert found.steps == ()
    assert found.verdict == "no missing effect"
