"""The bank of cores: it finds kinds that it holds, that were taken from it, and that the project lacks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from numba import njit

from baselines import CONTROLLERS, core_bank, known_controller, make_controller
from baselines.adaptive_feedforward import SPLINE
from baselines.core_bank import NOMINAL, AdaptiveCoreBank, BankFeedforward, CoreBank
from benchmarks.stages.run import plant_scores
from benchmarks.tracking.episode import play
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.tasks import TASKS, StageTask
from rdpi_gym.plant import P10, Plant, named_plant
from rdpi_gym.plant.cores.duhem import Duhem
from rdpi_gym.plant.effects.actuator_lag import ActuatorLag
from rdpi_gym.support.errors import InputError
from tests.looping import over

OF_TASK = {"Preisach": "preisach", "BoucWen": "bouc_wen", "Duhem": "duhem"}


def percent(task: StageTask, plants: int | list[int] = 1) -> float:
    """Mean RMSE (%) over validation plants; infinite where one fails."""
    (lanes,) = task.lanes("validation", plants)
    controller = make_controller("adaptive-core-bank", lanes.belief, lanes.layout())
    taken = play(controller, lanes.track(lanes.layout()), lanes.references_um, lanes.noises)
    rows = plant_scores(task, lanes, taken).values()
    assert not any(row["failure"] for row in rows)
    return float(np.mean([row["rmse_percent"] for row in rows]))


@pytest.mark.slow
def test_kinds_that_the_bank_holds_are_identified_while_driving():
    for name in (*OF_TASK, "Measured"):
        assert percent(TASKS[name]) < 0.1, name


@pytest.mark.slow
def test_dynamics_of_fast_steps_are_identified_behind_a_lag_that_stands_before_the_hysteresis():
    assert percent(TASKS["Steps"], 2) < 0.16
    assert percent(TASKS["Resonance"], 2) < 0.05


@pytest.mark.slow
def test_a_slow_sensor_that_is_believed_too_fast_takes_no_more_correction_than_is_allowed():
    """Plants whose sensor lags by 19 and 18 ms where 15 are believed, with the fastest sines."""
    assert percent(TASKS["Measured"], [2]) < 0.05
    assert percent(TASKS["Measured"], [11]) < 0.05


def test_the_bank_follows_the_applied_command_behind_the_believed_lag_and_at_its_own_rate():
    belief, rng = TASKS["Bare"].belief(), np.random.default_rng(0)
    command = np.cumsum(rng.normal(size=(300, 2)), axis=0)
    lag = ActuatorLag(time_constant_s=2e-4)
    for effects, lagged in (((), command), ((lag,), np.zeros_like(command))):
        told = replace(belief, effects=effects)
        bank = CoreBank(told, TASKS["Bare"].layout(), 7, SPLINE[0])
        assert bank.lag == pytest.approx(np.exp(-0.5) if effects else 0.0)
        if effects:
            last = np.zeros(2)
            for k, u in enumerate(command):
                lagged[k] = last = bank.lag * last + (1.0 - bank.lag) * u
        plant = Plant(replace(belief, effects=()), 1e-4, lanes=2)
        plant.reset(u0_V=0.0)
        memory, given = bank.start(np.zeros(2)), np.zeros_like(command)
        for k, u in enumerate(command):
            bank.take(u, memory)
            given[k] = bank.rows.of(memory, "columns")[0]
        np.testing.assert_allclose(given, plant.simulate(lagged), rtol=0.0, atol=1e-9)


def test_a_correction_passes_the_believed_lag_that_the_bank_undoes():
    belief, layout = TASKS["Bare"].belief(), TASKS["Bare"].layout()
    for effects, first in (((), 1.0), ((ActuatorLag(time_constant_s=2e-4),), 1.0 - np.exp(-0.5))):
        made = BankFeedforward(replace(belief, effects=effects), layout)
        state = made.start(np.zeros(1))
        passed = [made.corrected(np.zeros(1), state, np.ones(1))[0] for _ in range(40)]
        assert passed[0] == pytest.approx(first)
        assert passed[-1] == pytest.approx(1.0)


@pytest.mark.slow
def test_a_kind_that_was_taken_from_the_bank_is_made_up_for_by_the_others(monkeypatch):
    held = CoreBank.spreads
    for name, kind in OF_TASK.items():
        place = NOMINAL.index(kind)

        def without(bank: CoreBank, place: int = place) -> list[float]:
            return [1e-9 if i == place else each for i, each in enumerate(held(bank))]

        monkeypatch.setattr(core_bank.CoreBank, "spreads", without)
        assert percent(TASKS[name]) < 0.2, name


@njit
def bent_block(u: Any, v: Any, p: Any, state: Any, y: Any) -> None:
    """y' = α |u'| (f(u) - y) + c u' with a cubic f, by the midpoint of ten parts of each way."""
    last = p.shape[0] - 1
    for t in range(u.shape[0]):
        for b in range(u.shape[1]):
            way = 0.1 * (u[t, b] - state[3, b])
            for _ in range(10):
                middle = state[3, b] + 0.5 * way
                bent = middle * (p[0, b] + middle * (p[3, b] + middle * p[4, b]))
                z = state[2, b]
                for _ in range(2):
                    mean = 0.5 * (z + state[2, b])
                    z = state[2, b] + abs(way) / p[2, b] * (bent - mean) + p[1, b] * way
                state[2, b] = z
                state[3, b] += way
            y[t, b] = state[2, b] + p[last, b]


