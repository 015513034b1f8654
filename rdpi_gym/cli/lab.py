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
    port: Annotated[
        int,
        typer.Option(
            "--port", min=0, max=65535, help="Port of the loopback address; 0: any that is free."
        ),
    ] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")
    ] = True,
    session: Annotated[
        Path | None,
        typer.Option(
            "--session",
            metavar="FOLDER",
            help="Folder that the session is kept in; one that is there goes on.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Open a page to compare a model with measurements, see what is missing, and add it.

    The page is served on this machine alone, at the address that is printed. What is done in it is
    kept in the folder of the session.
    """
    from rdpi_gym.laboratory.opening import serve

    serve(data or [], port, browser, session)
