"""Files that are whole or absent: written to a temporary name and renamed; versioned JSON."""

from __future__ import annotations

import ctypes
import json
import math
import os
import stat
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from io import BufferedReader
from pathlib import Path
from typing import Any, NoReturn

from rdpi_gym.support.errors import InputError, printable
from rdpi_gym.support.temporaries import remains, temporary, writing
from rdpi_gym.support.words import quoted

LARGEST_JSON = 32 * 2**20
"""Most bytes of a JSON file that is read."""
_DEEPEST = 50
_MOST_VALUES = 2**20
"""Values of a JSON document: of 3 bytes in the file, one may take 100 in memory."""
BINARY = getattr(os, "O_BINARY", 0)
"""Of Windows, where line ends would be translated."""
_NO_WAIT = getattr(os, "O_NONBLOCK", 0) | BINARY
NO_LINK = getattr(os, "O_NOFOLLOW", 0)
"""Flag of opening: a symbolic link is refused."""


def write_atomic(path: Path | str, content: str | bytes) -> Path:
    r"""Write `content` so that a reader sees the old file or the new one, never a part.

    The content is on the disk before it takes the old one's name: power may fail at any time. The
    file's rights are what the umask leaves.
    """
    target = Path(path)
    data = content.encode(errors="backslashreplace") if isinstance(content, str) else content
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        with temporary(target) as fresh:
            handle = os.open(fresh, os.O_WRONLY | BINARY)
            try:
                write_all(handle, data)
                os.fsync(handle)
            finally:
                os.close(handle)
            fresh.replace(target)
        sync_folder(target.parent)
    return target


def write_all(handle: int, data: bytes) -> None:
    """Write all bytes to an open file, in one call where the system takes them in one."""
    left = memoryview(data)
    while left:
        left = left[os.write(handle, left) :]


def sync_folder(folder: Path) -> None:
    """See to it that names given in a folder are on the disk, where the system can do that."""
    with suppress(OSError):  # Windows opens no folders, some network drives flush none
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write_json(path: Path | str, document: dict[str, Any]) -> Path:
    """Write a JSON object, indented, atomically; NaN and infinity are refused."""
    return write_atomic(
        path, json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    )


def exists(path: Path | str) -> bool:
    r"""Whether something is at a path."""
    try:
        Path(path).stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read ({_reason(error)})") from error
    return True


def open_regular(path: Path | str) -> BufferedReader:
    """Open a regular file to read its bytes; nothing else is data."""
    try:
        handle = os.open(path, os.O_RDONLY | _NO_WAIT)
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read ({_reason(error)})") from error
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise InputError(f"{path} is no regular file; give a file with data")
    return os.fdopen(handle, "rb")


def read_bytes(path: Path | str, largest: int) -> bytes:
    """Read a regular file whole."""
    with open_regular(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        if size > largest:
            raise InputError(
                f"{path} has {size / 2**20:.0f} MiB; a file of this kind has {largest / 2**20:.0f} MiB at most"
            )
        try:
            return stream.read(size)
        except OSError as error:
            raise InputError(f"{path} cannot be read ({_reason(error)})") from error


def read_utf8(path: Path | str, largest: int) -> str:
    """Read a regular file of UTF-8 text whole, with or without a byte-order mark."""
    raw = read_bytes(path, largest)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path} cannot be read as UTF-8 text (byte {error.start}); save it as UTF-8"
        ) from None


def parse_json(text: str, source: str) -> Any:
    """Read a JSON value: finite numbers, whole ones of 64 bits at most, text without control characters."""

    def refuse(token: str) -> NoReturn:
        raise InputError(f"{source}: {quoted(token)[1:-1]} is no finite number; write one")

    def whole(token: str) -> int:
        if len(token) > 20 or not -(2**63) <= (value := int(token)) < 2**63:
            raise InputError(
                f"{source}: {quoted(token)[1:-1]} is too large for a whole number; write 64 bits at most"
            )
        return value

    def real(token: str) -> float:
        value = float(token)
        return value if math.isfinite(value) else refuse(token)

    if sum(map(text.count, ",:[{")) > _MOST_VALUES:
        raise InputError(f"{source} holds more than {_MOST_VALUES} values; a document holds fewer")
    try:
        value = json.loads(text, parse_int=whole, parse_float=real, parse_constant=refuse)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{source}, line {error.lineno}, column {error.colno}: not whole JSON ({error.msg}); "
            "perhaps the file was cut off"
        ) from error
    except RecursionError:
        raise _too_deep(source) from None
    _check_content(value, source)
    return value


def read_json(
    path: Path | str, document_format: str | tuple[str, ...], version: int
) -> dict[str, Any]:
    """Read a JSON object that states its format and version."""
    source = Path(path)
    formats = (document_format,) if isinstance(document_format, str) else document_format
    document_format = " or ".join(formats)
    if not exists(source):
        raise InputError(f"{source} does not exist; give the path of a {document_format} file")
    document = parse_json(read_utf8(source, LARGEST_JSON), str(source))
    if not isinstance(document, dict) or document.get("format") not in formats:
        found = document.get("format") if isinstance(document, dict) else type(document).__name__
        raise InputError(f'{source} is not a {document_format} file: "format" is {quoted(found)}')
    found_version = document.get("version")
    if type(found_version) is not int or not 1 <= found_version <= version:
        raise InputError(
            f"{source} has version {quoted(found_version)} of {document_format}; "
            f"this release reads versions 1 to {version}"
        )
    return document


def _check_content(value: Any, source: str) -> None:
    level = [value]
    for _ in range(_DEEPEST):
        below: list[Any] = []
        for item in level:
            if isinstance(item, dict):
                below += item
                below += item.values()
            elif isinstance(item, list):
                below += item
            elif isinstance(item, str) and printable(item) != item.replace("\n", "\\n"):
                raise InputError(
                    f"{source}: text {quoted(item)} holds control characters; remove them"
                )
        if not below:
            return
        level = below
    raise _too_deep(source)


def _too_deep(source: str) -> InputError:
    return InputError(
        f"{source} is nested deeper than {_DEEPEST} levels; it was not written by this package"
    )


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


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
