"""Progress of long jobs: the callback and the bar."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, runtime_checkable


@runtime_checkable
class Progress(Protocol):
    """Called now and then by whatever takes long."""

    def __call__(self, stage: str, done: int, total: int, /) -> None:
        """Report where a job stands."""


def silent(stage: str, done: int, total: int) -> None:
    """Report nothing."""


LINE_S = 10.0
"""Time (s) between two lines of one stage."""


class Lines:
    """Stages as lines on standard error, for a job whose output is kept: the first of each, then now and then."""

    def __init__(self) -> None:
        self._last, self._at_s = "", 0.0

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Report where a job stands."""
        now_s = time.monotonic()
        if stage == self._last and now_s - self._at_s < LINE_S:
            return
        self._last, self._at_s = stage, now_s
        print(f"{stage}: {done} of {total}" if total else stage, file=sys.stderr, flush=True)


@contextmanager
def progress_bar(otherwise: Progress = silent) -> Iterator[Progress]:
    """Show stages on standard error while a job runs; not on a terminal, report them otherwise."""
    if sys.stderr is None or not sys.stderr.isatty():
        yield otherwise
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    from rdpi_gym.support.compiling import Compilations, compilations
    from rdpi_gym.support.terminal import console

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Bar(*columns, console=console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)
        last = ""

        def compiled(found: Compilations) -> None:
            bar.update(task, description=found.title if found.depth else last, refresh=True)

        def show(stage: str, done: int, total: int) -> None:
            nonlocal last
            if stage != last:
                bar.reset(task)  # its own time
                last = stage
            bar.update(
                task,
                description=stage,
                completed=min(done, total) if total else done,
                total=total or None,
            )

        with compilations(compiled):
            yield show
