"""`fit_core`: from records to any kind of hysteresis, that shows itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar, Self

from rdpi_gym import measurement
from rdpi_gym.face.data import as_dataset, in_words_of
from rdpi_gym.face.shown import Shown
from rdpi_gym.identification import cores, interval_95
from rdpi_gym.measurement.options import unknown_name
from rdpi_gym.plant import CORES
from rdpi_gym.support.checked import checked
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.words import joined, micrometres

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class CoreFit(Shown, cores.CoreFit):
    """A kind of hysteresis fitted to records; `plant` is ready to use.

    Everything that :class:`rdpi_gym.identification.cores.CoreFit` is, and it shows itself.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> found = rg.fit_core(rg.simulate("P5", seed=1, ts_factor=4.0), "rdpi")
    >>> found.plant.hysteresis.name, found.to_dataframe()["parameter"].tolist()
    ('rdpi', ['delta2_s'])
    """

    saved_as: ClassVar[str] = "core"

    @classmethod
    def of(cls, found: cores.CoreFit) -> Self:
        """Return the same fit as a result that shows itself."""
        return cls(**{f.name: getattr(found, f.name) for f in fields(cores.CoreFit)})

    def _lines(self) -> Sequence[str]:
        core = self.plant.hysteresis
        errors = f"{micrometres(self.train_rmse_um)} rms on the records fitted"
        if self.validation_rmse_um is not None:
            errors = f"{micrometres(self.validation_rmse_um)} rms on validation records, {errors}"
        gains = core.gains
        used = sum(gain != 0.0 for gain in gains)
        lines = [
            f"Error {errors}.",
            f"{core.title[0].upper()}{core.title[1:]}: {core.equation}.",
            f"{used} of {len(gains)} gains are not zero.",
        ]
        if self.at_bound:
            what = "stands at its bound" if len(self.at_bound) == 1 else "stand at their bounds"
            lines.append(
                f"- {joined(self.at_bound)} {what}: these records do not determine {'it' if len(self.at_bound) == 1 else 'them'}."
            )
        return lines

    def to_dataframe(self) -> pd.DataFrame:
        """Return the numbers of the shape.

        Returns
        -------
        DataFrame
            ``parameter``, ``value``, ``standard_error``, ``low`` and ``high`` of the 95 % interval,
            ``unit``; a standard error is infinite where the data do not determine the value.
        """
        import pandas as pd

        units = {p.name: p.unit for p in self.plant.hysteresis.shape}
        rows = []
        for name, value in self.shape.items():
            error = self.standard_errors.get(name, math.inf)
            low, high = interval_95(value, error)
            unit = self._said()(units[name])
            rows.append((name, value, error, low, high, unit))
        heads = ["parameter", "value", "standard_error", "low", "high", "unit"]
        return pd.DataFrame(rows, columns=heads)

    def overview(self) -> pd.DataFrame:
        """Return the numbers of the shape and the error of each record, as texts."""
        import pandas as pd

        units = {p.name: p.unit for p in self.plant.hysteresis.shape}
        errors = self.standard_errors
        rows = [
            (name, f"{value:.5g}", _error(errors.get(name, math.inf)), self._said()(units[name]))
            for name, value in self.shape.items()
        ]
        rows += [
            (f"error of {name}", f"{value:.3g}", "", self._said()("µm"))
            for name, value in self.rmse_um.items()
        ]
        return pd.DataFrame(rows, columns=["what", "value", "standard error", "unit"])

    def _names(self) -> Sequence[str]:
        return (self.plant.name, *self.rmse_um)

    def _draw(self, figure: Figure) -> Any:
        axes = figure.subplots()
        axes.barh(list(self.rmse_um), list(self.rmse_um.values()))
        axes.invert_yaxis()
        axes.set_xlabel("RMS error (µm)")
        return axes


def _error(value: float) -> str:
    return f"{value:.2g}" if math.isfinite(value) else "not determined"


@checked
def fit_core(
    data: measurement.Dataset | PathLike[str] | str,
    core: str,
    *,
    name: str = "fit",
    progress: Progress | None = None,
) -> CoreFit:
    """Fit a kind of hysteresis to measured records.

    Parameters
    ----------
    data
        From :func:`rdpi_gym.load`, or the path of a measurement.
    core
        Name of the kind: a key of :data:`rdpi_gym.plant.CORES`.
    name
        Name of the plant.
    progress
        Called as ``progress(stage, done, total)``.

    Returns
    -------
    CoreFit
        It prints the error and the numbers; its `plant` is the model.

    Raises
    ------
    InputError
        An unknown core, no training record whose voltage moves, more gains than samples.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> found = rg.fit_core(rg.simulate("P5", seed=1, ts_factor=4.0), "rdpi")
    >>> found.train_rmse_um < 0.05
    True
    """
    if core not in CORES:
        raise unknown_name("--core", core, tuple(CORES))
    dataset = as_dataset(data)
    with in_words_of(dataset):
        found = cores.fit_core(dataset, CORES[core], name=name, progress=progress)
    return CoreFit.of(found)
