"""Where the published measurements are that this project is tested on; none of them ships."""

from __future__ import annotations

import os
from pathlib import Path

DATA_HINT = (
    "The measured data are published: PICMA in the GitHub repository yan9a/DiscreteBacklashOperator "
    "(Y. N. Aye, W. T. Ang, 2018), FSM in merijnfloren/fsm-benchmark-data and at "
    "nonlinearbenchmark.org, the friction damper in ARTS-Laboratory/"
    "Dataset-Friction-Damper-with-Backlash; put a copy into a folder with subfolders picma, fsm and "
    "friction_damper and let the environment variable RDPI_DATA name it"
)
"""One sentence that tells a user where the data come from and how to point the tools at them."""


def measured_data(name: str) -> Path | None:
    """Find the folder of a published measurement.

    Parameters
    ----------
    name
        ``picma``, ``fsm`` or ``friction_damper``.

    Returns
    -------
    Path or None
        The folder of that name below the one that the environment variable ``RDPI_DATA`` names;
        None where it is absent (say `DATA_HINT`).

    Examples
    --------
    >>> measured_data("no such measurement") is None
    True
    """
    data = os.environ.get("RDPI_DATA")
    folder = Path(data) / name if data else None
    return folder if folder is not None and folder.is_dir() else None
