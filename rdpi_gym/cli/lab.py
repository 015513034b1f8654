"""`rdpi lab`: the laboratory, a page in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rdpi_gym.cli.options import data_path


def lab(
    data: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[DATA]...",
            parser=data_path,
            help="Data files or folders to begin with; without any, files are dropped on the page.",
            show_default=False,
        ),
    ] = None,
    port: int = 0,
    browser: bool = True,
    session: Path | None = None,
) -> None:
    """Open a page to compare a model with measurements, see what is missing, and add it.

    The page is served on this machine alone, at the address that is printed. What is done in it is
    kept in the folder of the session.

    Parameters
    ----------
    port : 0 to 65535
        Port of the loopback address; 0: any that is free.
    browser
        Open the page in the browser.
    session : FOLDER
        Folder that the session is kept in; one that is there goes on.
    """
    from rdpi_gym.laboratory.opening import serve

    serve(data or [], port, browser, session)
