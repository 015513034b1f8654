"""Folders that are whole or absent: filled under a temporary name, then exchanged for the old."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import sync_folder
from rdpi_gym.support.temporaries import remains, temporary, writing

# In a temporary folder: what is being filled, and what was replaced.
_NEW, _OLD = "new", "old"
_AT_WORKING_FOLDER, _EXCHANGE = -100, 2


@contextmanager
def replaced_folder(target: Path) -> Iterator[Path]:
    """Give an empty folder to fill, which takes the target's place when nothing went wrong.

    Linux exchanges two folders in one step, and no reader ever finds none. Elsewhere it takes two
    renames; who asks :func:`settled_folder` before reading finds the old or the new one whole, and
    a kill between the two is made good there.
    """
    target = target.absolute()
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        settled_folder(target)
        # where the second rename fails and the first cannot be undone, the next access finishes it
        with temporary(target, True, lambda place: _is_between(place, target)) as place:
            fresh = place / _NEW
            fresh.mkdir()
            yield fresh
            _sync(fresh)
            if not target.exists():
                fresh.rename(target)
            elif not _exchange(fresh, target):
                _rename_both(fresh, target, place / _OLD)
            sync_folder(target.parent)


def settled_folder(target: Path) -> Path:
    """Finish what a writer left that was killed between two renames, and return the folder."""
    if target.exists():
        return target
    for place in remains(target.parent, target.name):
        fresh = place / _NEW
        if _is_between(place, target):
            try:
                fresh.rename(target)
            except OSError:
                return target if target.exists() else fresh
    return target


def _is_between(place: Path, target: Path) -> bool:
    """Whether one of two renames is done; the new folder is whole before the old one is moved."""
    return (place / _OLD).exists() and (place / _NEW).exists() and not target.exists()


def _rename_both(fresh: Path, target: Path, old: Path) -> None:
    try:
        target.rename(old)
        fresh.rename(target)
    except BaseException as error:
        settled = target.exists() and not fresh.exists()  # by a reader, meanwhile
        if not settled and not target.exists():
            old.rename(target)
        if not (settled and isinstance(error, FileNotFoundError)):
            raise


def _sync(folder: Path) -> None:
    """Put a folder and all that is in it on the disk."""
    for path in folder.rglob("*"):
        if path.is_dir():
            sync_folder(path)
        else:
            handle = os.open(path, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
    sync_folder(folder)


def _exchange(one: Path, other: Path) -> bool:
    """Let two folders change places in one step; False where the system cannot."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError):  # a C library without it
        return False
    paths = (os.fsencode(one), os.fsencode(other))
    done: int = rename(_AT_WORKING_FOLDER, paths[0], _AT_WORKING_FOLDER, paths[1], _EXCHANGE)
    return done == 0  # a file system that knows no exchange refuses, and the two renames follow


def check_plain(folders: Iterable[Path]) -> None:
    """Refuse folders from somebody else that lead elsewhere: each holds folders and regular files alone."""
    for folder in folders:
        try:
            entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise InputError(f"{folder} cannot be read ({error.strerror})") from error
        for entry in entries:
            if not (entry.is_file(follow_symlinks=False) or entry.is_dir(follow_symlinks=False)):
                raise InputError(
                    f"{entry.path} is a link or no regular file; this folder may hold neither: remove it"
                )
