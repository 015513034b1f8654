"""Fuzz the readers of files: ``python -m tests.fuzz [READER ...] [--cases N] [--seed S] [--case K]``.

Case K of a reader and a seed is always the same file. A reader gives a value, or one line of
InputError under 400 characters, within 10 s and 256 MiB beyond what the process had and twice the
file; anything else ends with status 1 and the command that repeats the case.

``--structured`` takes the readers whose documents are attacked integer by integer, key by key and
type by type, and ``--all`` every attack there is, each once.
"""

from __future__ import annotations

import argparse
import json
import sys

from tests.fuzz.readers import DAMAGED, STRUCTURED, subject
from tests.fuzz.running import run, watched


def main() -> int:
    known = {**DAMAGED, **STRUCTURED}
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument(
        "reader", nargs="*", help=f"of {', '.join(known)}; those of the kind by default"
    )
    parser.add_argument("--cases", type=int, help="in all, or of one reader")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--case", type=int, help="this one alone")
    parser.add_argument("--inside", type=json.loads, help="jobs that are run in this process")
    parser.add_argument("--structured", action="store_true", help="attacks on structure")
    parser.add_argument("--all", action="store_true", help="every attack on structure, once")
    asked = parser.parse_args()
    if asked.inside:
        jobs = [run(name, asked.seed, range(*ends)) for name, *ends in asked.inside]
        return max(jobs)
    names = asked.reader or list(STRUCTURED if asked.structured or asked.all else DAMAGED)
    if unknown := [name for name in names if name not in known]:
        parser.error(f"{unknown[0]} is no reader; they are {', '.join(known)}")
    status, whole = 0, sum(known[name] for name in names)
    for name in names:
        count = asked.cases if asked.cases and asked.reader else known[name]
        if asked.cases and not asked.reader:
            count = max(1, round(asked.cases * known[name] / whole))
        if asked.all:
            with subject(name) as made:
                count = made.count
        cases = range(count) if asked.case is None else range(asked.case, asked.case + 1)
        status |= watched(asked.seed, [(name, cases)])
    return 1 if status else 0


if __name__ == "__main__":
    sys.exit(main())
