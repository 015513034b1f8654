"""The student at work: ``adaptive-dual-loop`` with what the student adds to its displacement."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.adaptive_dual_loop import AdaptiveDualLoop, CorrectedAdaptive
from baselines.learned.imitation.policy import StudentPolicy
from baselines.learned.imitation.student import MOST_UM
from baselines.learned.imitation.taught import PREVIEW, TaughtAdaptive, Witness
from baselines.learned.kept import check_preview
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array


class StudentController(AdaptiveDualLoop):
    """What a student does in its training, from the same observations, at its own sampling time.

    The base runs with the settings that the student was taught on.

    Parameters
    ----------
    policy
        What was learned.
    belief, layout
        As :class:`baselines.base.Baseline`.
    witness
        Told of every sample, by a training.

    Raises
    ------
    InputError
        The student was taught at another sampling time.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> layout = ObservationLayout.for_plant(P10, 1e-4, preview=8)
    >>> policy = StudentPolicy.untaught(P10, layout, hidden=4)
    >>> taught, base = StudentController(policy, P10, layout), AdaptiveDualLoop(P10, layout)
    >>> shown = np.full((1, layout.size), 0.1, dtype=np.float32)
    >>> bool(taught.predict(shown)[0] == base.predict(shown)[0])
    True
    """

    def __init__(
        self,
        policy: StudentPolicy,
        belief: PlantModel,
        layout: ObservationLayout,
        witness: Witness | None = None,
    ) -> None:
        policy.check_runs(layout)
        self.policy, self._witness = policy, witness
        super().__init__(belief, layout, policy.loop)
        self.plant_samples += int(policy.training.get("at_timesteps", 0))

    def adaptive(self, belief: PlantModel, layout: ObservationLayout) -> CorrectedAdaptive:
        """Return the feedforward with the student beside it."""
        policy = self.policy
        return TaughtAdaptive(belief, layout, policy.feedforward, policy.student, self._witness)

    @property
    def needed_preview(self) -> int:
        """Samples that the student sees, or the feedforward needs."""
        return max(PREVIEW, super().needed_preview)

    def next_command(
        self, observation: NDArray[np.floating[Any]], reference_um: Array, state: Array
    ) -> Array:
        """See :meth:`baselines.base.Baseline.next_command`."""
        check_preview(self.layout, PREVIEW)
        return super().next_command(observation, reference_um, state)

    def certificate(self) -> str | None:
        """Return what is certain of the feedback; of what a network adds only the bound is."""
        line = super().certificate()
        return line and f"{line}; the student adds {MOST_UM:.3g} µm at most"

    def warning(self) -> str | None:
        """Return one line where it was taught on another belief, amplitude or command range."""
        taught, layout = self.policy.layout, self.layout
        if sorted(e.name for e in self.belief.effects) != list(self.policy.effects):
            return f"taught on a belief with {', '.join(self.policy.effects) or 'no effects'}"
        if (taught.scale_um, taught.command_range_V) != (layout.scale_um, layout.command_range_V):
            return f"taught for {taught.scale_um:g} µm"
        return super().warning()
