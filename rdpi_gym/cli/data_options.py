"""DATA and its options, shared by every subcommand that reads a measurement."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from rdpi_gym.support.errors import InputError

if TYPE_CHECKING:
    from rdpi_gym.measurement import DataOptions


def data_path(text: str) -> Path:
    """Return the path that the word DATA is; an empty one is not the current folder.

    Raises
    ------
    InputError
        The word is empty, as a variable of the shell is that was never set.

    Examples
    --------
    >>> data_path("run.csv").suffix
    '.csv'
    """
    if not text:
        raise InputError("DATA is empty; give a data file or a folder of data files")
    return Path(text)


DataArgument: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="DATA",
        parser=data_path,
        help="A data file (.csv, .txt, .dat, .tsv, .mat, .npz), or a folder of them.",
        show_default=False,
    ),
]
ColumnsOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--columns",
        metavar="t=NAME,...",
        help="Header names, or zero-based positions, of t, u, y, reference, temperature, period.",
    ),
]
UnitsOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--units",
        metavar="y=UNIT,...",
        help="Units in the file: s, ms, us; V, mV, kV; m, mm, um, nm. By default s, V, um.",
    ),
]
SamplingTimeOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--sampling-time", metavar="SECONDS", help="Sampling time of records without time column."
    ),
]
ValidateOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--validate",
        metavar="PATTERN",
        help="Records for validation, as in 'run3*'; by default those named validation..., "
        "else the last quarter of each.",
    ),
]
SkipOption: TypeAlias = Annotated[
    float | None,
    typer.Option("--skip", metavar="SECONDS", help="Left out at the start of each record."),
]


def data_options(
    columns: str | None = None,
    units: str | None = None,
    sampling_time: float | None = None,
    validate: str | None = None,
    skip: float | None = None,
) -> DataOptions:
    """Turn the words of the command line into options for `rdpi_gym.measurement.load`.

    Parameters
    ----------
    columns, units
        As in ``t=time,u=voltage,y=disp`` and ``y=m``.
    sampling_time, skip
        Seconds.
    validate
        Pattern of record names.

    Raises
    ------
    InputError
        Unknown columns or units, times out of range.

    Examples
    --------
    >>> data_options(columns="u=voltage", units="y=nm", skip=1.0).units
    {'y': 'nm'}
    """
    from rdpi_gym.measurement import DataOptions, parse_columns, parse_units

    return DataOptions(
        columns={} if columns is None else parse_columns(columns),
        units={} if units is None else parse_units(units),
        sampling_time_s=sampling_time,
        validate=validate,
        skip_s=skip,
    )
