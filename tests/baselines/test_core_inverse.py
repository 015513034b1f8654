"""The inverse by search gives back the reference for any core, within the command's limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines import make_controller
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import CORES, P5, Plant, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.errors import InputError

TS_S = 1e-3
SCALE = DataScale(
    centre_V=0.0, span_V=30.0, stroke_um=20.0, fastest_V_s=400.0, shortest_s=TS_S, longest_s=4.0
)


def bench(core: Core, reach_um: float) -> PlantModel:
    return PlantModel(core, "own", (-30.0, 30.0), (0.0, reach_um), offset_um=2.0)  # type: ignore[arg-type]


@pytest.mark.slow
def test_on_its_own_plant_a_reference_is_followed_to_a_ten_thousandth_of_the_stroke() -> None:
    t = TS_S * np.arange(900)
    path = 18.0 * np.sin(2 * np.pi * 1.7 * t) + 7.0 * np.sin(2 * np.pi * 5.1 * t)
    for core in (start for kind in CORES.values() for start in kind.starts(SCALE)):
        slow = core if core.rises_at(TS_S) else core.with_shape({"delta2_s": 0.0})
        plant = bench(slow, 5.0)
        # what the plant itself has done can be done again
        reference = Plant(plant, TS_S).simulate(path)[:, None]
        layout = ObservationLayout.for_plant(plant, ts_s=TS_S)
        command = make_controller("core-inverse", plant, layout).command_block(reference)  # type: ignore[attr-defined]
        assert np.all(np.abs(command) <= 30.0), core
        error = Plant(plant, TS_S).simulate(command) - reference
        assert float(np.max(np.abs(error))) < 1e-4 * float(np.ptp(reference)), core


def test_beyond_the_reach_it_stays_at_the_limit_and_comes_back_from_there() -> None:
    plant = replace(P5, hysteresis=P5.hysteresis.static())
    layout = ObservationLayout.for_plant(plant, ts_s=TS_S)
    far = 60.0 * np.sin(np.linspace(0.0, 2 * np.pi, 400))[:, None]
    command = make_controller("core-inverse", plant, layout).command_block(far)  # type: ignore[attr-defined]
    assert command.max() == 25.0
    assert command.min() == -25.0
    y = Plant(plant, TS_S).simulate(command)
    within = np.abs(command) < 25.0
    np.testing.assert_allclose(y[within], far[within], atol=1e-7)


def test_of_a_rate_dependent_plant_it_takes_the_rate_of_the_reference() -> None:
    layout = ObservationLayout.for_plant(P5, ts_s=1e-4)
    reference = 12.0 * np.sin(2 * np.pi * 20.0 * 1e-4 * np.arange(2000))[:, None]
    ours, theirs = (
        make_controller(name, P5, layout).command_block(reference)  # type: ignore[attr-defined]
        for name in ("core-inverse", "classical-reference-rate")
    )
    assert not P5.hysteresis.rises_at(1e-4)
    assert float(np.max(np.abs(ours - theirs))) < 0.02 * float(np.ptp(theirs))


def test_a_compensator_of_the_rdpi_model_refuses_another_core() -> None:
    plant = bench(CORES["stop"].starts(SCALE)[0], 5.0)
    layout = ObservationLayout.for_plant(plant, ts_s=TS_S)
    with pytest.raises(
        InputError, match=r"classical-static inverts the core rdpi, .* core-inverse"
    ):
        make_controller("classical-static", plant, layout)
