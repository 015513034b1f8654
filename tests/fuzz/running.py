"""Cases one by one: a value, one line of InputError, or a finding with the command that repeats it."""

from __future__ import annotations

import faulthandler
import json
import resource
import shutil
import stat
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rdpi_gym.support.errors import InputError, printable
from tests.fuzz.readers import Case, Subject, subject

LIMIT_S, LIMIT_BYTES, LONGEST = 10.0, 2**28, 400
"""Seconds of a case, bytes beyond twice its files, and characters of a line."""
_WARM = 20
"""Cases that are read before memory is limited: imports and compilation count for no case."""
Job = tuple[str, range]
"""A reader by its name, and the numbers of its cases."""


def run_case(
    made: Subject, name: str, seed: int, case: int, folder: Path, limited: bool = False
) -> str:
    """Read one damaged file; return its kind, or a description of the finding.

    Kinds are "value", "refused" and "ended" (refused, since it ended the process that reads MATLAB
    files).
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    made.write(Case(name, seed, case), folder)
    allowed = LIMIT_BYTES + 2 * _bytes_in(folder)
    before = _memory(made.other())
    began = time.perf_counter()
    try:
        with warnings.catch_warnings(), _at_most(allowed if limited else None):
            warnings.simplefilter("error")
            made.read(folder)
        said = "value"
    except InputError as error:
        line = str(error)
        whole = line and printable(line) == line and len(line) < LONGEST
        kind = "ended" if "it ends the program that reads it" in line else "refused"
        said = kind if whole else f"a line of {len(line)} characters: {line[:1000]!r}"
        if _ran_out(error):
            said = f"it takes more than {allowed / 2**20:.0f} MiB: {line[:1000]!r}"
    except Exception:
        said = "".join(traceback.format_exc(limit=-6))
    if time.perf_counter() - began > LIMIT_S:
        said = f"it took {time.perf_counter() - began:.1f} s"
    taken = _memory(made.other(), peak=True) - before
    if limited and before and taken > allowed:
        said = f"the process that reads it takes {taken / 2**20:.0f} MiB"
    return said


def run(name: str, seed: int, cases: range) -> int:
    """Run cases in this process; print the findings, and how to repeat them."""
    counted: Counter[str] = Counter()
    parent = Path(tempfile.mkdtemp(prefix="fuzz"))
    began = time.perf_counter()
    try:
        with subject(name) as made:
            for case in range(max(_WARM, made.whole)):
                run_case(made, name, seed, case, parent / "f")
            for case in cases:
                # ends this process should a library never come back
                faulthandler.dump_traceback_later(LIMIT_S + 2.0, exit=True)
                print(f"case {name} {case}", flush=True)
                said = run_case(made, name, seed, case, parent / "f", limited=True)
                if said == "refused" and case < made.whole:
                    said = "a whole file is refused"
                if said not in ("value", "refused", "ended"):
                    print(f"WRONG {again(name, seed, case)}\n{said}", flush=True)
                    said = "wrong"
                counted[said] += 1
            faulthandler.cancel_dump_traceback_later()
    finally:
        shutil.rmtree(parent, ignore_errors=True)
    ended = f" ({counted['ended']} ended their process)" if counted["ended"] else ""
    print(
        f"DONE {name}, seed {seed}: {len(cases)} cases, {counted['value']} values, "
        f"{counted['refused'] + counted['ended']} refused{ended}, {counted['wrong']} wrong, "
        f"{time.perf_counter() - began:.0f} s"
    )
    return 1 if counted["wrong"] else 0


def _bytes_in(folder: Path) -> int:
    """Bytes that the regular files of a folder take on the disk, as a reader may double them."""
    found = (path.lstat() for path in folder.rglob("*"))
    return sum(512 * each.st_blocks for each in found if stat.S_ISREG(each.st_mode))


@contextmanager
def _at_most(more: int | None) -> Iterator[None]:
    """Let this process take so many bytes beyond what it has, where that can be said."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except OSError:
        more = None
    if more is None:
        yield
        return
    known = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + more, known[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, known)


def _memory(process: int | None, peak: bool = False) -> int:
    """Bytes that another process holds, or held at most since the last time that it was asked."""
    if process is None:
        return 0
    try:
        told = Path(f"/proc/{process}/status").read_text()
        if not peak:
            Path(f"/proc/{process}/clear_refs").write_text("5")  # the peak begins anew
    except OSError:
        return 0
    key = "VmHWM:" if peak else "VmRSS:"
    lines = [line for line in told.splitlines() if line.startswith(key)]
    return 1024 * int(lines[0].split()[1]) if lines else 0  # none: it has ended


def _ran_out(error: BaseException | None) -> bool:
    """Whether memory ran out somewhere behind an error."""
    while error is not None:
        if isinstance(error, MemoryError) or "MemoryError" in str(error):
            return True
        error = error.__cause__ or error.__context__
    return False


def again(name: str, seed: int, case: int) -> str:
    return f"python -m tests.fuzz {name} --seed {seed} --case {case}"


def watched(seed: int, jobs: Sequence[Job], command: Sequence[str] = ()) -> int:
    """Run jobs in another process, so that a crash of it is a finding and not the end.

    Returns how many of the processes that it took found something; 0 is as it should be.
    """
    command = [*(command or (sys.executable, "-m", "tests.fuzz", "--seed", str(seed)))]
    wrong = 0
    while jobs:
        told = json.dumps([(name, cases.start, cases.stop) for name, cases in jobs])
        done = subprocess.run(
            [*command, "--inside", told], capture_output=True, text=True, errors="replace"
        )
        lines = done.stdout.splitlines()
        shown = [line for line in lines if not line.startswith("case ")]
        if shown:
            print("\n".join(shown), flush=True)
        wrong += done.returncode != 0
        jobs = jobs[sum(line.startswith("DONE") for line in shown) :]
        started = [line.rpartition(" ") for line in lines if line.startswith("case ")]
        if not jobs or not started or started[-1][0] != f"case {jobs[0][0]}":
            if jobs:  # it ended before a case of the next job
                print(f"WRONG {jobs[0][0]}: {done.stderr[-3000:]}", flush=True)
                wrong += 1
            break
        name, last = jobs[0][0], int(started[-1][2])
        print(
            f"WRONG {again(name, seed, last)}\nended with {done.returncode}: {done.stderr[-3000:]}"
        )
        rest = range(last + 1, jobs[0][1].stop)
        jobs = [*([(name, rest)] if rest else []), *jobs[1:]]
    return wrong
