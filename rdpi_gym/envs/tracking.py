"""Tracking problems side by side: plants, their sensors, the references, and what is shown of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from rdpi_gym.envs.draw_laws import NOISE_BLOCK
from rdpi_gym.envs.layout import (
    AHEAD,
    COLUMN,
    GAIN,
    LIMIT,
    SHIFT,
    SPAN,
    ZERO,
    ObservationLayout,
    field_values,
)
from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


@njit(cache=True)
def _show(
    k: int,
    noise_row: int,
    y: Array,
    u: Array,
    reference: Array,
    noise: Array,
    resolution: Array,
    encoder: Array,
    quantities: Array,
    observation: NDArray[np.float32],
) -> None:
    """Fill quantities and observations; `encoder` is that of an ObservationLayout."""
    last, window = reference.shape[0] - 1, int(encoder[0, AHEAD])
    for b in range(y.shape[1]):
        measured = y[0, b] + noise[noise_row, b]
        if resolution[b] > 0.0:
            measured = np.rint(measured / resolution[b]) * resolution[b]
        now, ahead = reference[min(k, last), b], reference[min(k + window, last), b]
        quantities[0, b] = y[0, b]
        quantities[1, b] = measured
        quantities[2, b] = now
        quantities[3, b] = u[0, b]
        quantities[4, b] = now - y[0, b]
        values = field_values(ahead, now, measured, u[0, b])
        if len(values) != len(encoder):
            raise RuntimeError("this kernel was compiled for other fields; delete its __pycache__")
        for i in range(len(values)):
            column, limit = int(encoder[i, COLUMN]), encoder[i, LIMIT]
            if column >= 0:
                place = encoder[i, GAIN] * (values[i] - encoder[i, ZERO]) / encoder[i, SPAN]
                place -= encoder[i, SHIFT]
                if limit < np.inf:  # else NaN stays NaN
                    place = place if place < limit else limit
                    place = place if place > -limit else -limit
                observation[b, column] = place
        begin = int(encoder[0, COLUMN]) - window
        for j in range(window):
            r = reference[min(k + j, last), b]
            observation[b, begin + j] = (r - encoder[0, ZERO]) / encoder[0, SPAN]


class NoiseSource(Protocol):
    """Source of a sensor's noise: a generator of numpy, or coloured noise."""

    def standard_normal(self, size: int, /) -> Array:
        """Return the next numbers, in units of the sensor's standard deviation."""
        ...


def _view(row: int, meaning: str) -> property:
    return property(lambda task: task.quantities[row], doc=meaning)


