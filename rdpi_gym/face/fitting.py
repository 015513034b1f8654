"""`fit`: from records to an identified model that shows itself."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from rdpi_gym import identification, measurement
from rdpi_gym.diagnosis.preprocessing import inspect
from rdpi_gym.face.data import as_dataset, in_words_of
from rdpi_gym.face.display import DisplayMixin
from rdpi_gym.identification import cores, interval_95, kinds
from rdpi_gym.measurement.quantities import in_output
from rdpi_gym.plant import CORES, PlantModel
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.checks import checked, unknown_name
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.words import capital, closed, joined, pm

if TYPE_CHECKING:
    import pandas as pd

    from rdpi_gym.report.chart import Chart

_SYMBOLS = {"delta1_V": ("δ1", "{input_unit}"), "delta2_s": ("δ2", "s")}


def _symbol(name: str) -> tuple[str, str]:
    """Symbol and unit of a parameter of the RDPI model."""
    return _SYMBOLS.get(name, (name, "{output_unit}/{input_divisor}"))


def _error_line(fit: identification.FitResult | cores.CoreFit) -> str:
    errors = f"{in_output(fit.train_rmse_um)} rms on the records fitted"
    if fit.validation_rmse_um is not None:
        errors = f"{in_output(fit.validation_rmse_um)} rms on validation records, {errors}"
    return f"Error {errors}."


def _parameter_table(
    rows: Iterable[tuple[str, float, float, str]], lowest: float = -math.inf
) -> pd.DataFrame:
    """Table of name, value, standard error and unit, with the 95 % interval, cut at `lowest`."""
    import pandas as pd

    heads = ["parameter", "value", "standard_error", "low", "high", "unit"]
    table = [
        (name, x, error, *interval_95(x, error, lowest), unit) for name, x, error, unit in rows
    ]
    return pd.DataFrame(table, columns=heads)


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

    def _lines(self) -> Sequence[str]:
        n = self.plant.hysteresis.n
        found = ", ".join(
            f"{symbol} = {pm(self.parameters[name], self.standard_errors[name])} {unit}"
            if math.isfinite(self.standard_errors[name])
            else f"{symbol} = {self.parameters[name]:.3g} {unit}, not determined"
            for name, (symbol, unit) in _SYMBOLS.items()
        )
        return [
            _error_line(self),
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
        return _parameter_table(
            (
                (name, value, self.standard_errors[name], self._quantities().fill(_symbol(name)[1]))
                for name, value in self.parameters.items()
            ),
            lowest=0.0,
        )

    def overview(self) -> pd.DataFrame:
        """Return parameters, offsets and extrema with their standard errors and intervals."""
        import pandas as pd

        intervals = self.intervals_95
        rows = [
            (*_symbol(name), value, self.standard_errors[name], intervals[name])
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
                    "standard error": _error(error),
                    "95 % interval": f"{low:.5g} to {high:.5g}" if math.isfinite(error) else "",
                    "unit": self._quantities().fill(unit),
                }
                for name, unit, value, error, (low, high) in rows
            ]
        )

    def _evidence(self) -> Sequence[str]:
        first = dict.fromkeys((*self.warnings[:1], *self.warnings[-1:]))
        return [self._lines()[1], *(closed(capital(warning)) for warning in first)]

    def brief(self) -> pd.DataFrame:
        """Return the weights; δ1 and δ2 stand in a sentence."""
        table = self.overview()
        return table[table["parameter"].str.startswith("a_")]

    def _chart(self) -> Chart:
        from rdpi_gym.report.result_pages import fit_chart

        return fit_chart(self)

    def page(self, path: Path | str) -> Path:
        """Write a page: parameters with their intervals, error by record, warnings.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        from rdpi_gym.report.result_pages import write_fit_page

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
        looked = inspect(dataset)
        found = identification.fit(
            looked.dataset,
            plays,
            rate_bandwidth_hz=rate_bandwidth_hz,
            free_memory=free_memory,
            name=name,
            progress=progress,
        )
    return FitResult.of(replace(found, warnings=(*found.warnings, *looked.left_out)))


