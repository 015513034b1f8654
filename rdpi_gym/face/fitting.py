"""`fit`: from records to an identified model that shows itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

from rdpi_gym import identification, measurement
from rdpi_gym.face.data import as_dataset, in_words_of
from rdpi_gym.face.display import DisplayMixin
from rdpi_gym.identification import interval_95
from rdpi_gym.measurement.quantities import in_output
from rdpi_gym.support.checked import checked
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.words import pm

if TYPE_CHECKING:
    import pandas as pd

    from rdpi_gym.report.chart import Chart

_SYMBOLS = {"delta1_V": ("δ1", "{input_unit}"), "delta2_s": ("δ2", "s")}


@dataclass(frozen=True, eq=False, repr=False)
class FitResult(DisplayMixin, identification.FitResult):
    """An identified model, as :func:`rdpi_gym.fit` returns it; `plant` is ready to use.

    Everything that :class:`rdpi_gym.identification.FitResult` is, and it shows itself.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> model = rg.fit(rg.simulate("P5", seed=1, ts_factor=4.0), plays=5)
    >>> model.plant.name
    'fit'
    >>> model.to_dataframe()["parameter"].tolist()[:3]
    ['delta1_V', 'delta2_s', 'a_0']
    """

    saved_as: ClassVar[str] = "fit"

    @classmethod
    def of(cls, found: identification.FitResult) -> Self:
        """Return the same fit as a result that shows itself."""
        return cls(**{f.name: getattr(found, f.name) for f in fields(identification.FitResult)})

    def _lines(self) -> Sequence[str]:
        errors = f"{in_output(self.train_rmse_um)} rms on the records fitted"
        if self.validation_rmse_um is not None:
            errors = f"{in_output(self.validation_rmse_um)} rms on validation records, {errors}"
        n = self.plant.hysteresis.n
        found = ", ".join(
            f"{symbol} = {pm(self.parameters[name], self.standard_errors[name])} {unit}"
            if math.isfinite(self.standard_errors[name])
            else f"{symbol} = {self.parameters[name]:.3g} {unit}, not determined"
            for name, (symbol, unit) in _SYMBOLS.items()
        )
        return [
            f"Error {errors}.",
            f"RDPI model with {n} play operator{'s'[: n != 1]}: {found}.",
            *(f"- {warning}" for warning in self.warnings),
        ]

    def to_dataframe(self) -> pd.DataFrame:
        """Return the parameters.

        Returns
        -------
        DataFrame
            ``parameter``, ``value``, ``standard_error``, ``low`` and ``high`` of the 95 % interval,
            ``unit``; a standard error is infinite where the data do not determine the value.
        """
        import pandas as pd

        intervals = self.intervals_95
        return pd.DataFrame(
            [
                {
                    "parameter": name,
                    "value": value,
                    "standard_error": self.standard_errors[name],
                    "low": intervals[name][0],
                    "high": intervals[name][1],
                    "unit": self._quantities().fill(
                        _SYMBOLS.get(name, ("", "{output_unit}/{input_divisor}"))[1]
                    ),
                }
                for name, value in self.parameters.items()
            ]
        )

    def overview(self) -> pd.DataFrame:
        """Return parameters, offsets and extrema with their standard errors and intervals."""
        import pandas as pd

        intervals = self.intervals_95
        rows = [
            (
                *_SYMBOLS.get(name, (name, "{output_unit}/{input_divisor}")),
                value,
                self.standard_errors[name],
                intervals[name],
            )
            for name, value in self.parameters.items()
        ]
        further = (
            ("offset", "{output_unit}", self.offsets_um, self.offset_errors_um),
            ("extremum", "{input_unit}", self.extrema_V, self.extremum_errors_V),
        )
        rows += [
            (f"{what} of {name}", unit, values[name], error, interval_95(values[name], error))
            for what, unit, values, errors in further
            for name, error in errors.items()
        ]
        return pd.DataFrame(
            [
                {
                    "parameter": name,
                    "value": f"{value:.5g}",
                    "standard error": f"{error:.2g}" if math.isfinite(error) else "not determined",
                    "95 % interval": f"{low:.5g} to {high:.5g}" if math.isfinite(error) else "",
                    "unit": self._quantities().fill(unit),
                }
                for name, unit, value, error, (low, high) in rows
            ]
        )

    def _chart(self) -> Chart:
        from rdpi_gym.report.fit import fit_chart

        return fit_chart(self)

    def page(self, path: Path | str) -> Path:
        """Write a page: parameters with their intervals, error by record, warnings.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        from rdpi_gym.report.fit import write_fit_page

        return write_fit_page(path, self, self._lines(), self.to_dataframe())


@checked
def fit(
    data: measurement.Dataset | PathLike[str] | str,
    plays: int = 10,
    *,
    free_memory: bool = False,
    rate_bandwidth_hz: float | None = None,
    name: str = "fit",
    progress: Progress | None = None,
) -> FitResult:
    """Identify the RDPI model from measured records, by Equations 9 and 10.

    Parameters
    ----------
    data
        From :func:`rdpi_gym.load`, or the path of a measurement.
    plays
        Number of play operators.
    free_memory
        Whether to find, too, the extremum (V) that each record came from.
    rate_bandwidth_hz
        Cut-off (Hz) of the low-pass on the model's rate; by default the literal rate of Eq. 5.
    name
        Name of the plant.
    progress
        Called as ``progress(stage, done, total)``.

    Returns
    -------
    FitResult
        It prints the error and the parameters; its `plant` is the model.

    Raises
    ------
    InputError
        No training record whose voltage moves, more parameters than samples, an argument of another
        type.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", seed=1, ts_factor=4.0)
    >>> round(rg.fit(data, plays=5).parameters["delta1_V"], 2)
    1.75
    """
    dataset = as_dataset(data)
    with in_words_of(dataset):
        found = identification.fit(
            dataset,
            plays,
            rate_bandwidth_hz=rate_bandwidth_hz,
            free_memory=free_memory,
            name=name,
            progress=progress,
        )
    return FitResult.of(found)
