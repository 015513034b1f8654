"""Rows of the study in an append-only file: an interrupted run continues where it stopped."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeAlias

from rdpi_gym.errors import InputError
from rdpi_gym.files import write_atomic

FORMAT, VERSION = "rdpi-hidden-rows", 1
Row: TypeAlias = dict[str, Any]


class RowFile:
    """A file of JSON lines, the first of which states the format; a torn line is dropped.

    Parameters
    ----------
    path
        The file; it is made by the first :meth:`append`.

    Raises
    ------
    InputError
        The file is something else, or cannot be read.

    Attributes
    ----------
    rows : dict
        The rows by what they have as ``key``.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     RowFile(Path(folder) / "rows.jsonl").append({"key": "none/0", "verdict": "explained"})
    ...     RowFile(Path(folder) / "rows.jsonl").rows["none/0"]["verdict"]
    'explained'
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[str, Row] = {}
        if path.exists():
            self._read()

    def append(self, row: Row) -> None:
        """Add a finished row; it is on the disk when this returns."""
        lines = [json.dumps(row, ensure_ascii=False)]
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a", encoding="utf-8") as stream:
                if stream.tell() == 0:
                    lines.insert(0, json.dumps(_head()))
                stream.writelines(f"{line}\n" for line in lines)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise InputError(
                f"{self.path} cannot be written ({error.strerror}); give a folder that you may write to"
            ) from error
        self.rows[row["key"]] = row

    def set_aside(self, is_stale: Callable[[Row], bool]) -> Path | None:
        """Move rows that no longer hold to a file of their own; None where every row holds."""
        stale = [row for row in self.rows.values() if is_stale(row)]
        if not stale:
            return None
        number = 1
        while (aside := self.path.with_name(f"{self.path.stem}-stale-{number}.jsonl")).exists():
            number += 1
        write_atomic(aside, _text(stale))
        gone = {row["key"] for row in stale}
        self.rows = {key: row for key, row in self.rows.items() if key not in gone}
        write_atomic(self.path, _text(self.rows.values()))
        return aside

    def _read(self) -> None:
        try:
            text = self.path.read_bytes().decode("utf-8", errors="replace")
        except OSError as error:
            raise InputError(f"{self.path} cannot be read ({error.strerror})") from error
        first, *lines = text.split("\n")
        if _parse(first) != _head():
            raise InputError(
                f"{self.path} is not a file of rows that this release wrote; give another folder, or move it away"
            )
        rows = [row for row in map(_parse, lines) if isinstance(row.get("key"), str)]
        self.rows = {row["key"]: row for row in rows}
        if lines[-1:] != [""]:
            # the next line must not be appended to half a line
            write_atomic(self.path, _text(self.rows.values()))


def _head() -> Row:
    return {"format": FORMAT, "version": VERSION}


def _text(rows: Iterable[Row]) -> str:
    return "".join(f"{json.dumps(row, ensure_ascii=False)}\n" for row in [_head(), *rows])


def _parse(line: str) -> Row:
    try:
        parsed = json.loads(line)
    except json.JSONDecodeError:
        return {}
    return parsed if isinstance(parsed, dict) else {}
