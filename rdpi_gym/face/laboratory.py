"""`lab`: the laboratory, a local page, from a notebook."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from os import PathLike
from pathlib import Path

from rdpi_gym import measurement
from rdpi_gym.support.checked import checked


@dataclass(frozen=True)
class OpenLab:
    """A laboratory that runs in this process, as :func:`rdpi_gym.lab` returns it.

    Parameters
    ----------
    address
        What a browser opens.
    folder
        Of its session.
    stop
        Ends it; the session stays in its folder.
    """

    address: str
    folder: Path
    stop: Callable[[], None]

    def __repr__(self) -> str:
        """Name address and folder."""
        return f"laboratory at {self.address}, its session in {self.folder}"


@checked
def lab(
    data: measurement.Dataset | PathLike[str] | str | None = None,
    port: int = 0,
    browser: bool = True,
    session: PathLike[str] | str | None = None,
) -> OpenLab:
    """Open the laboratory: a local page to compare a model with measurements and to grow it.

    Parameters
    ----------
    data
        From :func:`rdpi_gym.load`, or the path of a measurement.
    port
        Of the loopback address; 0: any that is free.
    browser
        Whether to open the page in the browser.
    session
        Folder that the session is kept in, or goes on in; by default a new one in the working
        directory.

    Returns
    -------
    OpenLab
        Its ``address`` is that of the page; ``stop()`` ends it.

    Raises
    ------
    InputError
        The extra ``lab`` is not installed, the port is taken, the data cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> import rdpi_gym as rg
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     opened = rg.lab(browser=False, session=folder)
    ...     opened.stop()
    >>> opened.address.startswith("http://127.0.0.1:")
    True
    """
    # its room stands above this one
    opening = import_module("rdpi_gym.laboratory.opening")
    opened: OpenLab = opening.in_background(data, port, browser, session)
    return opened
