"""Compilation of kernels: which there were, for how long, and a callback as one begins or ends."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event


class Compilations(event.Listener):  # type: ignore[misc]  # numba carries no types
    """Kernels that were compiled, those inlined in others and numba's own left out."""

    def __init__(self, changed: Callable[[Compilations], None]) -> None:
        self.changed = changed
        self.kernels = 0
        self.seconds = 0.0
        self.depth = 0
        self._began = 0.0

    def on_start(self, event: Any) -> None:
        """Note that a function is being compiled."""
        if self.depth == 0:
            self._began = time.perf_counter()
            self.kernels += 1
        self.depth += 1
        if self.depth == 1:
            self.changed(self)

    def on_end(self, event: Any) -> None:
        """Note that it has been."""
        self.depth -= 1
        if self.depth == 0:
            self.seconds += time.perf_counter() - self._began
            self.changed(self)

    @property
    def title(self) -> str:
        """Line of a progress display."""
        return f"compiling, once per installation: kernel {self.kernels}, {self.seconds:.0f} s"


@contextmanager
def compilations(
    changed: Callable[[Compilations], None] = lambda found: None,
) -> Iterator[Compilations]:
    """Count what this process compiles meanwhile; `changed` is called as a kernel begins and ends."""
    found = Compilations(changed)
    with event.install_listener("numba:compile", found):
        yield found
