"""A worker process of the laboratory: ``python -m rdpi_gym.laboratory.worker [warm]``."""

from __future__ import annotations

import os
import sys

from rdpi_gym.laboratory.work import serve

if __name__ == "__main__":
    # what a library prints is no message
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    if sys.argv[1:] == ["warm"]:
        from rdpi_gym.laboratory.jobs import warm_up

        warm_up()
    serve(sys.stdin.buffer, answers)
