"""Rows of results in an append-only file: an interrupted run continues where it stopped."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Hashable, Iterable
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic

NAMED_FORMAT, VERSION = "rdpi-hidden-rows", 1
Row: TypeAlias = dict[str, Any]
K = TypeVar("K", bound=Hashable)


def name_of(row: Row) -> str:
    """Return what a row has as ``key``.

    Raises
    ------
    KeyError
        It has none.
    TypeError
        It is no text.

    Examples
    --------
    >>> name_of({"key": "none/0", "verdict": "explained"})
    'none/0'
    """
    name = row["key"]
    if not isinstance(name, str):
        raise TypeError(f"key is {name!r}; give text")
    return name


class RowStore(Generic[K]):
    """A file of JSON lines, the first of which states the format; every line is whole or ignored.

    Parameters
    ----------
    path
        The file; it is made by the first :meth:`append`.
    file_format
        What the first line says that the rows are.
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
        Lines that were torn by an interruption and are dropped.

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
        self._key = key
        self._head: Row = {"format": file_format, "version": VERSION}
        if path.exists():
            self._read()

    def append(self, rows: Iterable[Row]) -> None:
        """Add finished rows; they are on the disk when this returns.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        added = {self._key(row): row for row in rows}
        lines = [_line(row) for row in added.values()]
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a", encoding="utf-8") as stream:
                if stream.tell() == 0:
                    lines.insert(0, _line(self._head))
                stream.writelines(lines)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise InputError(
                f"{self.path} cannot be written ({error.strerror}); give a folder that you may write to"
            ) from error
        self.rows.update(added)

    def set_aside(self, is_stale: Callable[[Row], bool]) -> Path | None:
        """Move rows that no longer hold to a file of their own.

        Parameters
        ----------
        is_stale
            Whether a row belongs to something that has changed since.

        Returns
        -------
        Path or None
            The file that they were moved to; None where every row still holds.
        """
        stale = {key: row for key, row in self.rows.items() if is_stale(row)}
        if not stale:
            return None
        number = 1
        while (aside := self.path.with_name(f"{self.path.stem}-stale-{number}.jsonl")).exists():
            number += 1
        self._write(aside, stale.values())
        self.rows = {key: row for key, row in self.rows.items() if key not in stale}
        self._write(self.path, self.rows.values())
        return aside

    def _read(self) -> None:
        try:
            text = self.path.read_bytes().decode("utf-8", errors="replace")
        except OSError as error:
            raise InputError(f"{self.path} cannot be read ({error.strerror})") from error
        *lines, torn = text.split("\n")
        # an interruption may have torn the very first line
        is_ours = _parse(lines[0]) == self._head if lines else _line(self._head).startswith(torn)
        if not is_ours:
            raise InputError(
                f"{self.path} is not a file of rows that this release wrote; give another folder, or move it away"
            )
        for line in lines[1:]:
            row = _parse(line)
            try:
                self.rows[self._key(row)] = row
            except (KeyError, TypeError, ValueError):
                self.damaged += 1
        self.damaged += bool(torn)
        if self.damaged:
            # the next line must not be appended to half a line
            self._write(self.path, self.rows.values())

    def _write(self, path: Path, rows: Iterable[Row]) -> None:
        write_atomic(path, "".join(_line(row) for row in [self._head, *rows]))


def named_rows(path: Path) -> RowStore[str]:
    """Return a store of rows that say as ``key`` what they are called.

    Raises
    ------
    InputError
        The file is something else, or cannot be read.
    """
    return RowStore(path, NAMED_FORMAT, name_of)


def _line(row: Row) -> str:
    return json.dumps(row, ensure_ascii=False) + "\n"


def _parse(line: str) -> Row:
    try:
        parsed = json.loads(line)
    except json.JSONDecodeError:
        return {}
    return parsed if isinstance(parsed, dict) else {}
