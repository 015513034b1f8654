"""Cases one by one: a value, one line of InputError, or a finding with the command that repeats it."""

from __future__ import annotations

import faulthandler
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
from tests.fuzz.subjects import Case, Subject, subject

LIMIT_S, LIMIT_BYTES, LONGEST = 10.0, 2**28, 400
"""Seconds of a case, bytes beyond twice its files, and characters of a line."""
_WARM = 20
"""Cases that are read before memory is limited: what is imported and compiled once is no case's."""


def run_case(
    made: Subject, name: str, seed: int, case: int, folder: Path, limited: bool = False
) -> str:
    """Read one damaged file.

    Returns
    -------
    str
        "value", "refused", "ended" (refused, since it ended the process that reads MATLAB files), or
        what is wrong.
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
    """Run cases in this process; print what is wrong, and how to repeat it."""
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
                print(f"case {case}", flush=True)
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


def watched(name: str, seed: int, cases: range, command: Sequence[str] = ()) -> int:
    """Run cases in another process, so that a crash of it is a finding and not the end.

    Returns
    -------
    int
        How many of the processes that it took found something; 0 is as it should be.
    """
    own = [sys.executable, "-m", "tests.fuzz", name, "--seed", str(seed), "--inside"]
    command = [*(command or own)]
    wrong, left = 0, cases
    while left:
        span = ["--first", str(left.start), "--cases", str(len(left))]
        done = subprocess.run(
            [*command, *span], capture_output=True, text=True, errors="replace", check=False
        )
        lines = done.stdout.splitlines()
        shown = [line for line in lines if not line.startswith("case ")]
        if shown:
            print("\n".join(shown), flush=True)
        wrong += done.returncode != 0
        started = [int(line.split()[1]) for line in lines if line.startswith("case ")]
        if any(line.startswith("DONE") for line in shown) or not started:
            if not started:
                print(done.stderr)
            break
        print(
            f"WRONG {again(name, seed, started[-1])}\nended with {done.returncode}: {done.stderr[-3000:]}",
            flush=True,
        )
        left = range(started[-1] + 1, left.stop)
    return wrong
