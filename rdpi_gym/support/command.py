"""Run of a command: status 0, or one line and its status, never a traceback; Ctrl-C in one line."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, TextIO

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
