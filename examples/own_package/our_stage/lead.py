"""Lead: the static inverse, read some samples ahead."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import PlantModel

SAMPLES = 2


class Lead:
    """Divides the reference by the static gain, and reads it `SAMPLES` samples ahead.

    Parameters
    ----------
    belief
        What it believes of the plant.
    layout
        What an observation shows.
    """

    needed_preview = SAMPLES

    def __init__(self, belief: PlantModel, layout: ObservationLayout) -> None:
        self.gain_um_V, self.layout = belief.hysteresis.A, layout

    def predict(
        self,
        observation: NDArray[Any],
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], Any]:
        """Answer the reference some samples ahead; no state."""
        command_V = self.layout.reference_um(observation)[..., SAMPLES] / self.gain_um_V
        return self.layout.action_for(command_V, observation), state

    def warning(self) -> str | None:
        """Nothing can make it unstable."""
        return None
