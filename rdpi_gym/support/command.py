"""Commands: their options; status 0, or one line and its status, never a traceback; Ctrl-C in one line."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from types import FrameType
from typing import Any, NoReturn, TextIO

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.guard import INTERRUPTED, REFUSED, end_at_once, say_interrupted
from rdpi_gym.support.temporaries import FREE_SPACE, is_full
from rdpi_gym.support.terminal import plain_output

_IMPORTING = "<frozen importlib._bootstrap>"


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt at an interrupt, or end the process where that would be lost.

    Afterwards interrupts are answered as before; where :func:`~rdpi_gym.support.guard.guard` was
    called before, the command is over, and no interrupt can stop it any more.
    """
    before, hook = signal.getsignal(signal.SIGINT), sys.unraisablehook
    ours = before in (signal.default_int_handler, end_at_once)
    ours = ours and threading.current_thread() is threading.main_thread()
    sys.unraisablehook = lambda what: end_at_once() if _is_interrupt(what) else hook(what)
    try:
        if ours:
            signal.signal(signal.SIGINT, _on_interrupt)
        yield
    finally:
        sys.unraisablehook = hook
        if ours:
            signal.signal(signal.SIGINT, signal.SIG_IGN if before is end_at_once else before)


@contextmanager
def uninterrupted_children() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach: who started them ends them.

    A terminal sends the signal to all of them. It is held back here meanwhile, and comes after; another
    thread of this process may receive it, so that the handler is held back too.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    received: list[int] = []
    handler = signal.getsignal(signal.SIGINT)
    held = callable(handler) and threading.current_thread() is threading.main_thread()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        if held:
            signal.signal(signal.SIGINT, lambda number, _: received.append(number))
        yield
    finally:
        if held:
            signal.signal(signal.SIGINT, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if received:
            signal.raise_signal(signal.SIGINT)


def _on_interrupt(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename == _IMPORTING:
            end_at_once()
        frame = frame.f_back
    raise KeyboardInterrupt


def _is_interrupt(what: Any) -> bool:
    return what.exc_type is not None and issubclass(what.exc_type, KeyboardInterrupt)


NO_READER = 141


def run_command(name: str, command: Callable[[], int | None]) -> int:
    """Run a command as every command of this project is run."""
    try:
        with interruptible(), plain_output():
            status = _answered(name, command)
    except KeyboardInterrupt:
        status = INTERRUPTED
    if status == INTERRUPTED:  # Typer returns it without a word
        say_interrupted(name)
    return status


def _answered(name: str, command: Callable[[], int | None]) -> int:
    try:
        status = command()
        sys.stdout.flush()
        return status or 0
    except InputError as error:
        return _refuse(name, str(error))
    except BrokenPipeError:
        _drop(sys.stdout)
        return NO_READER
    except Exception as error:
        if _was_interrupted(error):
            return INTERRUPTED
        if isinstance(error, OSError):
            return _refuse(name, _refused_by_system(error))
        # Typer's usage errors carry their own sentence and exit status.
        format_message = getattr(error, "format_message", None)
        if format_message is None:
            raise
        return _refuse(name, format_message())


def _refused_by_system(error: OSError) -> str:
    place = f" ({error.filename})" if error.filename else ""
    if is_full(error):
        return f"the disk is full{place}; {FREE_SPACE}"
    return (
        f"the system refuses{place}: {error.strerror or error}; give another path, or mend this one"
    )


def _was_interrupted(error: BaseException | None) -> bool:
    """Whether an interrupt became this error on its way, as in an extension's import."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _refuse(name: str, message: str) -> int:
    try:
        print(f"{name}: {InputError(' '.join(message.split()))}", file=sys.stderr, flush=True)
    except OSError:  # nobody reads it, or there is no room for it
        _drop(sys.stderr)
    return REFUSED


def _drop(stream: TextIO) -> None:
    """Let nothing be written to a stream that takes nothing, at the end of the process either."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


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
