"""Temporary files and folders beside their targets, held by a lock: what nobody holds is removed.

A writer that is killed leaves its temporary behind and its lock falls; the next writer of the same
target finds it free and clears it away. Where the system keeps no such locks (Windows, some network
drives) nothing is cleared away, since nobody can tell whether its writer still lives.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rdpi_gym.support.errors import InputError

_NAME = re.compile(r"\.(?P<target>.+)\.[0-9a-f]{12}\.tmp")
_FULL = {errno.ENOSPC, errno.EDQUOT}
_ATTEMPTS = 100
FREE_SPACE = "what was written before is kept, free some space and give the same command again"


def unwritable(path: Path | str, error: OSError) -> InputError:
    """Return what a user reads where a file cannot be written."""
    reason = error.strerror or str(error)
    if is_full(error):
        return InputError(f"{path} cannot be written: the disk is full ({reason}); {FREE_SPACE}")
    return InputError(f"{path} cannot be written ({reason}); give a folder that you may write to")


def is_full(error: OSError) -> bool:
    """Whether the disk, or a user's share of it, is full."""
    return error.errno in _FULL


@contextmanager
def writing(path: Path | str) -> Iterator[None]:
    """Turn whatever the system refuses into one line that names the file."""
    try:
        yield
    except OSError as error:
        raise unwritable(path, error) from error


def lock(handle: int, wait: bool = False) -> bool:
    """Hold an open file or folder until it is closed; False where another holds it."""
    if sys.platform == "win32":
        raise OSError(errno.ENOTSUP, "no locks that end with their process")
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    return True


def is_open_at(handle: int, path: Path) -> bool:
    """Whether an open file is still the one at a path: not removed, not replaced."""
    try:
        return os.path.samestat(os.fstat(handle), path.stat(follow_symlinks=False))
    except FileNotFoundError:
        return False


@contextmanager
def temporary(
    target: Path, folder: bool = False, is_needed: Callable[[Path], bool] | None = None
) -> Iterator[Path]:
    """Make a hidden file or folder beside a target, clear earlier remains, remove it at the end."""
    clear_abandoned(target.parent, target.name)
    path, handle = _made(target, folder)
    try:
        yield path
    finally:
        with suppress(OSError):
            if is_needed is None or not is_needed(path):
                remove(path)
        if handle is not None:
            os.close(handle)


def remains(folder: Path, name: str | None = None) -> list[Path]:
    """Return the temporaries in a folder, those in use and those that killed writers left."""
    try:
        found = [(each, _NAME.fullmatch(each.name)) for each in folder.iterdir()]
    except OSError:
        return []
    return [each for each, match in found if match and name in (None, match["target"])]


def clear_abandoned(folder: Path, name: str | None = None) -> None:
    """Remove the temporaries in a folder that nobody holds, see :func:`remains`."""
    for path in remains(folder, name):
        with suppress(OSError):
            handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
            try:
                if lock(handle) and is_open_at(handle, path):
                    remove(path)
            finally:
                os.close(handle)


def remove(path: Path) -> None:
    """Remove a file, a link or a folder with all that is in it, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _made(target: Path, folder: bool) -> tuple[Path, int | None]:
    for _ in range(_ATTEMPTS):
        path = target.with_name(f".{target.name}.{secrets.token_hex(6)}.tmp")
        try:
            if folder:
                path.mkdir()
            else:  # 0o666 less the umask, as every program writes
                os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
            if sys.platform == "win32":  # no locks, and what is open cannot be renamed
                return path, None
            handle = os.open(path, os.O_RDONLY)
        except (FileExistsError, FileNotFoundError):  # the name is taken, or was cleared away
            continue
        held = True
        with suppress(OSError):  # where there are no locks, nobody clears away either
            held = lock(handle)
        if held and is_open_at(handle, path):
            return path, handle
        os.close(handle)  # another cleared it away before it was held
    raise OSError(errno.EEXIST, f"no name is free beside {target}")
