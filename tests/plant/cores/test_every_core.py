"""What every file of `rdpi_gym.plant.cores` keeps: laws that hold for any kind of hysteresis."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rdpi_gym.plant import CORES, P5, Plant, PlantModel
from rdpi_gym.plant.cores.base import Core, empty_state, pack
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import forms_of
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from tests.looping import over

TS_S = 1e-3
SCALE = DataScale(
    centre_V=0.0, span_V=30.0, stroke_um=20.0, fastest_V_s=400.0, shortest_s=TS_S, longest_s=4.0
)
STARTS = [start for kind in CORES.values() for start in kind.starts(SCALE)]
every_core = over("core", STARTS)


def walk(samples: int = 3000) -> Array:
    """A command with loops within loops, of both signs."""
    t = TS_S * np.arange(samples)
    return np.asarray(
        18.0 * np.sin(2 * np.pi * 1.1 * t) + 9.0 * np.sin(2 * np.pi * 4.3 * t) + 3.0 * t / t[-1]
    )


def model_of(core: Core) -> PlantModel:
    return PlantModel(core, "demo", (-30.0, 30.0), (0.0, 8.0))  # type: ignore[arg-type]


def run(core: Core, u: Array, ts_s: float = TS_S) -> Array:
    return Plant(model_of(core), ts_s).simulate(u)


@every_core
def test_gains_and_responses_make_the_displacement(core: Core) -> None:
    u = walk()
    v = np.concatenate([[0.0], np.diff(u)]) / TS_S
    memory = core.settled(())
    p, state = pack([core], TS_S, [0.0]), empty_state(core.n, 1)
    state[2:, 0] = memory
    y = np.empty((len(u), 1))
    core.block(u[:, None], v[:, None], p, state, y)
    columns = core.responses(u, v, memory)
    assert columns.shape == (len(u), len(core.gains))
    np.testing.assert_allclose(columns @ np.array(core.gains), y[:, 0], atol=1e-10 * np.ptp(y))
    assert len(core.signed) == len(core.gains)


@every_core
def test_other_gains_are_kept_and_a_forbidden_sign_is_moved_to_zero(core: Core) -> None:
    doubled = core.with_gains([2.0 * gain for gain in core.gains])
    assert doubled.gains == pytest.approx([2.0 * gain for gain in core.gains])
    turned = core.with_gains([-abs(gain) - 1.0 for gain in core.gains])
    for gain, may in zip(turned.gains, core.signed, strict=True):
        assert gain <= 0.0 if may else gain >= 0.0


@every_core
def test_it_is_saved_by_its_name_and_loaded(core: Core, tmp_path) -> None:
    model = model_of(core)
    assert PlantModel.load(model.save(tmp_path / "model.json")) == model
    document = model.to_dict()
    assert document["hysteresis"].get("core", "rdpi") == core.name
    document["hysteresis"]["core"] = "os:system"
    with pytest.raises(InputError, match=r"no core is named 'os:system'; known are .*, .*rdpi"):
        PlantModel.from_dict(document)


def test_a_file_of_the_paper_s_core_names_no_core() -> None:
    assert "core" not in P5.to_dict()["hysteresis"]


def test_lanes_of_two_cores_are_refused() -> None:
    models = [model_of(CORES[name].starts(SCALE)[0]) for name in ("rdpi", "stop")]
    with pytest.raises(InputError, match="lanes with the cores rdpi and stop"):
        Plant(models, TS_S)


@every_core
@settings(max_examples=25)
@given(
    u=arrays(np.float64, 60, elements=st.floats(-30.0, 30.0, width=32)),
    cuts=st.lists(st.integers(1, 59), min_size=1, max_size=4),
    seed=st.integers(0, 2**31),
)
def test_any_command_cut_anywhere_gives_the_same_numbers_to_the_last_bit(
    core: Core, u: Array, cuts: list[int], seed: int
) -> None:
    shares = np.random.default_rng(seed).uniform(0.5, 1.5, len(core.gains))
    model = model_of(core.with_gains((shares * core.gains).tolist()))
    u[30:33] = u[29]  # a command that stands still
    parts = Plant(model, TS_S)
    split = [parts.simulate(part) for part in np.split(u, sorted(set(cuts)))]
    np.testing.assert_array_equal(np.concatenate(split), Plant(model, TS_S).simulate(u))


@every_core
def test_steps_are_a_block(core: Core) -> None:
    u = walk(600)
    u[300:310] = u[299]  # a command that stands still
    whole, steps = run(core, u), Plant(model_of(core), TS_S)
    single = [float(steps.step(np.array([[value]]))[0, 0]) for value in u]
    np.testing.assert_allclose(single, whole, atol=1e-12 * float(np.ptp(whole)))


@over("lanes", [3, 20])
@every_core
def test_lanes_keep_numbers_of_their_own(core: Core, lanes: int) -> None:
    rng = np.random.default_rng(lanes)
    cores = [
        core.with_gains([gain * rng.uniform(0.7, 1.3) for gain in core.gains]).with_shape(
            {p.name: getattr(core, p.name) * rng.uniform(0.9, 1.1) for p in core.shape}
        )
        for _ in range(lanes)
    ]
    u = walk(300)[:, None] * rng.uniform(0.6, 1.0, lanes)
    together = Plant([model_of(each) for each in cores], TS_S).simulate(u)
    for lane, each in enumerate(cores):
        alone = run(each, u[:, lane].copy())
        atol = 1e-12 * float(np.ptp(alone))
        np.testing.assert_allclose(together[:, lane], alone, rtol=0, atol=atol)


@every_core
def test_a_rate_matters_only_where_it_says_so(core: Core) -> None:
    u = walk()
    slow, fast = run(core, u, TS_S), run(core, u, TS_S / 50.0)
    differs = float(np.max(np.abs(slow - fast))) / float(np.ptp(slow))
    assert differs > 1e-6 if core.rated else differs < 1e-12


@every_core
def test_its_loops_turn_the_way_that_it_says(core: Core) -> None:
    phase = np.linspace(0.0, 10.0 * np.pi, 20_001)
    u = 25.0 * np.sin(phase)
    y = run(core, u, 1e-2)
    last = slice(16_000, 20_001)  # the fifth cycle
    area = float(np.trapezoid(y[last], u[last]))
    size = float(np.ptp(u) * np.ptp(y))
    if core.clockwise is None:
        assert abs(area) > 1e-4 * size
    else:
        assert (area > 1e-4 * size) if core.clockwise else (area < -1e-4 * size)


@every_core
def test_a_small_loop_is_forgotten_where_it_says_so(core: Core) -> None:
    def leg(*corners: float) -> Array:
        steps = [np.linspace(a, b, 4000)[1:] for a, b in pairwise(corners)]
        return np.concatenate(steps)

    plain, looped = leg(0.0, 20.0, -5.0, 12.0), leg(0.0, 20.0, -5.0, 6.0, 1.0, 12.0)
    slow_s = 1e9  # no rate matters
    without, with_loop = run(core, plain, slow_s)[-1], run(core, looped, slow_s)[-1]
    size = abs(run(core, leg(0.0, 20.0), slow_s)[-1])
    if core.wipes_out:
        assert with_loop == pytest.approx(without, abs=1e-9 * size)
    else:
        assert abs(with_loop - without) > 1e-6 * size


@every_core
def test_memory_after_a_slow_walk_is_the_settled_one(core: Core) -> None:
    turns = (14.0, -6.0, 9.0, 2.0)
    path = np.concatenate(
        [np.linspace(a, b, 20_000) for a, b in zip((0.0, *turns), turns, strict=False)]
    )
    plant = Plant(model_of(core), 1e3)  # so slow that no rate matters
    before = plant.simulate(path)[-1]
    p, state = pack([core], 1e3, [0.0]), empty_state(core.n, 1)
    state[0], state[2:, 0] = turns[-1], core.settled(turns)
    y = np.empty((1, 1))
    core.block(np.full((1, 1), turns[-1]), np.zeros((1, 1)), p, state, y)
    size = abs(float(run(core, np.linspace(0.0, 20.0, 4000), 1e3)[-1]))
    assert float(y[0, 0]) == pytest.approx(before, abs=2e-6 * size)


@every_core
def test_no_command_moves_it_farther_than_its_largest_gain(core: Core) -> None:
    u = walk()
    assert core.a0 > 0.0
    assert np.all(np.abs(run(core, u, 1e3)) <= core.A * np.max(np.abs(u)) * (1 + 1e-9))


@every_core
def test_numbers_of_its_shape_are_fields_and_stay_within_their_bounds(core: Core) -> None:
    for parameter in core.shape:
        assert parameter.low <= getattr(core, parameter.name) <= parameter.high
        far = core.with_shape({parameter.name: 10.0 * parameter.high + 1.0})
        assert getattr(far, parameter.name) == parameter.high
        with pytest.raises(InputError, match=parameter.name):
            replace(core, **{parameter.name: float("nan")})  # type: ignore[type-var]


@over("name", CORES)
def test_it_says_what_people_look_for(name: str) -> None:
    kind = CORES[name]
    for text in (kind.title, kind.equation, kind.source, kind.signature, kind.experiment):
        assert len(text) > 10
    assert kind.hardware.endswith(".")


def test_what_runs_the_plays_of_the_rdpi_model_is_refused_around_other_cores() -> None:
    effect = next(form for form in forms_of(CATALOGUE["asymmetry"]) if form.weighs_plays)()
    for name, kind in CORES.items():
        core = kind.starts(SCALE)[0]
        if name == "rdpi":
            Plant(PlantModel(core, "m", (-30.0, 30.0), (0.0, 5.0), effects=(effect,)), TS_S)  # type: ignore[arg-type]
            continue
        with pytest.raises(InputError, match=f"only the core rdpi has, and the core is {name}"):
            PlantModel(core, "m", (-30.0, 30.0), (0.0, 5.0), effects=(effect,))  # type: ignore[arg-type]
