"""Records to CSV files that `load` reads back."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np

from rdpi_gym.measurement.options import COLUMNS
from rdpi_gym.measurement.record import Record
from rdpi_gym.support.files import write_atomic


def other_name(name: str) -> str:
    """Name the column of a further input so that it is none of the others.

    Examples
    --------
    >>> other_name("u2"), other_name("y")
    ('u2', 'other_y')
    """
    return f"other_{name}" if name in COLUMNS else name


def write_csv(record: Record, path: Path | str) -> Path:
    """Write a record as CSV, fifteen digits a value, whole or not at all.

    Parameters
    ----------
    record
        What to write: t (s), u (V), y (µm), and reference (µm), temperature (°C), period and further
        inputs where it has them. Role, mask and note belong into a ``dataset.toml``.
    path
        Where to write.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    InputError
        The folder cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> t = np.arange(40) * 5e-3
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = write_csv(Record("run", t, t, 8 * t, ts_s=5e-3), Path(folder) / "run.csv")
    ...     path.read_text().splitlines()[:3]
    ['t,u,y', '0,0,0', '0.005,0.005,0.04']
    """
    columns = {
        "t": record.t_s,
        "u": record.u_V,
        "y": record.y_um,
        "reference": record.reference_um,
        "temperature": record.temperature_C,
        "period": record.period,
    }
    for name, values in record.others.items():
        columns[other_name(name)] = values
    present = {name: values for name, values in columns.items() if values is not None}
    text = StringIO()
    np.savetxt(
        text,
        np.column_stack(list(present.values())),
        fmt="%.15g",
        delimiter=",",
        header=",".join(f'"{name}"' if {",", ";", " "} & set(name) else name for name in present),
        comments="",
    )
    return write_atomic(path, text.getvalue())