@dataclass(frozen=True, eq=False, repr=False)
class CoreFit(DisplayMixin, cores.CoreFit):
    """A kind of hysteresis fitted to records; `plant` is ready to use.

    Everything that ``rdpi_gym.identification.cores.CoreFit`` is, and it shows itself.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> found = rg.fit_core(rg.simulate("P5", seed=1, ts_factor=4.0), "rdpi")
    >>> found.plant.hysteresis.name, found.to_dataframe()["parameter"].tolist()
    ('rdpi', ['delta2_s'])
    """

    saved_as: ClassVar[str] = "core"

    def _lines(self) -> Sequence[str]:
        core = self.plant.hysteresis
        gains = core.gains
        used = sum(gain != 0.0 for gain in gains)
        lines = [
            _error_line(self),
            f"{core.title[0].upper()}{core.title[1:]}: {core.equation}.",
            f"{used} of {len(gains)} gains are not zero.",
            *(f"- {warning}" for warning in self.warnings),
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
        return _parameter_table(self._rows())

    def overview(self) -> pd.DataFrame:
        """Return the numbers of the shape and the error of each record, as texts."""
        import pandas as pd

        rows = [
            (name, f"{value:.5g}", _error(error), unit) for name, value, error, unit in self._rows()
        ]
        rows += [
            (f"error of {name}", f"{value:.3g}", "", self.quantities.output.unit)
            for name, value in self.rmse_um.items()
        ]
        return pd.DataFrame(rows, columns=["what", "value", "standard error", "unit"])

    def _rows(self) -> list[tuple[str, float, float, str]]:
        """Parameters of the shape: name, value, standard error, unit."""
        units = {p.name: self.quantities.unit(p.unit) for p in self.plant.hysteresis.shape}
        errors = self.standard_errors
        return [
            (name, value, errors.get(name, math.inf), units[name])
            for name, value in self.shape.items()
        ]

    def _chart(self) -> Chart:
        from rdpi_gym.report.chart import Chart
        from rdpi_gym.report.result_pages import errors_panel

        return Chart([errors_panel(self.rmse_um)])


def _valued(effect: Effect) -> str:
    values = ", ".join(f"{name} {value:.3g}" for name, value in effect.values.items())
    return f"{effect.full_name()} ({values})"


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
        looked = inspect(dataset)
        found = cores.fit_core(looked.dataset, CORES[core], name=name, progress=progress)
    return CoreFit.of(replace(found, warnings=looked.left_out))


@dataclass(frozen=True, eq=False, repr=False)
class KindChoice(DisplayMixin, kinds.KindChoice):
    """Kinds of hysteresis fitted to the same records; `plant` is that of the kind chosen.

    Everything that ``rdpi_gym.identification.kinds.KindChoice`` is, and it shows itself.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", seed=1, ts_factor=4.0)
    >>> found = rg.choose_kind(data.select("minor-loops", "validation-loops"))
    >>> found.chosen.plant.hysteresis.name
    'rdpi'
    """

    saved_as: ClassVar[str] = "kinds"

    @property
    def plant(self) -> PlantModel[Any]:
        """The plant of the kind chosen."""
        return self.chosen.plant

    @property
    def quantities(self) -> measurement.Quantities:
        """Measured quantities and their units."""
        return self.chosen.quantities

    def _lines(self) -> Sequence[str]:
        core = self.plant.hysteresis
        others = [fit for fit in self.fits if fit.plant.hysteresis.name != core.name]
        error = in_output(self.chosen.validation_rmse_um or 0.0)
        lines = [f"Kind of hysteresis: {core.name}, the {core.title}. Error {error} rms held out."]
        apart = [fit for fit in others if fit.plant.hysteresis.name not in self.alike]
        if apart:
            nearest = apart[0]
            lines.append(
                f"The next kind, {nearest.plant.hysteresis.name}, leaves "
                f"{in_output(nearest.validation_rmse_um or 0.0)}."
            )
        if self.clockwise is not None:
            turn = "clockwise" if self.clockwise else "counter-clockwise"
            lines.append(f"The loops turn {turn}.")
        lines.append(f"Fitted beside it: {joined([_valued(e) for e in self.plant.effects])}.")
        others_alike = [name for name in self.alike if name not in self.same]
        if others_alike:
            lines.append(
                f"- Indistinguishable on these records: {joined([core.name, *others_alike])}. "
                f"{core.name} is the simplest of those that leave least. To tell them apart: {core.experiment}"
            )
        if self.same:
            lines.append(
                f"- With the numbers found, {core.name} is the same model as {joined(list(self.same))}. "
                f"What would show other numbers: {core.experiment}"
            )
        lines += [f"- {name} was not fitted: {why}" for name, why in self.refused.items()]
        if self.left_out:
            lines.append(
                "- Left out of the fits, since they begin away from rest while others begin there, or "
                f"no kind explains them as it does the others: {joined(list(self.left_out))}."
            )
        lines += [f"- {warning}" for warning in self.chosen.warnings]
        return lines

    def to_dataframe(self) -> pd.DataFrame:
        """Return the kinds, best first.

        Returns
        -------
        DataFrame
            ``kind``, ``held_out_um`` and ``fitted_um`` (rms), ``gains`` that are not zero,
            ``at_bound``.
        """
        import pandas as pd

        rows = [
            {
                "kind": fit.plant.hysteresis.name,
                "held_out_um": fit.validation_rmse_um,
                "fitted_um": fit.train_rmse_um,
                "gains": sum(gain != 0.0 for gain in fit.plant.hysteresis.gains),
                "at_bound": ", ".join(fit.at_bound),
            }
            for fit in self.fits
        ]
        return pd.DataFrame(rows)

    def overview(self) -> pd.DataFrame:
        """Return the kinds with their errors, as texts."""
        frame = self.to_dataframe()
        heads = {
            "held_out_um": "held out ({output_unit})",
            "fitted_um": "fitted ({output_unit})",
            "at_bound": "at bound",
        }
        for name in ("held_out_um", "fitted_um"):
            frame[name] = [f"{value:.3g}" for value in frame[name]]
        return self._table_in_units(frame.rename(columns=heads))

    def _chart(self) -> Chart:
        from rdpi_gym.report.chart import Chart
        from rdpi_gym.report.result_pages import errors_panel

        errors_um = {fit.plant.hysteresis.name: fit.validation_rmse_um or 0.0 for fit in self.fits}
        return Chart([errors_panel(errors_um, "RMS error, held out ({output_unit})")])


@checked
def choose_kind(
    data: measurement.Dataset | PathLike[str] | str,
    *,
    name: str = "fit",
    progress: Progress | None = None,
) -> KindChoice:
    """Fit every kind of hysteresis to measured records and choose by the held-out error.

    Parameters
    ----------
    data, name, progress
        As :func:`fit_core`.

    Returns
    -------
    KindChoice
        It prints the kind, its rivals, and what these records cannot tell apart; its `plant` is the
        model.

    Raises
    ------
    InputError
        No training record whose voltage moves.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", seed=1, ts_factor=4.0)
    >>> rg.choose_kind(data.select("sine-10hz", "validation-loops")).clockwise
    False
    """
    dataset = as_dataset(data)
    with in_words_of(dataset):
        looked = inspect(dataset)
        found = kinds.choose_kind(looked.dataset, name=name, progress=progress)
        chosen = replace(found.chosen, warnings=looked.left_out)
    return KindChoice.of(found, chosen=chosen)
