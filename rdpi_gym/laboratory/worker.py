"""A worker process of the laboratory: ``python -m rdpi_gym.laboratory.worker [HELPERS]``."""

from __future__ import annotations

import os
import sys

from rdpi_gym.laboratory.work import end_with_parent, serve

if __name__ == "__main__":
    end_with_parent()
    # what a library prints is no message
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    if sys.argv[1:]:
        from rdpi_gym.laboratory.jobs import warm_helpers, warm_up

        warm_up()
        helpers = int(sys.argv[1])
        if helpers > 1:
            warm_helpers(helpers)
    serve(sys.stdin.buffer, answers)
