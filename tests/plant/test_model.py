"""Parameters, named plants, the test bench, and plants as JSON."""

import json
import math

import numpy as np
import pytest

from rdpi_gym.plant import (
    P5,
    P10,
    PAPER_III_B,
    PAPER_IV_B,
    PLANTS,
    Converter,
    Plant,
    PlantModel,
    Sensor,
    find_plant,
    named_plant,
    settled_memory,
)
from rdpi_gym.support.errors import InputError
from tests.looping import over

ONE_LINE = r"^[^\n]*$"


@over(
    "model, sum_of_plays, all_sliding, loop_gain, zero",
    [(PAPER_III_B, 0.4880, 1.2170, 0.669, 6629), (PAPER_IV_B, 0.6003, 1.2213, 0.967, 5153)],
)
def test_derived_numbers_of_the_papers_sets(model, sum_of_plays, all_sliding, loop_gain, zero):
    found = [model.S, model.A, model.g]
    np.testing.assert_allclose(found[:2], [sum_of_plays, all_sliding], atol=5e-5)
    assert found[2] == pytest.approx(loop_gain, abs=5e-4)
    assert model.zero_rad_s == pytest.approx(zero, abs=0.5)


@over("name", PLANTS)
def test_every_named_plant_survives_its_file(name, tmp_path):
    plant = named_plant(name)
    assert PlantModel.load(plant.save(tmp_path / "plant.json")) == plant


def test_static_forms_have_no_rate():
    assert named_plant("P5-static").hysteresis.delta2_s == 0
    assert math.isinf(named_plant("P10-static").hysteresis.zero_rad_s)


@over("ts", [0.0, -1e-4, math.nan, math.inf])
def test_sampling_times_that_do_not_exist_are_refused(ts):
    with pytest.raises(InputError, match="ts_s is"):
        Plant(P5, ts)


def test_commands_that_are_not_finite_are_refused_and_move_nothing():
    plant = Plant(P5, 1e-3)
    plant.simulate(np.array([0.0, 8.0]))
    before = plant.memory
    with pytest.raises(InputError, match="sample 1 of lane 0 is nan"):
        plant.simulate(np.array([1.0, np.nan]))
    np.testing.assert_array_equal(plant.memory, before)


def test_a_block_that_does_not_fit_the_lanes_is_refused():
    with pytest.raises(InputError, match="2 lanes"):
        Plant(P5, 1e-3, lanes=2).simulate(np.zeros(5))
    with pytest.raises(InputError, match="all lanes of one plant need the same n"):
        Plant([P5, P10], 1e-3)


def broken_documents() -> list[tuple[object, str]]:
    good = P5.to_dict()
    hysteresis = good["hysteresis"]
    return [
        ({**good, "format": "rdpi-discovery"}, "is not a rdpi-plant file"),
        ({**good, "version": 99}, "version 99"),
        ({**good, "version": True}, "version True"),
        ({**good, "colour": 1}, "'colour' is unknown; known are hysteresis"),
        ({k: v for k, v in good.items() if k != "hysteresis"}, "needs the keys hysteresis"),
        ({**good, "hysteresis": [1]}, "hysteresis"),
        (
            {**good, "hysteresis": {**hysteresis, "weights": ["a"]}},
            "weights[0] is 'a'; expected a number",
        ),
        ({**good, "hysteresis": {**hysteresis, "delta2_s": None}}, "hysteresis"),
        ({**good, "hysteresis": {**hysteresis, "weights": [0.0] * 6}}, "a_0 is 0.0"),
        ({**good, "command_range_V": [3.0]}, "command_range_V"),
        ({**good, "command_range_V": [3.0, 1.0]}, "command_range_V"),
        ({**good, "reference_um": [0.0, 0.0]}, "reference_um"),
        ([1, 2], "is not a rdpi-plant file"),
    ]


