"""`compare`: a model against measured records, as a result that shows itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from rdpi_gym import diagnosis, measurement
from rdpi_gym.face.catalogues import HasPlant, as_plant
from rdpi_gym.face.data import as_dataset, in_words_of
from rdpi_gym.face.shown import Shown
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.checked import checked

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_COLUMNS = {
    "name": "record",
    "role": "role",
    "rmse_um": "RMSE (µm)",
    "nrmse_percent": "of the stroke (%)",
    "systematic_percent": "systematic (%)",
    "max_um": "largest (µm)",
}


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Shown, diagnosis.Comparison):
    """A model's error on a data set, as :func:`rdpi_gym.compare` returns it.

    Everything that :class:`rdpi_gym.diagnosis.Comparison` is, and it shows itself.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> result = rg.compare(rg.simulate("P5", seed=1, ts_factor=4.0), "P5")
    >>> result.rmse_um() < 0.02
    True
    """

    saved_as: ClassVar[str] = "comparison"

    @classmethod
    def of(cls, found: diagnosis.Comparison) -> Self:
        """Return the same comparison as a result that shows itself."""
        return cls(**{f.name: getattr(found, f.name) for f in fields(diagnosis.Comparison)})

    def _lines(self) -> Sequence[str]:
        heads = ("overall", "far", "range", "records", "largest")
        said = [self.findings[key] for key in heads if key in self.findings]
        noticed = [check.sentence for check in self.checks if check.zone == "yes"]
        return [said[0], *(f"- {text}" for text in (*said[1:], *noticed))]

    def to_dataframe(self) -> pd.DataFrame:
        """Return the errors record by record; see :attr:`records`."""
        return self.records.copy()

    def overview(self) -> pd.DataFrame:
        """Return the errors record by record, with the columns that matter most."""
        return self._told_table(self.records[list(_COLUMNS)].rename(columns=_COLUMNS))

    def _names(self) -> Sequence[str]:
        return (self.title, self.model.name, *(trace.name for trace in self.traces))

    def _draw(self, figure: Figure) -> Any:
        from rdpi_gym.report.comparison.picture import draw_comparison

        return draw_comparison(figure, self)

    def page(self, path: Path | str) -> Path:
        """Write the page of ``rdpi compare``: every table with its figure.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        from rdpi_gym.report.comparison.page import write_compare_page

        return write_compare_page(path, self)


@checked
def compare(
    data: measurement.Dataset | PathLike[str] | str,
    model: PlantModel | HasPlant | PathLike[str] | str,
) -> Comparison:
    """Compare a model with measured records: the error taken apart, and tests without a model.

    Parameters
    ----------
    data
        From :func:`rdpi_gym.load`, or the path of a measurement.
    model
        A plant, a result that has one (of a fit, of a search), the path of a plant file, or a name
        of :data:`rdpi_gym.plants`.

    Returns
    -------
    Comparison
        It prints what it found; ``.plot()`` draws the record of the largest error.

    Raises
    ------
    InputError
        No sample counts, no such plant, an argument of another type.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", seed=1, ts_factor=4.0)
    >>> rg.compare(data, "P5").to_dataframe()["name"].nunique()
    15
    """
    dataset = as_dataset(data)
    with in_words_of(dataset):
        return Comparison.of(diagnosis.compare(dataset, as_plant(model)))
