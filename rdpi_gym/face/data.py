"""`load`, `simulate`: measured and simulated records, and the data set that shows itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from rdpi_gym import measurement
from rdpi_gym.face.display import DisplayMixin
from rdpi_gym.measurement import DataOptions
from rdpi_gym.support.checks import check_type
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.options import with_options
from rdpi_gym.support.words import quoted, some

if TYPE_CHECKING:
    import pandas as pd

    from rdpi_gym.report.chart import Chart

_NOTE = "    note: "  # what the experimenter wrote is long, and stands on the page


@dataclass(frozen=True, eq=False, repr=False)
class Dataset(DisplayMixin, measurement.Dataset):
    """Records of one stage, as :func:`rdpi_gym.load` reads them.

    Everything that :class:`rdpi_gym.measurement.Dataset` is, and it shows itself.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", seed=1, ts_factor=4.0)
    >>> print(repr(data).splitlines()[0])
    simulated records of P5: 16 records, 34,500 samples; 10 to fit, 5 to validate on, 1 at rest
    """

    saved_as: ClassVar[str] = "dataset"

    @property
    def summary(self) -> str:
        """Number of records and samples, and their use."""
        samples = sum(record.t_s.size for record in self.records)
        fitted, judged = len(self.train), len(self.validation)
        split = (
            "a quarter of each to validate on"
            if self.holds_out_quarters
            else f"{judged} to validate on"
        )
        parts = [f"{fitted} to fit", split]
        parts += [f"{len(self.test)} to test on"] if self.test else []
        parts += [f"{len(self.quiet)} at rest"] if self.quiet else []
        count = "1 record" if len(self.records) == 1 else f"{len(self.records)} records"
        return f"{self.title}: {count}, {samples:,} samples; {', '.join(parts)}"

    def _lines(self) -> Sequence[str]:
        described = self.quantities.said(self.describe(), self._names()).splitlines()[1:]
        return [self.summary, *(line for line in described if not line.startswith(_NOTE))]

    def to_dataframe(self) -> pd.DataFrame:
        """Return every sample of every record, one below the other.

        Returns
        -------
        DataFrame
            ``record``, ``role``, ``t_s`` (s), ``u_V`` (V), ``y_um`` (µm), and ``counted``: whether
            the sample counts in an error.
        """
        import pandas as pd

        return pd.concat(
            [
                pd.DataFrame(
                    {
                        "record": r.name,
                        "role": "quiet" if r.is_quiet else r.role,
                        "t_s": r.t_s,
                        "u_V": r.u_V,
                        "y_um": r.y_um,
                        "counted": r.error_mask,
                    }
                )
                for r in self.records
            ],
            ignore_index=True,
        )

    def overview(self) -> pd.DataFrame:
        """Return the records, one a row: samples, sampling time, duration, ranges."""
        import pandas as pd

        table = pd.DataFrame(
            [
                {
                    "record": r.name,
                    "role": "quiet" if r.is_quiet else r.role,
                    "samples": r.t_s.size,
                    "Ts (s)": r.ts_s,
                    "duration (s)": float(r.t_s[-1] - r.t_s[0]),
                    "{input_symbol} ({input_unit})": f"{np.min(r.u_V):.4g} to {np.max(r.u_V):.4g}",
                    "{output_symbol} ({output_unit})": f"{r.y_range_um[0]:.4g} to {r.y_range_um[1]:.4g}",
                }
                for r in self.records
            ]
        )
        return self._table_in_units(table)

    def _names(self) -> Sequence[str]:
        notes = (record.note for record in self.records)
        return (self.title, self.quantities.words, *(r.name for r in self.records), *notes)

    def _chart(self) -> Chart:
        from rdpi_gym.report.result_pages import records_chart

        return records_chart(self.records)

    def page(self, path: Path | str) -> Path:
        """Write a page with the records over time and as loops.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        from rdpi_gym.report.result_pages import write_data_page

        return write_data_page(path, self)

    def select(self, *patterns: str) -> Self:
        """Return a data set of some of the records.

        Parameters
        ----------
        *patterns
            Names of records, or patterns of names as in ``"validation-*"``.

        Raises
        ------
        InputError
            A pattern matches no record.

        Examples
        --------
        >>> import rdpi_gym as rg
        >>> data = rg.simulate("P5", seed=1, ts_factor=4.0)
        >>> [record.name for record in data.select("stairs", "sine-50*").records]
        ['sine-50hz', 'stairs']
        """
        names = [record.name for record in self.records]
        for pattern in patterns:
            check_type(pattern, str, "select: pattern")
            if not any(fnmatchcase(name, pattern) for name in names):
                raise InputError(f"no record is named {quoted(pattern)}; there are {some(names)}")
        kept = [r for r in self.records if any(fnmatchcase(r.name, p) for p in patterns)]
        return replace(self, records=tuple(kept))

    def write(self, folder: Path | str) -> Path:
        """Write the records as CSV files with a ``dataset.toml``, which :func:`load` reads back.

        Parameters
        ----------
        folder
            New, empty, or holding an earlier version of the same records.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        InputError
            The folder holds something else, or cannot be written.
        """
        from rdpi_gym.virtual_lab import write_dataset

        write_dataset(self, Path(folder), "Written by rdpi-gym.")
        return Path(folder)


