"""Tracking problems side by side: lanes, readings, the reference shown."""

import math

import numpy as np
import pytest

from rdpi_gym.envs import ObservationLayout, TrackingTask
from rdpi_gym.envs.truth import randomise_plant
from rdpi_gym.plant import Plant, named_plant
from rdpi_gym.support.errors import InputError
from tests.looping import over

TS_S = 1e-4


def problems(name, lanes):
    """Return `lanes` different plants, their layout and their references."""
    rng = np.random.default_rng(0)
    base = named_plant(name)
    models = [randomise_plant(base, 0.2, rng) for _ in range(lanes)]
    t = TS_S * np.arange(300)[:, None]
    reference = base.reference_um[1] * np.sin(2 * np.pi * rng.uniform(10, 100, lanes) * t)
    return models, ObservationLayout.for_plant(base, TS_S, preview=3), reference


@over("name", ["P5", "P10-bench"])
@over("lanes", [2, 17])
def test_lanes_equal_single_tasks(name, lanes):
    models, layout, reference = problems(name, lanes)
    together = TrackingTask(models, layout)
    alone = [TrackingTask(model, layout) for model in models]
    shown = together.reset(reference, [np.random.default_rng(b) for b in range(lanes)])
    for b, task in enumerate(alone):
        task.reset(reference[:, b : b + 1], [np.random.default_rng(b)])
    commands = np.random.default_rng(1).uniform(-20, 20, (1100, lanes))
    for command in commands:
        shown = together.step(command)
        observations = [task.step(command[b : b + 1]) for b, task in enumerate(alone)]
        expected = np.concatenate([task.quantities for task in alone], axis=1)
        # 1e-12 of the largest displacement, 24 µm.
        np.testing.assert_allclose(together.quantities, expected, rtol=0, atol=24 * 1e-12)
        np.testing.assert_allclose(shown, np.concatenate(observations), rtol=0, atol=1e-6)


def test_displacement_is_that_of_the_plant_from_rest():
    models, layout, reference = problems("P10", 1)
    task = TrackingTask(models, layout)
    task.reset(reference)
    command = np.random.default_rng(0).uniform(-50, 50, 400)
    found = []
    for u in command:
        task.step(np.array([u]))
        found.append(task.displacement_um[0])
    plant = Plant(models, TS_S)
    plant.reset(u0_V=0.0)
    np.testing.assert_array_equal(found, plant.simulate(np.concatenate([[0.0], command]))[1:])


def test_observation_decodes_to_the_quantities():
    models, layout, reference = problems("P10-bench", 3)
    task = TrackingTask(models, layout)
    shown = task.reset(reference, [np.random.default_rng(b) for b in range(3)])
    padded = np.concatenate([reference, np.repeat(reference[-1:], 50, axis=0)])
    for k in range(320):
        np.testing.assert_allclose(
            layout.reference_um(shown), padded[k : k + layout.preview + 1].T, rtol=0, atol=1e-5
        )
        np.testing.assert_allclose(layout.measured_um(shown), task.measured_um, atol=1e-5)
        np.testing.assert_allclose(layout.command_V(shown), task.command_V, atol=1e-5)
        np.testing.assert_array_equal(task.error_um, task.reference_now_um - task.displacement_um)
        shown = task.step(np.array([1.0, -2.0, 3.0]) * np.sin(0.01 * k))


def test_an_extended_reference_is_the_whole_reference():
    models, layout, reference = problems("P5", 2)
    whole, parts = TrackingTask(models, layout), TrackingTask(models, layout)
    whole.reset(reference)
    parts.reset(reference[:100])
    parts.extend(reference[100:])
    for _ in range(len(reference)):
        np.testing.assert_array_equal(whole.step(np.ones(2)), parts.step(np.ones(2)))


def test_reading_has_the_sensors_noise_and_resolution():
    model = named_plant("P10-bench")
    layout = ObservationLayout.for_plant(model, TS_S)
    task = TrackingTask([model] * 50, layout)
    task.reset(np.zeros((1, 50)), [np.random.default_rng(b) for b in range(50)])
    noise = []
    for _ in range(400):
        task.step(np.zeros(50))
        noise.append(task.measured_um - task.displacement_um)
        steps = task.measured_um / model.sensor.resolution_um
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    # Rounding adds resolution²/12; 20,000 draws put the estimate within 2 % with five sigmas.
    expected = np.hypot(model.sensor.noise_um, model.sensor.resolution_um / np.sqrt(12))
    assert np.std(noise) == pytest.approx(expected, rel=0.025)
    correlation = np.corrcoef(np.array(noise).T)
    assert np.abs(correlation[np.triu_indices(50, 1)]).max() < 0.3


@over("range_um", [math.inf, 100.0])
def test_a_command_that_is_no_number_is_shown_as_none(range_um):
    layout = ObservationLayout.for_plant(named_plant("P5"), TS_S)
    task = TrackingTask(named_plant("P5"), layout, range_um)
    task.reset(np.zeros((5, 1)))
    shown = task.step(np.array([np.nan]))
    assert np.isnan(shown[0, layout.columns["command"].start])


def test_rests_at_the_command_nearest_zero():
    model = named_plant("P5")
    layout = ObservationLayout(1, 0.0, 1.0, (5.0, 15.0), TS_S)
    task = TrackingTask(model, layout)
    task.reset(np.zeros((1, 1)))
    assert task.command_V[0] == 5.0
    resting = task.displacement_um[0]
    task.step(np.array([5.0]))
    assert task.displacement_um[0] == resting


@over(
    "reference, line",
    [
        (np.zeros(5), r"shape \(5,\) for 2 lanes"),
        (np.zeros((5, 3)), r"shape \(5, 3\) for 2 lanes"),
        (np.zeros((0, 2)), r"shape \(0, 2\) for 2 lanes"),
        (np.array([[0.0, 0.0], [0.0, np.nan]]), "sample 1 of the reference of lane 1 is nan"),
    ],
)
def test_refuses_a_reference(reference, line):
    task = TrackingTask(
        [named_plant("P5")] * 2, ObservationLayout.for_plant(named_plant("P5"), TS_S)
    )
    with pytest.raises(InputError, match=line):
        task.reset(reference)


def test_refuses_noise_without_generators():
    model = named_plant("P5-bench")
    task = TrackingTask([model] * 2, ObservationLayout.for_plant(model, TS_S))
    with pytest.raises(InputError, match="need 2 random generators"):
        task.reset(np.zeros((5, 2)))
    with pytest.raises(InputError, match="need 2 random generators"):
        task.reset(np.zeros((5, 2)), [np.random.default_rng(0)])
