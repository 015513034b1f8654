"""Runs a job in forked children, each with one fault at one call that changes the disk.

A fault is a kill before the call, after it, or half-way through a write; or a disk that is full from
that call on.
"""

from __future__ import annotations

import errno
import os
import shutil
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rdpi_gym.support import files
from rdpi_gym.support.errors import InputError

KILLED, REFUSED, CRASHED = 99, 2, 70
MODES = ("killed before", "killed half-way", "killed after", "disk full", "disk full half-way")
_CALLS = ("open", "write", "fsync", "replace", "rename", "mkdir", "unlink", "rmdir", "ftruncate")
# What a full disk refuses; to remove or to shorten something it never does.
_TAKES_SPACE = ("open", "write", "fsync", "replace", "rename", "mkdir", "exchange")


@dataclass(frozen=True)
class Job:
    """A writer that is disturbed.

    `is_whole` tells of what is found, the old state and the new one whether the job passes through it.
    """

    name: str
    prepare: Callable[[Path], Any]  # makes the old state in an empty folder
    work: Callable[[Path], Any]  # goes from any state to the new one
    read: Callable[[Path], Any]  # raises on what is not whole
    is_whole: Callable[[Any, Any, Any], bool] = lambda found, old, new: found in (old, new)


class Injection:
    """Counts the calls that change the disk, and disturbs the one of number `at` (-1: none)."""

    def __init__(self, at: int, mode: str) -> None:
        self.at, self.mode, self.full = at, mode, False
        self.kinds: list[str] = []

    def install(self) -> None:
        """Disturb this process from now on."""
        for name in _CALLS:
            setattr(os, name, self._disturbed(name, getattr(os, name)))
        files._exchange = self._disturbed("exchange", files._exchange)

    def _disturbed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def disturbed(*arguments: Any, **options: Any) -> Any:
            if name == "open" and not arguments[1] & os.O_CREAT:
                return call(*arguments, **options)
            if self.full and name in _TAKES_SPACE:
                raise OSError(errno.ENOSPC, "No space left on device")
            self.kinds.append(name)
            if len(self.kinds) - 1 != self.at:
                return call(*arguments, **options)
            if self.mode == "killed before":
                os._exit(KILLED)
            if self.mode == "killed after":
                try:
                    call(*arguments, **options)
                finally:
                    os._exit(KILLED)
            if self.mode.endswith("half-way"):
                written = call(arguments[0], bytes(arguments[1])[: len(arguments[1]) // 2])
                if self.mode.startswith("killed"):
                    os._exit(KILLED)
                self.full = True
                return written
            self.full = True
            return disturbed(*arguments, **options)

        return disturbed

    def applies(self, kind: str) -> bool:
        """Whether the mode can happen to a call of this kind."""
        if self.mode.endswith("half-way"):
            return kind == "write"
        return self.mode.startswith("killed") or kind in _TAKES_SPACE


def without_waiting() -> None:
    """Let fsync return at once: a kill of a process, unlike one of the machine, loses no cache."""
    os.fsync = lambda handle: None


def disturb(job: Job, folder: Path) -> Counter[str]:
    """Run a job with every fault at every call, and count the runs by mode.

    Raises AssertionError where a state was found that is neither old nor new, a rerun ended
    otherwise, a full disk was no error of one line, or remains were left.
    """
    renew(job, folder)
    old = job.read(folder)
    job.work(folder)  # what is compiled and cached at first is there from now on
    new = job.read(folder)
    renew(job, folder)
    kinds = _calls(job, folder)
    assert kinds, f"{job.name} makes no call"
    assert old != new, f"{job.name} changes nothing"
    done: Counter[str] = Counter()
    for mode in MODES:
        for at, kind in enumerate(kinds):
            if not Injection(at, mode).applies(kind):
                continue
            where = f"{job.name}: {mode} at call {at}, {kind}"
            renew(job, folder)
            status = _in_child(job, folder, Injection(at, mode))
            # what goes wrong while remains are cleared away is no error
            expected = (KILLED,) if mode.startswith("killed") else (REFUSED, 0)
            assert status in expected, f"{where}: status {status}"
            try:
                found = job.read(folder)
            except Exception as error:
                raise AssertionError(f"{where}: {error!r}") from error
            assert job.is_whole(found, old, new), f"{where}: found {found}"
            if status == 0:
                assert found == new, f"{where}: success claimed, found {found}"
            job.work(folder)
            again = job.read(folder)
            assert again == new, f"{where}: after a rerun {again}"
            left = list(folder.rglob(".*.tmp"))
            assert not left, f"{where}: left {left}"
            done[mode] += 1
    return done


def renew(job: Job, folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    job.prepare(folder)


def _calls(job: Job, folder: Path) -> list[str]:
    """Return the kinds of the calls of an undisturbed run, made in a child."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        injection = Injection(-1, "")
        write = os.write
        injection.install()
        job.work(folder)
        kinds = injection.kinds
        write(writer, ",".join(kinds).encode())
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        kinds = pipe.read().split(",")
    assert os.waitpid(child, 0)[1] == 0
    return [kind for kind in kinds if kind]


def _in_child(job: Job, folder: Path, injection: Injection) -> int:
    child = os.fork()
    if child == 0:
        status = CRASHED
        try:
            injection.install()
            job.work(folder)
            status = 0
        except InputError as error:
            status = REFUSED if "\n" not in str(error) else CRASHED
        except BaseException as error:
            print(f"{job.name}: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