@over("document, says", broken_documents())
def test_foreign_plant_files_are_refused_in_one_line(document, says, tmp_path):
    path = tmp_path / "plant.json"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=ONE_LINE) as refusal:
        PlantModel.load(path)
    assert says in str(refusal.value)
    assert "plant.json" in str(refusal.value)


def test_a_plant_file_that_was_cut_off_names_the_place(tmp_path):
    path = tmp_path / "plant.json"
    text = P5.save(path).read_text()
    path.write_text(text[: len(text) // 2])
    with pytest.raises(InputError, match=r"plant\.json, line \d+, column \d+: not whole JSON"):
        PlantModel.load(path)


def test_names_and_paths_that_lead_nowhere():
    with pytest.raises(InputError, match="known are P5"):
        named_plant("P6")
    with pytest.raises(InputError, match="neither a plant file nor one of"):
        find_plant("nowhere.json")


def test_converter_holds_the_command_for_its_period():
    bench = named_plant("P5-bench")
    u = np.linspace(0.0, 9.0, 23)
    plant = Plant(bench, 1e-5)
    shown = np.concatenate([plant.simulate(part) for part in np.split(u, [3, 11])])
    held = np.repeat(u[::5], 5)[:23]
    np.testing.assert_array_equal(shown, Plant(P5, 1e-5).simulate(held))
    with pytest.raises(InputError, match="does not divide"):
        Plant(bench, 3e-5)


def test_sensor_has_the_noise_and_the_resolution_it_states():
    rng = np.random.default_rng(1)
    reading = Sensor(resolution_um=0.01, noise_um=0.05).read(np.full(20_000, 3.0), rng)
    assert np.std(reading) == pytest.approx(np.hypot(0.05, 0.01 / np.sqrt(12)), rel=0.03)
    np.testing.assert_allclose(reading / 0.01, np.round(reading / 0.01), atol=1e-9)
    with pytest.raises(InputError, match="noise_um"):
        Sensor(noise_um=-1.0)
    with pytest.raises(InputError, match="period_s"):
        Converter(period_s=math.inf)


def test_reset_rests_the_plant_and_only_the_lanes_named():
    plant = Plant(P10, 1e-3, lanes=2)
    u = np.random.default_rng(0).normal(0, 20, (30, 2))
    plant.simulate(u)
    kept = plant.memory[:, 1]
    plant.reset(0.0, lanes=[True, False])
    np.testing.assert_array_equal(plant.memory[:, 0], 0.0)
    np.testing.assert_array_equal(plant.memory[:, 1], kept)
    first = plant.step(np.array([[0.0, 0.0]]))
    assert first[0, 0] == 0.0


def test_a_rest_at_a_command_allows_only_its_memory():
    plant = Plant(P5, 1e-3)
    plant.reset(u0_V=10.0, memory=np.zeros(5))
    rest = np.array(P5.hysteresis.thresholds_V)
    np.testing.assert_allclose(plant.memory[:, 0], settled_memory(rest, [10.0]))


@over("key, value", [
        ("name", 3), ("name", "a\nb"), ("note", ["a"]), ("note", "\x1b[2J"), ("weights", 1.0),
        ("thresholds_V", [True, 2.0]), ("offset_um", float("nan")), ("offset_um", 10**400),
        ("offset_um", [1.0]), ("reference_um", [0.0]), ("effects", {}), ("effects", [[]]),
        ("identification", 1), ("sensor", "none"), ("command_range_V", [0.0, 1.0, 2.0]),
        ("effects", [{"effect": "os:system"}]), ("effects", [{"effect": ["creep"]}]),
    ])  # fmt: skip
def test_a_value_of_another_type_is_one_line(key, value) -> None:
    document = P5.to_dict()
    inside = document["hysteresis"] if key in document["hysteresis"] else document
    inside[key] = value
    with pytest.raises(InputError) as caught:
        PlantModel.from_dict(document, "plant.json")
    assert key in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_list_is_no_plant() -> None:
    with pytest.raises(InputError, match="expected a JSON object"):
        PlantModel.from_dict([1.0], "plant.json")
