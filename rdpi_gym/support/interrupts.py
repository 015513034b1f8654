"""What a command does at Ctrl-C: one line, status 130, wherever it comes.

A KeyboardInterrupt inside an import ends in half-made modules and their own tracebacks, and one inside
a callback of an extension is printed and forgotten. There the process is ended on the spot: what it
wrote is whole at any time. Everywhere else the exception unwinds as usual.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from rdpi_gym.support.guard import end_at_once

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

    A terminal sends the signal to all of them. It is held back here meanwhile, and comes after.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _on_interrupt(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename == _IMPORTING:
            end_at_once()
        frame = frame.f_back
    raise KeyboardInterrupt


def _is_interrupt(what: Any) -> bool:
    return what.exc_type is not None and issubclass(what.exc_type, KeyboardInterrupt)