def as_dataset(data: measurement.Dataset | PathLike[str] | str) -> Dataset:
    """Return a data set that shows itself: as it is, or read from a path."""
    if isinstance(data, Dataset):
        return data
    found = data if isinstance(data, measurement.Dataset) else measurement.load(Path(data))
    return Dataset.of(found)


@contextmanager
def in_words_of(data: measurement.Dataset) -> Iterator[None]:
    """Turn the line of an error that is raised within into the quantities of a data set.

    Examples
    --------
    >>> force = measurement.Quantities(output=measurement.Quantity("force", "F", "kN"))
    >>> with in_words_of(measurement.Dataset("a damper", (), quantities=force)):
    ...     raise InputError("the displacement never changes: it is 3 µm")
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: the force never changes: it is 3 kN
    """
    try:
        yield
    except InputError as error:
        if data.quantities.are_standard:
            raise
        names = (data.title, *(record.name for record in data.records))
        raise InputError(data.quantities.said(str(error), names)) from error


@with_options(DataOptions)
def load(
    path: PathLike[str] | str | Sequence[PathLike[str] | str], options: DataOptions
) -> Dataset:
    r"""Read a measurement: one file, or a folder in which every data file is a record.

    Text (``.csv``, ``.txt``, ``.dat``, ``.tsv``, each also ``.gz``), MATLAB (``.mat``) and NumPy
    (``.npz``) files hold ``t`` (s), ``u`` (V), ``y`` (µm) and optionally ``reference`` (µm),
    ``temperature`` (°C) and ``period``.

    Parameters
    ----------
    path
        File or folder, or several of them, whose records make one data set.
    columns
        Header name, or position from 0 on, of each column that has another name:
        ``{"u": "voltage", "y": 2}``.
    input
        Name of the column that is the input, where a file has several; the others are kept.
    units
        Units in the file where they are not s, V and µm: ``{"t": "ms", "y": "nm"}``. One of another
        quantity, as ``"kN"``, is not converted but shown.
    sampling_time_s
        Sampling time (s) of records without a time column, or whose times are rounded.
    validate
        Pattern of the names of validation records, as in ``"run3*"``; by default those named
        ``validation...``, else a quarter of each record, in blocks.
    skip_s
        Seconds at the start of each record that are simulated and left out of the error.

    Returns
    -------
    Dataset
        It prints itself: records, samples, rates, roles.

    Raises
    ------
    InputError
        Whatever is wrong, with file, line and column.

    Examples
    --------
    >>> import tempfile
    >>> import rdpi_gym as rg
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "run.csv"
    ...     _ = path.write_text("u,y\n" + "".join(f"{k},{8 * k}\n" for k in range(40)))
    ...     rg.load(path, sampling_time_s=5e-3)
    run.csv: 1 record, 40 samples; 1 to fit, a quarter of each to validate on
      run (train): 40 samples, 0.005 s apart, t = 0 to 0.195 s
      no validation record: a quarter of each record, in blocks, is held out for validation
      no unit is given for u, y: taken as V, µm; --units u=UNIT,y=UNIT gives others
    """
    check_type(path, PathLike[str] | str | Sequence[PathLike[str] | str], "load: path")
    paths = [path] if isinstance(path, str) or not isinstance(path, Sequence) else path
    # an empty text is not the current folder
    found = [each if isinstance(each, str) else Path(each) for each in paths]
    return Dataset.of(measurement.load(found, options))


def example(name: str = "picma") -> Dataset:
    """Read a measurement that ships with the package.

    Parameters
    ----------
    name
        ``picma``: voltage (V) and displacement (µm) of a PICMA P-885.91 stack in a flexure, 1 Hz sines
        and nested loops, sampled at 200 Hz; one record to fit and one to validate on.

    Returns
    -------
    Dataset
        The records, as :func:`load` reads them.

    Raises
    ------
    InputError
        No measurement of that name ships.

    Notes
    -----
    Y. N. Aye, W. T. Ang, ICSTSD 2018; repository yan9a/DiscreteBacklashOperator, MIT licence.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> rg.example("picma").summary
    'PICMA P-885.91 stack, 1 Hz, 200 Hz sampling: 2 records, 21,782 samples; 1 to fit, 1 to validate on'
    """
    check_type(name, str, "example: name")
    return Dataset.of(measurement.load(measurement.example_folder(name)))
