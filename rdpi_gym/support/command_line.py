"""Options of commands beside `rdpi`, of benchmarks and studies: read, checked and refused alike."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import NoReturn

from rdpi_gym.support.command import run_command
from rdpi_gym.support.errors import InputError


def check_folder(folder: Path, option: str = "--out") -> Path:
    """Return a folder that results can be written to, or refuse it before anything is computed.

    Nothing is made: where it does not exist yet, the folder that it would be made in counts.
    """
    try:
        # a link that leads nowhere is in the way too
        places = (folder, *folder.parents)
        there = next(each for each in places if each.is_symlink() or each.exists())
        if not there.is_dir():
            raise InputError(
                f"{option} {folder} cannot be written: {there} is a file; give a folder"
            )
        with TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise InputError(
            f"{option} {folder} cannot be written ({error.strerror}); name a new or an existing folder"
        ) from error
    return folder


def check_jobs(jobs: int) -> int:
    """Return the number of processes, or refuse it."""
    if jobs == 0 or jobs < -1:
        raise InputError(f"--jobs is {jobs}; give the number of processes, or -1 for all cores")
    return jobs


class Options(argparse.ArgumentParser):
    """Options of a command, those that most have among them.

    Parameters
    ----------
    name
        Of the command: what its error lines begin with.
    description
        Its module's docstring.
    out
        Default of ``--out``; None: without.
    seed
        Default of ``--seed``; None: without.
    jobs
        Default of ``--jobs``; None: without.
    ray
        With ``--ray``.

    Examples
    --------
    >>> options = Options("speed", "How fast it is.", out=Path("results"), jobs=2)
    >>> options.add_number("--rounds", 9, "of timing")
    >>> options.read(["--rounds", "3"]).rounds
    3
    >>> options.read(["--jobs", "0"])
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: --jobs is 0; give the number of processes, or -1 for all cores
    """

    def __init__(
        self,
        name: str,
        description: str | None,
        *,
        out: Path | None = None,
        seed: int | None = None,
        jobs: int | None = None,
        ray: bool = False,
    ) -> None:
        super().__init__(
            prog=name,
            description=description,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        self._folders: list[str] = []
        self._least: dict[str, int] = {}
        if out is not None:
            self.add_folder("--out", out, "folder that results are written to")
        if seed is not None:
            self.add_number("--seed", seed, "of every random draw", least=0)
        if jobs is not None:
            self.add_argument("--jobs", type=int, default=jobs, help="processes; -1: one a core")
        if ray:
            self.add_argument(
                "--ray", metavar="ADDRESS", help="a Ray cluster, host:port, in place of --jobs"
            )

    def add_folder(self, option: str, default: Path | None, meaning: str) -> None:
        """Add a folder that is written to."""
        self.add_argument(option, type=Path, default=default, metavar="DIR", help=meaning)
        self._folders.append(option)

    def add_number(self, option: str, default: int | None, meaning: str, least: int = 1) -> None:
        """Add a whole number that is not below `least`."""
        self.add_argument(option, type=int, default=default, help=meaning)
        self._least[option] = least

    def read(self, arguments: Sequence[str] | None = None) -> argparse.Namespace:
        """Read the words after the command, or those of the process."""
        given = self.parse_args(arguments)
        for option in self._folders:
            folder = getattr(given, _attribute(option))
            if folder is not None:
                check_folder(folder, option)
        for option, least in self._least.items():
            number = getattr(given, _attribute(option))
            if number is not None and number < least:
                raise InputError(f"{option} is {number}; give {least} or more")
        if hasattr(given, "jobs"):
            check_jobs(given.jobs)
        return given

    def run(
        self,
        arguments: Sequence[str] | None,
        command: Callable[[argparse.Namespace], int | None],
    ) -> int:
        """Read the options and run the command, as :func:`~rdpi_gym.support.command.run_command`."""
        return run_command(self.prog, lambda: command(self.read(arguments)))

    def error(self, message: str) -> NoReturn:
        """Refuse in one line, as every command does."""
        raise InputError(f"{message}; --help lists the options")


def _attribute(option: str) -> str:
    return option.lstrip("-").replace("-", "_")