@dataclass(frozen=True)
class BentDuhem(Duhem):
    """The Duhem model with a cubic where that of Coleman and Hodgdon has a line: no core of the project."""

    square: float = 0.0
    cubic: float = 0.0

    name: ClassVar[str] = "bent_duhem_of_a_test"
    block = staticmethod(bent_block)

    def coefficients(self) -> list[float]:
        """As those of the line, then the square and the cubic."""
        return [*super().coefficients(), self.square, self.cubic]


def test_a_kind_that_the_project_does_not_have_is_tracked_as_well():
    task = TASKS["Duhem"]
    line = task.nominals[0].hysteresis
    bent = BentDuhem(line.b, line.c, line.length_V, square=0.6, cubic=-0.1)
    nominal = replace(task.nominals[0], hysteresis=bent)
    assert percent(replace(task, nominals=(nominal,))) < 0.2


@over("tries", [core_bank.TRIES, 3])
def test_the_inverse_of_the_mixture_gives_what_is_wanted(tries, monkeypatch):
    """Two tries leave less than the sensor's noise at any sample, three a tenth of it."""
    monkeypatch.setattr(core_bank, "TRIES", tries)
    belief, lanes = TASKS["Preisach"].belief(), 3
    layout = ObservationLayout.for_plant(belief, 1e-4, preview=8)
    bank = CoreBank(belief, layout, 7, SPLINE[0])
    rng = np.random.default_rng(0)
    weights = rng.uniform(-0.1, 0.3, (bank.count, lanes))
    start = np.full(lanes, layout.centre_um - layout.scale_um)
    memory = bank.start(start)
    wanted = layout.centre_um - layout.scale_um * np.cos(np.arange(400) / 30.0)
    left = []
    for r in wanted:
        command = bank.command(np.full(lanes, r), weights, 20.0, memory)
        bank.take(command, memory)
        columns = bank.rows.of(memory, "columns")
        given = columns[0] + np.clip((weights * columns[1:]).sum(axis=0), -20.0, 20.0)
        inside = (command > layout.command_range_V[0]) & (command < layout.command_range_V[1])
        left.append(np.where(inside, np.abs(given - r), 0.0))
    assert np.max(left[20:]) < (1e-3 if tries == 3 else 5e-3)
    assert np.sqrt(np.mean(np.square(left[20:]))) < 2e-4


def test_the_same_numbers_of_a_belief_give_the_same_bank_whatever_its_name():
    belief = TASKS["Duhem"].belief()
    layout = TASKS["Duhem"].layout()
    named = AdaptiveCoreBank(replace(belief, name="Preisach"), layout)
    shown = np.zeros((1, layout.size), dtype=np.float32)
    expected, _ = AdaptiveCoreBank(belief, layout).predict(shown)
    np.testing.assert_array_equal(named.predict(shown)[0], expected)


@over(
    "name",
    ["pi-preview", "adaptive-inverse", "lqg-preview", "extended-inverse", "pi-classical-static"],
)
def test_what_needs_the_rdpi_core_says_so_on_another_one(name):
    belief = named_plant("picma-preisach")
    layout = ObservationLayout.for_plant(belief, 1e-3, preview=8)
    with pytest.raises(InputError, match=r" inverts the core rdpi, and belief picma-preisach has "):
        make_controller(name, belief, layout)
    for other in ("adaptive-dual-loop", "adaptive-core-bank", "hybrid"):
        assert make_controller(other, belief, layout).limits


def test_aliases_make_the_controller_and_stand_in_no_list():
    layout = ObservationLayout.for_plant(P10, 1e-4, preview=8)
    for alias, name in {
        "adaptive-inverse-dynamics": "adaptive-feedforward",
        "adaptive-play-weights": "adaptive-inverse",
        "adaptive-feedforward-dual-loop": "adaptive-dual-loop",
        "adaptive-feedforward-integral": "hybrid",
    }.items():
        assert known_controller(alias) is CONTROLLERS[name]
        assert make_controller(alias, P10, layout).name == name
        assert alias not in list(CONTROLLERS)
