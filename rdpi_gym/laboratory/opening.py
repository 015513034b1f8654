"""Start of the laboratory from the command line and from a notebook."""

from __future__ import annotations

import asyncio
import contextlib
import tempfile
import threading
import time
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from rdpi_gym import face, measurement
from rdpi_gym.support.checks import checked
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import exists

if TYPE_CHECKING:
    from types import ModuleType

    from rdpi_gym.laboratory.server import Server

_PATIENCE_S = 10.0


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
    sources: list[Path] = []
    written = tempfile.TemporaryDirectory(prefix="rdpi-lab-")  # it lasts as long as `stop`
    if isinstance(data, measurement.Dataset):
        sources = [face.Dataset.of(data).write(Path(written.name) / "data")]
    elif data is not None:
        sources = [_existing(Path(data))]
    serving = _serving()
    place = serving.bind(port)
    folder = session_folder(session)
    server: Server = serving.Server(place, folder, sources)
    thread = serving.in_thread(server)

    def stop() -> None:
        server.stop()
        thread.join(_PATIENCE_S)
        written.cleanup()

    if browser:
        webbrowser.open(place.first_address)
    return OpenLab(place.address, folder, stop)


def serve(
    sources: Sequence[Path], port: int, browser: bool, session: PathLike[str] | str | None
) -> None:
    """Open the laboratory and serve it until the process is interrupted."""
    existing = [_existing(source) for source in sources]
    serving = _serving()
    place = serving.bind(port)
    folder = session_folder(session)
    server = serving.Server(place, folder, existing)
    print(f"The laboratory is at {place.address}", f"Its session is kept in {folder}", sep="\n")
    print("Ctrl-C ends it; nothing is lost.", flush=True)
    if browser:
        threading.Thread(target=webbrowser.open, args=(place.first_address,), daemon=True).start()
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(server.run())


def session_folder(session: PathLike[str] | str | None) -> Path:
    """Return the folder of a session, made where it is not there."""
    from rdpi_gym.laboratory.session import JOURNAL, read_journal

    folder = Path(time.strftime("rdpi-lab-%Y%m%d-%H%M%S") if session is None else session)
    if exists(folder) and folder.is_file():
        raise InputError(f"--session {folder} is a file; give a folder")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / JOURNAL).exists():
        raise InputError(
            f"--session {folder} holds no session of the laboratory; give its folder, or a new one"
        )
    for _ in read_journal(folder):  # one that is damaged is said here
        pass
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / JOURNAL).touch()
    except OSError as error:
        raise InputError(f"--session {folder} cannot be made ({error.strerror})") from error
    return folder.resolve()


def _serving() -> ModuleType:
    """Return the module of the server, which needs an extra."""
    try:
        from rdpi_gym.laboratory import server
    except ModuleNotFoundError as missing:
        raise InputError(f"{missing.name} is missing; pip install 'rdpi-gym[lab]'") from missing
    return server


def _existing(path: Path) -> Path:
    if not exists(path):
        raise InputError(f"{path} does not exist; give a data file or a folder of data files")
    return path
