"""The information bound: the plant estimated from an episode's own readings, and inverted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baselines import TrueHorizon
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.tasks import StageTask
from rdpi_gym.envs.truth import drawn_parameters
from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

EVERY = 100
"""Samples between two estimates: a period of the fastest sine at 0.1 ms."""
_PROBE = 0.02  # of a parameter's half-width: the step that derivatives are taken with
_VARIANCE = 1.0 / 3.0  # of a number drawn uniformly within its half-width, in units of that
_SHORTER, _SHORTENINGS = 0.3, 3  # of a step that raises the cost
_JUMPS = 32  # of effects' numbers that are tried at every estimate, as a mode elsewhere is no small step away
_LANES = 2000  # that are simulated at a time


@dataclass(frozen=True)
class Hypothesis:
    """Plants about one nominal plant, by numbers of -1 to 1 in units of the task's half-widths."""

    task: StageTask
    nominal: PlantModel[Any]

    @property
    def size(self) -> int:
        """Count of the numbers that a task draws of such a plant."""
        effects = sum(len(drawn_parameters(effect)) for effect in self.nominal.effects)
        return int(self.nominal.hysteresis.factors) + effects

    def plant(self, numbers: Array) -> PlantModel[Any]:
        """Return the plant with these numbers."""
        core = self.nominal.hysteresis
        own, rest = np.split(numbers, [core.factors])
        scaled = core.scaled(1.0 + self.task.half_width * own)
        effects, left = [], iter(rest.tolist())
        for effect in self.nominal.effects:
            values = effect.values
            for name in drawn_parameters(effect):
                values[name] *= 1.0 + self.task.effects_half_width * next(left)
            effects.append(type(effect).within_bounds(**values))
        return replace(self.nominal, hysteresis=scaled, effects=tuple(effects))


