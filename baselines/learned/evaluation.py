"""How well a controller tracks on plants and references that no training has seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baselines.learned.environments import make_lanes
from baselines.learned.options import TrainingOptions
from baselines.learned.seen import Witnessed
from rdpi_gym.envs.controller import ControllerFactory

LANES, SAMPLES, FIRST = 24, 1000, 200
"""Plants, each with a reference of its own; samples of a run; the first that counts."""
SEED = 2**33
"""Of the held-out plants, references and noise; beyond the seeds that trainings draw."""


@dataclass(frozen=True)
class Evaluation:
    """Means over the held-out plants.

    Parameters
    ----------
    reward
        Of a sample.
    rmse_um, rmse_percent
        Root mean square tracking error of a plant (µm, percent of its reference's peak to peak).
    command_variation_V_s
        Total variation of the command (V/s).
    """

    reward: float
    rmse_um: float
    rmse_percent: float
    command_variation_V_s: float


class HeldOut:
    """Held-out plants and references, the same at every evaluation.

    Parameters
    ----------
    options
        What they are drawn from.

    Raises
    ------
    InputError
        No environment can be made of the options.
    """

    def __init__(self, options: TrainingOptions) -> None:
        self._env = make_lanes(
            options.models, LANES, SAMPLES + 1, action="command", **options.world()
        )

    def witness(self) -> Witnessed:
        """Return who can be told of the observations of a run."""
        return Witnessed(self._env.layout)

    def evaluate(self, make: ControllerFactory, witness: Witnessed | None = None) -> Evaluation:
        """Run the controller that `make` makes of the plants' belief and layout."""
        controller = make(self._env.belief, self._env.layout)
        observation, _ = self._env.reset(seed=SEED)
        state, starts = None, np.ones(LANES, dtype=bool)
        errors, references, commands, rewards = (np.empty((SAMPLES, LANES)) for _ in range(4))
        for k in range(SAMPLES):
            if witness is not None:
                witness.take(observation)
            action, state = controller.predict(observation, state, starts, deterministic=True)
            observation, rewards[k], _, _, infos = self._env.step(action)
            errors[k], references[k] = infos["error_um"], infos["reference_um"]
            commands[k] = infos["command_V"]
            starts[:] = False
        rmse = np.sqrt(np.mean(errors[FIRST:] ** 2, axis=0))
        steps = np.abs(np.diff(commands[FIRST - 1 :], axis=0))
        return Evaluation(
            float(rewards[FIRST:].mean()),
            float(rmse.mean()),
            float(100.0 * (rmse / np.ptp(references[FIRST:], axis=0)).mean()),
            float(steps.mean() / self._env.layout.ts_s),
        )
