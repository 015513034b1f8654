"""``adaptive-dual-loop``: damping and integral tracking of what an adaptive feedforward leaves."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.adaptive_feedforward import MOST, AdaptiveFeedforward
from baselines.damping import DualLoop
from baselines.linear_feedback import CorrectedInverse
from baselines.loops.path import BeliefPath, belief_path
from baselines.tuning import Settings
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array


class CorrectedAdaptive(AdaptiveFeedforward):
    """The adaptive feedforward with a correction, which its estimate knows of.

    Examples
    --------
    >>> CorrectedAdaptive.needs_core is None
    True
    """

    def corrected_command(
        self, observation: NDArray[np.floating[Any]], correction_um: Array, state: Array
    ) -> Array:
        """Return u(k+1) (V), ``(B,)``; see :class:`baselines.linear_feedback.CorrectedInverse`."""
        measured = self.layout.measured_um(observation)
        now = self.layout.reference_um(observation, slice(1))[:, 0]
        wanted = self.wanted_um(observation, measured, now, state)
        return self.driven(observation, wanted + correction_um, state)


class AdaptiveDualLoop(DualLoop):
    """``dual-loop`` on ``adaptive-feedforward`` in place of the belief's inverse.

    The feedforward learns what the belief lacks and needs a period for it; the feedback damps the
    mode and answers what is not learned. The estimate takes the correction for what it is, a part of
    what went in, so the two do not work against each other. The feedforward has its own settings.

    Attributes
    ----------
    feedforward : CorrectedAdaptive
        What is corrected.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> layout = ObservationLayout.for_plant(P10, 1e-4, preview=8)
    >>> AdaptiveDualLoop(P10, layout, {}).inverse.name
    'adaptive-feedforward'
    """

    name = "adaptive-dual-loop"

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        self.feedforward = self.adaptive(belief, layout)
        super().__init__(belief, layout, settings)
        self.plant_samples += self.feedforward.plant_samples

    def adaptive(self, belief: PlantModel, layout: ObservationLayout) -> CorrectedAdaptive:
        """Return the feedforward; its settings are its own."""
        return CorrectedAdaptive(belief, layout)

    def certificate(self) -> str | None:
        """Return what is certain of the feedback on its belief, which the adaptation is no part of."""
        line = super().certificate()
        most = MOST * self.layout.scale_um
        return line and f"{line}; of the feedback alone: the adaptation adds {most:.3g} µm at most"

    def inverse_and_path(self) -> tuple[CorrectedInverse, BeliefPath]:
        """Return the adaptive feedforward, and the belief's path: the correction passes all of it."""
        return self.feedforward, belief_path(self.belief, self.layout.ts_s)