class TrackingTask:
    """B tracking problems with one layout, stepped together: B = 1 is the single environment.

    Parameters
    ----------
    models
        One plant, or one a lane (all with the same number of plays), sensor included; or a
        :class:`~rdpi_gym.plant.Plant` that runs them, for its own at this sampling time.
    layout
        What is shown, in which units, at which sampling time.
    range_um
        Farthest from the layout's centre (µm) that the sensor can read: what lies beyond is shown
        as the end of its range. Unlimited by default.

    Raises
    ------
    InputError
        No lane, lanes that do not fit together, or a range that is not above zero.

    Attributes
    ----------
    quantities : float64[5, B]
        What the last reset or step left, one a row: `displacement_um`, `measured_um` (without the
        end of the sensor's range), `reference_now_um`, `command_V`, `error_um`. The next step
        overwrites it.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> layout = ObservationLayout.for_plant(named_plant("P5"), ts_s=1e-3, preview=1)
    >>> task = TrackingTask(named_plant("P5"), layout)
    >>> task.reset(np.array([[0.0], [1.0], [2.0]])).shape
    (1, 4)
    >>> observation = task.step(np.array([1.0]))
    >>> task.error_um.round(3).tolist()
    [0.271]
    """

    def __init__(
        self,
        models: PlantModel | Sequence[PlantModel] | Plant,
        layout: ObservationLayout,
        range_um: float = math.inf,
    ) -> None:
        unlimited = isinstance(range_um, float) and range_um == math.inf
        if not (unlimited or (is_finite(range_um) and range_um > 0)):
            raise InputError(f"range_um is {quoted(range_um)}; give a displacement above 0 µm")
        self.layout = layout
        self.plant = models if isinstance(models, Plant) else Plant(models, layout.ts_s)
        sensors = [model.sensor for model in self.plant.models]
        self._resolution = np.array([sensor.resolution_um for sensor in sensors], dtype=np.float64)
        self._deviation = np.array([sensor.noise_um for sensor in sensors], dtype=np.float64)
        low, high = layout.command_range_V
        self._rest_V = min(max(0.0, low), high)
        self._encoder = layout.encoder(range_um)
        lanes = self.plant.lanes
        self.quantities: Array = np.zeros((5, lanes))
        self._u = np.zeros((1, lanes))
        self._shape = (lanes, layout.size)
        self._reference = self._noise = np.zeros((1, lanes))
        self._rngs: Sequence[NoiseSource] | None = None
        self._k = 0

    @property
    def lanes(self) -> int:
        """Number of lanes B."""
        return self._shape[0]

    displacement_um = _view(0, "Displacement y(k) (µm), without the sensor: a view, float64[B].")
    measured_um = _view(1, "Reading of the sensor (µm): a view, float64[B].")
    reference_now_um = _view(2, "Reference r(k) (µm): a view, float64[B].")
    command_V = _view(3, "Command u(k) (V): a view, float64[B].")
    error_um = _view(4, "Tracking error r(k) - y(k) (µm): a view, float64[B].")

    def reset(
        self, reference_um: ArrayLike, rngs: Sequence[NoiseSource] | None = None
    ) -> NDArray[np.float32]:
        """Begin new episodes, every plant at rest at the command nearest 0 V of the range.

        Parameters
        ----------
        reference_um
            References (µm), ``(K, B)``; the last sample is held once it ends.
        rngs
            One generator a lane, for the sensor's noise; needed where a sensor has noise.

        Returns
        -------
        float32[B, D]
            The first observation, of k = 0.

        Raises
        ------
        InputError
            A reference of another shape or not finite, or noise without a generator for each lane.
        """
        reference = self._checked(reference_um)
        noisy = bool(self._deviation.any())
        if noisy and (rngs is None or len(rngs) != self.lanes):
            found = "none" if rngs is None else str(len(rngs))
            raise InputError(
                f"the sensors have noise and need {self.lanes} random generators, one a lane; {found} given"
            )
        self._reference = reference
        self._rngs = rngs if noisy else None
        self._noise = np.zeros((NOISE_BLOCK if noisy else 1, self.lanes))
        self._k = -1
        self.plant.reset(u0_V=self._rest_V)
        return self.step(self._rest_V)

    def extend(self, reference_um: ArrayLike) -> None:
        """Append samples ``(K, B)`` (µm) to the references of the running episodes.

        Raises
        ------
        InputError
            As :meth:`reset`.
        """
        self._reference = np.concatenate([self._reference, self._checked(reference_um)])

    def step(self, command_V: Array | float) -> NDArray[np.float32]:
        """Apply commands over one interval, from the last ones linearly.

        Parameters
        ----------
        command_V
            u(k+1) (V), ``(B,)``, finite; not clipped here.

        Returns
        -------
        float32[B, D]
            The observation of k + 1, a fresh array.
        """
        if isinstance(command_V, float):  # a third of the time of an assignment
            self._u.fill(command_V)
        else:
            self._u[0] = command_V
        self._k += 1
        noise_row = self._k % len(self._noise)
        if noise_row == 0 and self._rngs is not None:
            for lane, rng in enumerate(self._rngs):
                self._noise[:, lane] = rng.standard_normal(NOISE_BLOCK) * self._deviation[lane]
        observation = np.empty(self._shape, np.float32)
        _show(
            self._k,
            noise_row,
            self.plant.step(self._u),
            self._u,
            self._reference,
            self._noise,
            self._resolution,
            self._encoder,
            self.quantities,
            observation,
        )
        return observation

    def _checked(self, reference_um: ArrayLike) -> Array:
        try:
            reference = np.ascontiguousarray(reference_um, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(
                f"the reference is {quoted(reference_um)}; give displacements (µm)"
            ) from None
        if reference.ndim != 2 or len(reference) == 0 or reference.shape[1] != self.lanes:
            raise InputError(
                f"a reference of shape {reference.shape} for {self.lanes} lanes; give (samples, {self.lanes})"
            )
        if not np.isfinite(reference).all():
            sample, lane = np.argwhere(~np.isfinite(reference))[0]
            raise InputError(
                f"sample {sample} of the reference of lane {lane} is {reference[sample, lane]}; give finite displacements (µm)"
            )
        return reference