class FullInformation:
    """Knows the distribution that a task draws its plants from, and the readings of its own episode.

    Every :data:`EVERY` samples it finds the plant of the largest posterior density in each lane: by a
    Gauss-Newton step on all readings so far, the task's uniform distribution as a normal one of the
    same variance, no number beyond its half-width, begun where the effects' numbers, drawn anew, do
    better. Where a task has several kinds of plants it goes
    with the likeliest. The estimate, with all that it remembers of the commands, is inverted as the
    true plant is by :class:`~baselines.TrueHorizon`. It does not learn from other lanes, and does not
    probe: it is no proof of a smallest error. Every estimate simulates the episode hundreds of times, so
    it is no controller.

    Raises
    ------
    InputError
        The task's plants change by themselves, which the estimate does not know of.
    """

    def __init__(self, task: StageTask, layout: ObservationLayout) -> None:
        if task.ageing is not None or task.schedule is not None:
            raise InputError(
                f"no information bound is known of {task.name}, whose plants change; take another task"
            )
        self.layout = layout
        self._hypotheses = [Hypothesis(task, nominal) for nominal in task.nominals]
        resolution = task.nominals[0].sensor.resolution_um
        self._variance = task.noise_um**2 + resolution**2 / 12.0

    def warning(self) -> str:
        """Say that it is a bound."""
        return "it knows the distribution of the plants, as no controller may"

    def predict(
        self,
        observation: NDArray[Any],
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[Any], Any]:
        """Return an action for each lane; all begin together."""
        if state is None:
            self._begin(len(observation))
        self._measured.append(self.layout.measured_um(observation))
        if len(self._measured) % EVERY == 0:
            self._estimate()
        command = np.empty(len(observation))
        for lanes, horizon in self._horizons:
            shown = observation[lanes]
            command[lanes] = horizon.next_command(shown, np.zeros(0), np.zeros(0))
        self._commands.append(command)
        return self.layout.action_for(command, observation), self

    def _begin(self, lanes: int) -> None:
        self._rng = np.random.default_rng(0)
        self._numbers = [np.zeros((lanes, each.size)) for each in self._hypotheses]
        nominal = self._hypotheses[0].plant(self._numbers[0][0])
        horizon = TrueHorizon(Plant([nominal] * lanes, self.layout.ts_s), self.layout)
        self._rest_V = horizon.limits.rest_V
        horizon.start(np.zeros(lanes))
        self._horizons = [(np.arange(lanes), horizon)]
        self._measured: list[Array] = []
        self._commands = [np.full(lanes, self._rest_V)]

    def _estimate(self) -> None:
        commands, measured = np.array(self._commands), np.array(self._measured)
        lanes = measured.shape[1]
        costs = np.empty((len(self._hypotheses), lanes))
        for each, numbers, cost in zip(self._hypotheses, self._numbers, costs, strict=True):
            for some in np.array_split(np.arange(lanes), -(-lanes * (each.size + 1) // _LANES)):
                if len(some):
                    own = commands[:, some], measured[:, some]
                    numbers[some], cost[some] = self._improved(each, numbers[some], *own)
        chosen = np.argmin(costs, axis=0)
        plans = self._plans(lanes)
        self._horizons = []
        for i in np.unique(chosen).tolist():
            some = np.flatnonzero(chosen == i)
            plant = self._plant([self._hypotheses[i].plant(x) for x in self._numbers[i][some]])
            plant.simulate(commands[:, some])
            horizon = TrueHorizon(plant, self.layout)
            horizon._plan = plans[:, some]
            self._horizons.append((some, horizon))

    def _plans(self, lanes: int) -> Array:
        """Return the commands that are planned in every lane."""
        plans = np.empty((self.layout.preview + 2, lanes))
        for some, horizon in self._horizons:
            plans[:, some] = horizon._plan
        return plans

    def _improved(
        self, law: Hypothesis, numbers: Array, commands: Array, measured: Array
    ) -> tuple[Array, Array]:
        """Return numbers ``(B, P)`` of a lower cost, and the cost of each lane."""
        lanes, size = numbers.shape
        numbers = self._jumped(law, numbers, commands, measured)
        probed = np.repeat(numbers[None], size + 1, axis=0)
        inwards = np.where(numbers > 0.0, -_PROBE, _PROBE)
        for i in range(size):
            probed[i + 1, :, i] += inwards[:, i]
        y = self._response(law, probed.reshape(-1, size), np.tile(commands, (1, size + 1)))
        y = y.reshape(-1, size + 1, lanes)
        error = measured - y[:, 0]
        slope = (y[:, 1:] - y[:, :1]) / inwards.T
        turned = slope.transpose(2, 1, 0)
        normal = turned @ slope.transpose(2, 0, 1) / self._variance + np.eye(size) / _VARIANCE
        wanted = (turned @ error.T[:, :, None])[:, :, 0] / self._variance - numbers / _VARIANCE
        step = np.linalg.solve(normal, wanted[:, :, None])[:, :, 0]
        before = self._cost(error, numbers)
        length = np.ones((lanes, 1))
        for left in reversed(range(_SHORTENINGS + 1)):
            tried = np.clip(numbers + length * step, -1.0, 1.0)
            cost = self._cost(measured - self._response(law, tried, commands), tried)
            worse = cost > before
            if not worse.any():
                break
            length[worse] *= _SHORTER if left > 1 else 0.0
        return tried, cost

    def _jumped(self, law: Hypothesis, numbers: Array, commands: Array, measured: Array) -> Array:
        """Return the numbers, or where it costs less those with some of the effects' drawn anew."""
        lanes, size = numbers.shape
        first = int(law.nominal.hysteresis.factors)
        if first == size:
            return numbers
        tried = np.repeat(numbers[None], _JUMPS + 1, axis=0)
        part = tried[1:, :, first:]
        drawn = self._rng.uniform(-1.0, 1.0, part.shape)
        part[:] = np.where(self._rng.random(part.shape) < 0.5, drawn, part)
        y = self._response(law, tried.reshape(-1, size), np.tile(commands, (1, _JUMPS + 1)))
        error = np.tile(measured, (1, _JUMPS + 1)) - y
        costs = self._cost(error, tried.reshape(-1, size)).reshape(-1, lanes)
        return np.asarray(tried[np.argmin(costs, axis=0), np.arange(lanes)])

    def _cost(self, error: Array, numbers: Array) -> Array:
        likelihood = np.sum(error**2, axis=0) / self._variance
        return np.asarray(likelihood + np.sum(numbers**2, axis=1) / _VARIANCE)

    def _response(self, law: Hypothesis, numbers: Array, commands: Array) -> Array:
        return self._plant([law.plant(each) for each in numbers]).simulate(commands)

    def _plant(self, models: Sequence[PlantModel[Any]]) -> Plant:
        plant = Plant(list(models), self.layout.ts_s)
        plant.reset(u0_V=self._rest_V)
        return plant
