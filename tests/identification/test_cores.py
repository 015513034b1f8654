"""Every core is found again on records of its own plant, and named plainly where it cannot be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.identification.cores import CoreFit, fit_core
from rdpi_gym.identification.fitting import fit
from rdpi_gym.identification.kinds import choose_kind, same_models
from rdpi_gym.identification.plausibility import orientation
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import CORES, P10, RDPI, Plant, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.bouc_wen import AsymmetricBoucWen, BoucWen
from rdpi_gym.plant.cores.dahl import Dahl
from rdpi_gym.plant.cores.duhem import Duhem
from rdpi_gym.plant.cores.generalised import GeneralisedPI
from rdpi_gym.plant.cores.lugre import LuGre
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from tests.looping import over

TS_S = 1e-3
SCALE = DataScale(
    centre_V=0.0, span_V=30.0, stroke_um=20.0, fastest_V_s=600.0, shortest_s=TS_S, longest_s=4.0
)


def drive(seconds: float, slow_hz: float, fast_hz: float) -> Array:
    t = TS_S * np.arange(round(seconds / TS_S))
    growing = np.minimum(t / (0.7 * seconds), 1.0)
    return np.asarray(
        growing * (21.0 * np.sin(2 * np.pi * slow_hz * t) + 9.0 * np.sin(2 * np.pi * fast_hz * t))
    )


def records(core: Core, noise_um: float = 0.0, effects: tuple[Effect, ...] = ()) -> list[Record]:
    found = []
    for number, u in enumerate((drive(4.0, 0.8, 3.1), drive(3.0, 2.3, 0.31))):
        model = PlantModel(core, "own", (-30.0, 30.0), (0.0, 5.0), 3.0, effects)  # type: ignore[arg-type]
        y = Plant(model, TS_S).simulate(u)
        noise = noise_um * np.random.default_rng(number).standard_normal(len(u))
        t = TS_S * np.arange(len(u))
        found.append(Record(f"run {number}", t, u, y + noise, ts_s=TS_S))
    return found


@over("name", CORES)
def test_the_shape_of_its_own_plant_is_found_within_a_per_cent(name: str) -> None:
    kind = CORES[name]
    # a comb lies over the data: a plant on the comb that the fit will use
    (first,) = {data_scale(records(start)) for start in kind.starts(SCALE)[:1]}
    start = kind.starts(first)[0]
    away = {
        p.name: 1.3 * float(getattr(start, p.name)) or 0.5 * max(p.typical)
        for p in kind.shape
        if not p.fixed
    }
    truth = start.with_shape(away)
    data = records(truth)
    found = fit_core(data, kind)
    stroke = float(np.ptp(data[0].y_um))
    assert found.train_rmse_um < 2e-4 * stroke
    for p in kind.shape:
        if not p.fixed:
            assert found.shape[p.name] == pytest.approx(getattr(truth, p.name), rel=0.01)
    assert found.offsets_um["run 0"] == pytest.approx(3.0, abs=2e-3 * stroke)
    again = PlantModel.from_dict(found.plant.to_dict())
    assert again == found.plant


def test_records_to_validate_on_are_judged_and_not_fitted() -> None:
    first, second = records(CORES["rdpi"].starts(SCALE)[0], noise_um=0.01)
    found = fit_core(Dataset("own", (first, replace(second, role="validation"))), CORES["rdpi"])
    assert found.train_rmse_um == pytest.approx(0.01, rel=0.05)
    assert found.validation_rmse_um == pytest.approx(0.01, rel=0.1)
    assert list(found.offsets_um) == ["run 0"]


def test_what_one_loop_does_not_tell_of_a_grid_is_smooth() -> None:
    t = TS_S * np.arange(3000)
    loop, nested = 30.0 * np.sin(2 * np.pi * t), drive(3.0, 0.8, 3.1)
    core = RDPI.from_law([1.0, *(0.2 * np.exp(-0.2 * np.arange(12)))], 2.0, 0.0)
    plant = PlantModel(core, "own", (-30.0, 30.0), (0.0, 5.0))
    rng = np.random.default_rng(3)
    found = []
    for name, u in (("loop", loop), ("nested", nested)):
        y = Plant(plant, TS_S).simulate(u) + 0.05 * rng.standard_normal(len(t))
        found.append(Record(name, t, u, y, ts_s=TS_S))
    data = Dataset("own", (found[0], replace(found[1], role="validation")))
    priced = fit_core(data, CORES["preisach"])
    free = fit_core(data, type("Free", (CORES["preisach"],), {"loose": False}))
    assert priced.smoothness > 0.0 == free.smoothness
    assert priced.validation_rmse_um is not None
    assert free.validation_rmse_um is not None
    assert priced.validation_rmse_um < 0.6 * free.validation_rmse_um
    # gains that records tell are taken as they are, however uneven
    (clean, _) = records(replace(free.plant.hysteresis, reversible_um_V=0.5))
    assert fit_core([clean], CORES["preisach"]).smoothness == 0.0


@over(
    "case, models",
    [
        (
            "one length, no line",
            [
                Dahl(2.0, 5.0, 1.0),
                Duhem(0.0, 2.0, 5.0),
                BoucWen(0.0, 2.0, 5.0, 1.0, 1.0),
                AsymmetricBoucWen(0.0, 2.0, 5.0, 1.0, 1.0),
                LuGre(2.0, 0.0, 0.0, 5.0, 1.0, 10.0),
            ],
        ),
        (
            "one length",
            [
                Duhem(1.0, 0.7, 5.0),
                BoucWen(1.0, -0.3, 5.0, 1.0, 1.0),
                AsymmetricBoucWen(1.0, -0.3, 5.0, 1.0, 1.0),
            ],
        ),
        ("symmetric", [f(1.0, -0.3, 5.0, 0.7, 1.5) for f in (BoucWen, AsymmetricBoucWen)]),
        ("plays", [f((1.0, 0.5), (4.0,), 0.0) for f in (RDPI, GeneralisedPI)]),
    ],
)
def test_kinds_of_one_case_are_one_model_there(case: str, models: list[Core]) -> None:
    assert {type(core).name for core in models} == {k.name for k in CORES.values() if case in k.cases}  # fmt: skip
    u = drive(0.5, 4.0, 11.0)
    made = []
    for core in models:
        for name, value in core.cases[case].items():
            assert getattr(core, name) == value
        made.append(Plant(PlantModel(core, "m", (-30.0, 30.0), (0.0, 5.0)), TS_S).simulate(u))  # type: ignore[arg-type]
    for y in made[1:]:
        np.testing.assert_allclose(y, made[0], atol=1e-9)


def test_kinds_that_are_one_model_at_the_numbers_found_are_alike() -> None:
    for noise_um in (0.0, 0.01):
        data = records(Dahl(2.0, 5.0, 1.0), noise_um)
        others = {"asymmetric_bouc_wen", "bouc_wen", "duhem", "lugre"}
        assert set(one_model_with(fit_core(data, CORES["dahl"]), data)) == others
    data = records(Dahl(2.0, 5.0, 1.5), noise_um)
    assert one_model_with(fit_core(data, CORES["dahl"]), data) == ()


def one_model_with(fit: CoreFit, data: list[Record]) -> tuple[str, ...]:
    return same_models(fit.plant.hysteresis, data, fit.standard_errors)


def test_standard_errors_are_those_of_repeated_noise() -> None:
    kind = CORES["rdpi"]
    truth = kind.starts(SCALE)[0].with_shape({"delta2_s": 2e-3})
    found = []
    for seed in range(12):
        clean = records(truth)
        rng = np.random.default_rng(seed)
        noisy = [replace(r, y_um=r.y_um + 0.05 * rng.standard_normal(len(r.y_um))) for r in clean]
        found.append(fit_core(noisy, kind))
    scatter = float(np.std([fit.shape["delta2_s"] for fit in found], ddof=1))
    told = float(np.mean([fit.standard_errors["delta2_s"] for fit in found]))
    assert told == pytest.approx(scatter, rel=0.6)


def test_more_gains_than_samples_are_refused_in_a_line() -> None:
    (first, _) = records(CORES["rdpi"].starts(SCALE)[0])
    short = replace(first, error_mask=np.arange(len(first.u_V)) < 60)
    with pytest.raises(InputError, match=r"60 samples count for 41 gains of the core rdpi; give"):
        fit_core([short], CORES["rdpi"])


@pytest.mark.slow
@over("name", ["bouc_wen", "preisach", "rdpi", "stop"])
def test_the_kind_of_a_plant_is_chosen_or_stands_among_those_that_are_alike(name: str) -> None:
    kind = CORES[name]
    start = kind.starts(SCALE)[0]
    sizes = np.random.default_rng(1).uniform(0.5, 1.5, len(start.gains))
    truth = start.with_gains((np.array(start.gains) * sizes).tolist())
    stroke = float(np.ptp(records(truth)[0].y_um))
    noise_um = 5e-4 * stroke
    found = choose_kind(records(truth, noise_um))
    chosen = found.chosen.plant.hysteresis
    assert name in (chosen.name, *found.alike)
    assert found.clockwise in (None, kind.clockwise) or kind.clockwise is None
    # a comb or a grid of the data's own lies beside that of the plant
    assert found.chosen.validation_rmse_um is not None
    assert found.chosen.validation_rmse_um < 2e-3 * stroke


def test_a_lag_and_a_creep_are_not_taken_for_another_kind() -> None:
    kind = CORES["bouc_wen"]
    effects = (CATALOGUE["creep"](), CATALOGUE["sensor_lag"]())
    found = choose_kind(records(kind.starts(SCALE)[0], 0.01, effects))
    assert "bouc_wen" in (found.chosen.plant.hysteresis.name, *found.alike)
    for beside, hidden in zip(found.chosen.plant.effects, effects, strict=True):
        for name, value in hidden.values.items():
            assert beside.values[name] == pytest.approx(value, rel=0.2)


def test_a_fit_without_plays_offers_a_kind_that_turns_as_the_loops_do() -> None:
    t = TS_S * np.arange(5000)
    u = 10.0 * np.sin(2 * np.pi * t) * (0.3 + 0.1 * t)
    for clockwise, width_um in ((True, 1.0), (False, 0.01)):
        y = 2.0 * u + width_um * np.cos(2 * np.pi * t)
        found = fit([Record("run", t, u, y, ts_s=TS_S)], 4)
        assert [found.parameters[f"a_{k}"] for k in range(1, 5)] == [0.0] * 4
        (warning,) = (w for w in found.warnings if "no play operator" in w)
        assert ("the loops turn clockwise" in warning) == ("--core stop" in warning) == clockwise
        assert warning.endswith("--core auto compares all kinds")
        assert not any("δ2" in w or "at the bound" in w for w in found.warnings)


def test_loops_that_enclose_no_area_turn_neither_way() -> None:
    t = TS_S * np.arange(5000)
    u = 10.0 * np.sin(2 * np.pi * t)
    rng = np.random.default_rng(0)
    still = Record("line", t, u, 2.0 * u + 0.1 * rng.standard_normal(5000), ts_s=TS_S)
    assert orientation([still]) is None
    assert orientation([replace(still, u_V=t)]) is None


def test_what_is_proportional_to_random_steps_encloses_nothing() -> None:
    levels = np.repeat(np.random.default_rng(3).uniform(-40.0, 40.0, 60), 20)
    t = np.arange(levels.size) * 1e-3
    steps = Record("steps", t, levels, 0.2 * levels, ts_s=1e-3)
    assert orientation([steps]) is None
    lagging = replace(steps, y_um=Plant(P10, 1e-3).simulate(levels))
    assert orientation([lagging]) is False


@over("hidden, clockwise", [("rdpi", False), ("stop", True)])
def test_loops_that_a_lag_turns_round_at_a_fast_rate_turn_as_the_slow_ones_do(
    hidden: str, clockwise: bool
) -> None:
    core = P10.hysteresis if hidden == "rdpi" else CORES["stop"].starts(SCALE)[0]
    plant = replace(P10, hysteresis=core, effects=(CATALOGUE["delay"](0.015),))
    records = []
    for name, ts_s in (("slow", 1e-2), ("fast", 1e-4)):
        t = ts_s * np.arange(2000)
        u = 40.0 * np.sin(2 * np.pi * t / (200 * ts_s))
        records.append(Record(name, t, u, Plant(plant, ts_s).simulate(u), ts_s=ts_s))
    slow, fast = records
    assert orientation([fast]) is True
    assert orientation([slow]) is clockwise
    assert orientation(records) is clockwise
