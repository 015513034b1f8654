"""The bound with everybody's preview: inversion of the true plant over a horizon that recedes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.base import Baseline
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import Plant
from rdpi_gym.support.arrays import Array

HORIZON_BOUND = "true-plant-horizon"
"""Name of :class:`TrueHorizon` in tables."""
SMOOTHING = 1e-4
"""Price of the second difference of the command, in units of the squared error that the largest gain
makes of it: what keeps the plan from ringing at zeros that sampling makes."""
# Of the command's range: the step that derivatives are taken with.
_STEP = 1e-3


class TrueHorizon(Baseline):
    """Knows the true plants and all that they remember, and looks as far ahead as anybody.

    In each sample it improves the commands over the preview by a Gauss-Newton step on the plant
    itself, for the smallest squared error, and sets the first of them: each is improved as often as
    there are samples of preview before it is set. No reading enters, so no noise does. A controller that knew the plant exactly could do as much: the distance to it is the
    price of not knowing. It is no proof of a smallest error, as its horizon ends and its commands
    are kept smooth. Like the full-preview inversion it holds what no controller may hold, so
    :func:`~baselines.make_controller` does not make it.

    Parameters
    ----------
    plant
        The true plants, one a lane; of its own, as it is run along.
    layout
        As :class:`baselines.base.Baseline`.
    smoothing
        Price of the second difference of the command, in units of the squared error that the largest
        gain makes of it.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> p5 = named_plant("P5-static")
    >>> layout = ObservationLayout.for_plant(p5, ts_s=1e-3, preview=4)
    >>> bound = TrueHorizon(Plant(p5, 1e-3), layout)
    >>> flat = np.zeros((1, layout.size), dtype=np.float32)
    >>> flat[0, 1:5] = 0.1  # r = 1 µm from the next sample on
    >>> action, _ = bound.predict(flat)
    >>> check = Plant(p5, 1e-3)
    >>> bool(abs(check.simulate([0.0, float(layout.place_to_V(action[0, 0]))])[1] - 1.0) < 0.02)
    True
    """

    def __init__(
        self, plant: Plant, layout: ObservationLayout, smoothing: float = SMOOTHING
    ) -> None:
        super().__init__(plant.models[0], layout)
        self._twin, self._count = plant, layout.preview + 1
        self._models = plant.models
        self._many = Plant(list(plant.models) * self._count, layout.ts_s)
        h = layout.preview
        gain = np.array([model.hysteresis.A for model in plant.models])
        self._second = second_differences(h)
        self._price = smoothing * gain**2
        self._plan = np.zeros((h + 2, plant.lanes))

    def warning(self) -> str | None:
        """Say that it is a bound."""
        return "it holds the true plant, as no controller may"

    def start(self, reference_um: Array) -> Array:
        """Put the true plants to rest, float64[0, B]."""
        rest = self.limits.rest_V
        self._twin.reset(u0_V=rest)
        self._twin.step(np.full((1, self._twin.lanes), rest))
        self._plan[:] = rest
        return np.zeros((0, len(reference_um)))

    def next_command(
        self, observation: NDArray[np.floating[Any]], reference_um: Array, state: Array
    ) -> Array:
        """Plan, and set the first command; see :meth:`baselines.base.Baseline.next_command`."""
        target = self.layout.reference_um(observation)[:, 1:].T  # (H, B)
        here = [np.tile(part, (1, self._count)) for part in self._twin.snapshot()]
        if self._twin.models is not self._models:
            self._models = self._twin.models
            self._many.retune(list(self._models) * self._count)
        # Rows 0 and 1 are the last two commands; the plan goes on as it ended.
        plan = np.concatenate([self._plan[1:], 2.0 * self._plan[-1:] - self._plan[-2:-1]])
        plan[2:] += self._improvement(target, plan, here)
        np.clip(plan, self.limits.low_V, self.limits.high_V, out=plan)
        self._plan = plan
        command = plan[2]
        self._twin.step(np.ascontiguousarray(command[None]))
        return np.array(command, dtype=np.float64)

    def _improvement(self, target: Array, plan: Array, here: list[Array]) -> Array:
        h, lanes = target.shape
        step = _STEP * (self.limits.high_V - self.limits.low_V)
        tried = np.repeat(plan[2:, None, :], self._count, axis=1)
        for j in range(h):
            tried[j, j + 1] += step
        self._many.restore(here)
        y = self._many.simulate(tried.reshape(h, -1)).reshape(h, self._count, lanes)
        slope = ((y[:, 1:] - y[:, :1]) / step).transpose(2, 0, 1)  # (B, out, in)
        error = (target - y[:, 0]).T[:, :, None]
        own = self._second[:, 2:]
        bent = (self._second @ plan).T[:, :, None]
        price = self._price[:, None, None]
        turned = slope.transpose(0, 2, 1)
        normal = turned @ slope + price * (own.T @ own)
        wanted = turned @ error - price * (own.T @ bent)
        return np.asarray(np.linalg.solve(normal, wanted)[:, :, 0].T, dtype=np.float64)


def second_differences(horizon: int) -> Array:
    """Return what makes second differences of two past samples and those of a horizon."""
    bends = np.zeros((horizon, horizon + 2))
    for i in range(horizon):
        bends[i, i : i + 3] = 1.0, -2.0, 1.0
    return bends
