"""A worker process of the laboratory, as :class:`rdpi_gym.laboratory.work.Worker` starts it."""

from __future__ import annotations

import os
import sys

from rdpi_gym.laboratory.work import end_with_parent, serve


def main(helpers: int | None) -> None:
    """Do tasks from standard input until there are no more."""
    end_with_parent()
    # what a library prints is no message
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    if helpers is not None:
        from rdpi_gym.laboratory.jobs import warm_helpers, warm_up

        warm_up()
        if helpers > 1:
            warm_helpers(helpers)
    serve(sys.stdin.buffer, answers)
