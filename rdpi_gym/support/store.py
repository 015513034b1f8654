"""Resumable stores: rows of results in an append-only file, and Optuna's searches in a journal."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeAlias, TypeVar

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import BINARY, NO_LINK, read_bytes, sync_folder, write_all, write_atomic
from rdpi_gym.support.temporaries import is_open_at, lock, writing

if TYPE_CHECKING:
    from optuna import Study

NAMED_FORMAT, VERSION = "rdpi-hidden-rows", 2
Row: TypeAlias = dict[str, Any]
K = TypeVar("K", bound=Hashable)

_LARGEST = 2**31  # bytes
# a link leads to what is not ours to write, and another's file would never be seen as the one at the path
_APPEND = os.O_RDWR | os.O_APPEND | os.O_CREAT | NO_LINK | BINARY
_SUM = re.compile(rb', "sum": "([0-9a-f]{16})"\}')


def name_of(row: Row) -> str:
    """Return what a row has as ``key``."""
    name = row["key"]
    if not isinstance(name, str):
        raise TypeError(f"key is {name!r}; give text")
    return name


def check_row(
    row: Mapping[str, Any],
    texts: Iterable[str],
    numbers: Iterable[str],
    remarks: Iterable[str] = (),
) -> None:
    """See that fields hold what a run writes; check sums say nothing of who wrote a row."""
    for name in texts:
        if not isinstance(row[name], str):
            raise TypeError(f"{name} is {row[name]!r}")
    for name in numbers:
        value = row.get(name)
        if value is not None and (type(value) not in (int, float) or value < 0):
            raise TypeError(f"{name} is {value!r}")
    for name in remarks:
        if not isinstance(row.get(name), str | None):
            raise TypeError(f"{name} is {row[name]!r}")


class RowStore(Generic[K]):
    """A file of JSON lines, the first of which states the format; every row carries its check sum.

    A row is on the disk when :meth:`append` returns, and comes back as it was written or not at
    all: a line that was cut off or changed is counted as damaged, its neighbours are kept, and the
    next append leaves it out. Several processes may append to one file.

    Parameters
    ----------
    path
        The file; it is made by the first :meth:`append`.
    file_format
        What the first line says that the rows are; it enters every check sum.
    key
        What names a row; raises KeyError, TypeError or ValueError on what is none.

    Raises
    ------
    InputError
        The file is something else, or cannot be read.

    Attributes
    ----------
    rows : dict
        The rows by their keys; of two rows with one key the later counts.
    damaged : int
        Lines that were cut off or changed since they were written, and are dropped.
    unsummed : bool
        The file is of a release that wrote no check sums: no row of it is taken, and the first
        append moves it aside.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "rows.jsonl"
    ...     RowStore(path, "my-rows", name_of).append([{"key": "none/0", "verdict": "explained"}])
    ...     RowStore(path, "my-rows", name_of).rows["none/0"]["verdict"]
    'explained'
    """

    def __init__(self, path: Path, file_format: str, key: Callable[[Row], K]) -> None:
        self.path = path
        self.rows: dict[K, Row] = {}
        self.damaged = 0
        self.unsummed = False
        self._key = key
        self._format = file_format
        self._head = _text({"format": file_format, "version": VERSION}) + b"\n"
        self._read()

    def append(self, rows: Iterable[Row]) -> None:
        """Add finished rows; they are on the disk when this returns."""
        added = {self._key(row): row for row in rows}
        with writing(self.path), self._held() as handle:
            size = os.fstat(handle).st_size
            if self.damaged or self.unsummed:
                self._mend(added)
            else:
                data = b"".join(map(self._line, added.values()))
                if size == 0:
                    data = self._head + data
                elif not _ends_a_line(handle):
                    data = b"\n" + data  # what another process left half done ends here
                try:
                    write_all(handle, data)
                except OSError:
                    os.ftruncate(handle, size)
                    raise
                os.fsync(handle)
            if size == 0:
                sync_folder(self.path.parent)
        self.rows.update(added)

    def set_aside(self, is_stale: Callable[[Row], bool]) -> Path | None:
        """Move rows that no longer hold to a file of their own."""
        if not any(map(is_stale, self.rows.values())):
            return None
        with writing(self.path), self._held():
            self._read()  # with what other processes appended
            stale = {key: row for key, row in self.rows.items() if is_stale(row)}
            aside = self._free_name("stale")
            self._write(aside, stale.values())
            self.rows = {key: row for key, row in self.rows.items() if key not in stale}
            self._write(self.path, self.rows.values())
            self.damaged = 0
        return aside

    def remark(self) -> str | None:
        """Say in one sentence what of the file was not taken; None where all of it was."""
        if self.unsummed:
            return (
                f"{self.path.name} is of an earlier release and carries no check sums: its rows "
                "are computed again, and the file is kept aside."
            )
        if not self.damaged:
            return None
        what = "1 row was" if self.damaged == 1 else f"{self.damaged} rows were"
        again = "it is" if self.damaged == 1 else "they are"
        return (
            f"{what} damaged in {self.path.name}, cut off or changed since written; "
            f"{again} computed again."
        )

    def _read(self) -> None:
        if not self.path.exists():
            return
        content = read_bytes(self.path, _LARGEST)
        head, newline, rest = content.partition(b"\n")
        found = [self._parsed(line) for line in rest.split(b"\n") if line]
        rows = dict(pair for pair in found if pair is not None)
        # an interruption may have torn the very first line, a fault of the disk changed it
        is_torn = not newline and self._head.startswith(head)
        is_head = head + newline == self._head
        self.unsummed = head == _text({"format": self._format, "version": 1})
        if not (is_head or is_torn or rows or self.unsummed):
            raise InputError(
                f"{self.path} is not a file of rows that this release wrote; give another folder, or move it away"
            )
        self.rows = {} if self.unsummed else rows
        self.damaged = 0 if self.unsummed else found.count(None) + (bool(head) and not is_head)

    def _parsed(self, line: bytes) -> tuple[K, Row] | None:
        """Return a row as it was written, or nothing."""
        stated = _SUM.search(line, max(0, len(line) - 30))
        if stated is None or stated.end() != len(line):
            return None
        text = line[: stated.start()] + b"}"
        if self._sum(text) != stated[1]:
            return None
        try:
            row = json.loads(text)
            return self._key(row), row
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError):
            return None

    def _line(self, row: Row) -> bytes:
        text = _text(row)
        return text[:-1] + b', "sum": "' + self._sum(text) + b'"}\n'

    def _sum(self, text: bytes) -> bytes:
        return hashlib.sha256(self._format.encode() + b"\n" + text).hexdigest()[:16].encode()

    @contextmanager
    def _held(self) -> Iterator[int]:
        """Open the file, make it if need be, and keep other processes from writing to it."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        while True:
            handle = os.open(self.path, _APPEND, 0o666)
            try:
                with suppress(OSError):  # a file system without locks: one process at a time
                    lock(handle, wait=True)
                if is_open_at(handle, self.path):  # else another replaced it meanwhile
                    yield handle
                    return
            finally:
                os.close(handle)

    def _mend(self, added: dict[K, Row]) -> None:
        """Write the file anew without damaged lines, and with what other processes appended."""
        self._read()
        if self.unsummed:
            write_atomic(self._free_name("unsummed"), self.path.read_bytes())
        self._write(self.path, (self.rows | added).values())
        self.damaged, self.unsummed = 0, False

    def _free_name(self, why: str) -> Path:
        number = 1
        while (aside := self.path.with_name(f"{self.path.stem}-{why}-{number}.jsonl")).exists():
            number += 1
        return aside

    def _write(self, path: Path, rows: Iterable[Row]) -> None:
        write_atomic(path, self._head + b"".join(map(self._line, rows)))


def named_rows(path: Path, file_format: str = NAMED_FORMAT) -> RowStore[str]:
    """Return a store of rows that say as ``key`` what they are called."""
    return RowStore(path, file_format, name_of)


def _text(row: Row) -> bytes:
    # a lone surrogate, in names of files, becomes the escape that JSON has for it
    return json.dumps(row, ensure_ascii=False).encode(errors="backslashreplace")


def _ends_a_line(handle: int) -> bool:
    os.lseek(handle, -1, os.SEEK_END)
    return os.read(handle, 1) == b"\n"


def open_study(
    journal: Path, name: str, direction: Literal["minimize", "maximize"] = "minimize"
) -> Study:
    """Open a study in a journal, or begin it."""
    try:
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend
    except ImportError as error:
        raise InputError(f"tuning needs Optuna ({error}); install rdpi-gym[tune]") from error
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        journal.parent.mkdir(parents=True, exist_ok=True)
        storage = JournalStorage(JournalFileBackend(str(journal)))
        return optuna.create_study(
            storage=storage, study_name=name, load_if_exists=True, direction=direction
        )
    except (OSError, ValueError, KeyError) as error:
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise InputError(
            f"the search in {journal.parent} cannot be read or written ({reason})"
        ) from error
