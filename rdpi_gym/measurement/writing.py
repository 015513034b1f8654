"""Records to CSV files that `load` reads back."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np

from rdpi_gym.measurement.record import Record
from rdpi_gym.support.files import write_atomic


def write_csv(record: Record, path: Path | str) -> Path:
    """Write a record as CSV, fifteen digits a value, whole or not at all.

    Parameters
    ----------
    record
        What to write: t (s), u (V), y (µm), and reference (µm), temperature (°C), period where it
        has them. Role, mask and note belong into a ``dataset.toml``.
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
    present = {name: values for name, values in columns.items() if values is not None}
    text = StringIO()
    np.savetxt(
        text,
        np.column_stack(list(present.values())),
        fmt="%.15g",
        delimiter=",",
        header=",".join(present),
        comments="",
    )
    return write_atomic(path, text.getvalue())
