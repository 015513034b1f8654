"""Options that several subcommands share; those of a measurement are in `data_options`."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryFile
from typing import Annotated, Any, TypeAlias

import typer

from rdpi_gym.support.errors import InputError


def check_folder(out: Path) -> Path:
    """Return a folder that results can be written to, or refuse it before anything is computed.

    Nothing is made: where it does not exist yet, the folder that it would be made in counts.

    Raises
    ------
    InputError
        It is a file, or cannot be written to.

    Examples
    --------
    >>> check_folder(Path("results/new")).name
    'new'
    """
    try:
        there = next(folder for folder in (out, *out.parents) if folder.exists())
        if not there.is_dir():
            raise InputError(f"--out {out} cannot be written: {there} is a file; give a folder")
        with TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise InputError(
            f"--out {out} cannot be written ({error.strerror}); name a new or an existing folder"
        ) from error
    return out


def check_jobs(jobs: int) -> int:
    """Return the number of processes, or refuse it.

    Raises
    ------
    InputError
        0, or below -1.

    Examples
    --------
    >>> check_jobs(2)
    2
    """
    if jobs == 0 or jobs < -1:
        raise InputError(f"--jobs is {jobs}; give the number of processes, or -1 for all cores")
    return jobs


def words(text: str | None) -> list[str] | None:
    """Return the words of a list as a command line has it, blank ones left out.

    Examples
    --------
    >>> words("sine, triangle,"), words(None)
    (['sine', 'triangle'], None)
    """
    if text is None:
        return None
    return [word.strip() for word in text.split(",") if word.strip()]


def model_option(meaning: str) -> Any:
    """Return the option ``--model M`` of a command.

    Parameters
    ----------
    meaning
        Its help: what the command takes for a model, and does with it.

    Examples
    --------
    >>> model_option("A plant's name.").metavar
    'M'
    """
    return typer.Option("--model", metavar="M", help=meaning, show_default=False)


OutOption: TypeAlias = Annotated[
    Path,
    typer.Option(
        "--out",
        metavar="DIR",
        help="Folder that the results are written to.",
        callback=check_folder,
    ),
]
SeedOption: TypeAlias = Annotated[
    int, typer.Option("--seed", min=0, help="Seed of every random draw.")
]
JobsOption: TypeAlias = Annotated[
    int,
    typer.Option(
        "--jobs",
        help="Processes that refit candidates; -1: one for each core.",
        callback=check_jobs,
    ),
]
EffectOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="MODULE:CLASS",
        help="An effect of your own, tried beside the catalogue; may be repeated.",
    ),
]
