"""What an environment shows: where in the observation each quantity stands, and in what unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.plant import PlantModel, check_ts
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite, is_whole, shown
from rdpi_gym.support.errors import InputError

_FARTHEST = 100_000  # samples ahead

ActionMode = Literal["command", "increment", "correction"]


@dataclass(frozen=True)
class ObservationLayout:
    """What an observation shows, and how an action is read.

    The observation is ``[r(k), r(k+1) ... r(k+preview), measured(k), command(k)]``. Displacements stand as ``(x - centre_um) / scale_um``, the command as its place in
    `command_range_V`, -1 to 1. The action at step k sets the command u(k+1): its place in the range
    (``command``), its change in units of `action_scale_V` (``increment``), or what is added to a
    baseline's command, in the same unit (``correction``).

    Parameters
    ----------
    preview
        Samples of the reference shown ahead, at least 1.
    centre_um, scale_um
        Centre and unit (µm) of displacements.
    command_range_V
        Lowest and highest command (V).
    ts_s
        Sampling time (s).
    action
        How actions are read.
    action_scale_V
        Command change (V) of an action of 1, for ``increment`` and ``correction``.

    Raises
    ------
    InputError
        A value out of range or an unknown action mode.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> layout = ObservationLayout.for_plant(named_plant("P5"), ts_s=1e-4, preview=2)
    >>> layout.size
    5
    """

    preview: int
    centre_um: float
    scale_um: float
    command_range_V: tuple[float, float]
    ts_s: float
    action: ActionMode = "command"
    action_scale_V: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "ts_s", check_ts(self.ts_s))
        if not is_whole(self.preview, 1) or self.preview > _FARTHEST:
            raise InputError(
                f"preview is {shown(self.preview)}; show a whole number of samples ahead, at least 1 "
                f"and at most {_FARTHEST}"
            )
        object.__setattr__(self, "preview", int(self.preview))
        if not isinstance(self.action, str) or self.action not in get_args(ActionMode):
            raise InputError(
                f"action {shown(self.action)} is unknown; choose {', '.join(get_args(ActionMode))}"
            )
        if not is_finite(self.centre_um):
            raise InputError(
                f"centre_um is {shown(self.centre_um)}; give a finite displacement (µm)"
            )
        for name in ("scale_um", "action_scale_V"):
            value = getattr(self, name)
            if not (is_finite(value) and value > 0):
                raise InputError(f"{name} is {shown(value)}; give a finite value above 0")
        for name in ("centre_um", "scale_um", "action_scale_V"):
            object.__setattr__(self, name, float(getattr(self, name)))

    @classmethod
    def for_plant(
        cls, plant: PlantModel, ts_s: float, preview: int = 4, **options: Any
    ) -> ObservationLayout:
        """Scale to a plant's usual reference and command range; `options` are further fields."""
        centre, amplitude = plant.reference_um
        return cls(preview, centre, amplitude, plant.command_range_V, ts_s, **options)

    @property
    def size(self) -> int:
        """Length of the observation."""
        return self.preview + 3

    def reference_um(self, observation: NDArray[np.floating]) -> Array:
        """Reference now and ahead (µm), ``(..., preview + 1)``, of observations ``(..., size)``."""
        shown = np.asarray(observation, dtype=np.float64)[..., : self.preview + 1]
        return shown * self.scale_um + self.centre_um

    def measured_um(self, observation: NDArray[np.floating]) -> Array:
        """Measured displacement (µm), ``(...)``."""
        shown = np.asarray(observation, dtype=np.float64)[..., self.preview + 1]
        return np.asarray(shown * self.scale_um + self.centre_um)

    def command_V(self, observation: NDArray[np.floating]) -> Array:
        """Command that holds now (V), ``(...)``."""
        return self.place_to_V(np.asarray(observation, dtype=np.float64)[..., self.preview + 2])

    def place_to_V(self, place: Array) -> Array:
        """Command (V) at a place of -1 to 1 in the range."""
        low, high = self.command_range_V
        return np.asarray(low + 0.5 * (place + 1.0) * (high - low))

    def action_for(
        self, command_V: Array, observation: NDArray[np.floating]
    ) -> NDArray[np.float32]:
        """Action ``(..., 1)`` that sets a command (V), clipped to [-1, 1]; not for ``correction``."""
        if self.action == "command":
            low, high = self.command_range_V
            action = 2.0 * (command_V - low) / (high - low) - 1.0
        else:
            action = (command_V - self.command_V(observation)) / self.action_scale_V
        return np.clip(action, -1.0, 1.0)[..., None].astype(np.float32)
