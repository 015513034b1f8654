"""What a fit returns: the plant, how sure each parameter is, and how far the model is off."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rdpi_gym.identification.uncertainty import Z95
from rdpi_gym.measurement import Quantities
from rdpi_gym.plant import PlantModel


@dataclass(frozen=True)
class FitResult:
    """An identified RDPI model.

    Parameters
    ----------
    plant
        The model, ready to simulate and to save; its `identification` repeats what stands here.
    parameters
        δ1 (V), δ2 (s) and the weights (µm/V): ``delta1_V``, ``delta2_s``, ``a_0`` ... ``a_n``.
    standard_errors
        Of the parameters, under the same names; infinite where the data say nothing.
    offsets_um, offset_errors_um
        Offset (µm) of each training record by name, and its standard error.
    extrema_V, extremum_errors_V
        Memory extremum (V) of each training record by name, and its standard error; the extrema
        are 0 and the errors empty where memory was not free.
    rmse_um
        Error (µm) of each record by name, one offset free; a held-out part is
        ``NAME (validation)``.
    train_rmse_um, validation_rmse_um
        Error (µm) over all training and all validation records; None without any of the latter.
    warnings
        What the data do not determine, one sentence each.
    seconds
        Time taken (s).
    evaluations
        Passes of the search over the data.
    quantities
        What was measured, by default a voltage in V and a displacement in µm; numbers named ``_V``
        and ``_um`` are in the units of its input and output.

    Examples
    --------
    >>> import numpy as np
    >>> from rdpi_gym.identification import fit
    >>> from rdpi_gym.measurement import Record
    >>> from rdpi_gym.plant import Plant, named_plant
    >>> t = np.arange(0, 0.4, 1e-4)
    >>> u = 20 * np.sin(2 * np.pi * 5 * t) + 8 * np.sin(2 * np.pi * 60 * t)
    >>> y = Plant(named_plant("P5"), 1e-4).simulate(u)
    >>> result = fit([Record("two tones", t, u, y, ts_s=1e-4)], n=5)
    >>> round(result.parameters["delta1_V"], 4)
    1.75
    """

    plant: PlantModel
    parameters: Mapping[str, float]
    standard_errors: Mapping[str, float]
    offsets_um: Mapping[str, float]
    offset_errors_um: Mapping[str, float]
    extrema_V: Mapping[str, float]
    extremum_errors_V: Mapping[str, float]
    rmse_um: Mapping[str, float]
    train_rmse_um: float
    validation_rmse_um: float | None
    warnings: tuple[str, ...]
    seconds: float
    evaluations: int
    quantities: Quantities = field(default_factory=Quantities)

    @property
    def intervals_95(self) -> dict[str, tuple[float, float]]:
        """95 % interval of each parameter, cut at 0, below which none of them lies."""
        return {
            name: interval_95(value, self.standard_errors[name], lowest=0.0)
            for name, value in self.parameters.items()
        }


def interval_95(
    value: float, standard_error: float, lowest: float = -math.inf
) -> tuple[float, float]:
    """Return the 95 % interval of a value, cut at `lowest`.

    Examples
    --------
    >>> low, high = interval_95(1.0, 1.0, lowest=0.0)
    >>> low, round(high, 4)
    (0.0, 2.96)
    """
    return max(value - Z95 * standard_error, lowest), value + Z95 * standard_error


def finite(values: Mapping[str, float]) -> dict[str, Any]:
    """Return the values with None for those that are not finite, as JSON needs them."""
    return {name: value if math.isfinite(value) else None for name, value in values.items()}
