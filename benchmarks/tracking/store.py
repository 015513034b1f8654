"""Rows of results in an append-only file: an interrupted run continues where it stopped."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from rdpi_gym.errors import InputError
from rdpi_gym.files import write_atomic

FORMAT, VERSION = "rdpi-bench-rows", 1
Row: TypeAlias = dict[str, Any]
Key: TypeAlias = tuple[str, str, str, float, float, int]


def key(row: Mapping[str, Any]) -> Key:
    """Return what names a row: controller, plant, reference, frequency (Hz), Ts (s), seed."""
    return (
        str(row["controller"]),
        str(row["plant"]),
        str(row["reference"]),
        float(row["frequency_hz"]),
        float(row["ts_s"]),
        int(row["seed"]),
    )


class RowStore:
    """A file of JSON lines, the first of which states the format; every line is whole or ignored.

    Parameters
    ----------
    path
        The file; it is made by the first :meth:`append`.

    Raises
    ------
    InputError
        The file is something else.

    Attributes
    ----------
    rows : dict
        The rows by :func:`key`; of two rows with one key the later counts.
    damaged : int
        Lines that were torn by an interruption and are dropped.

    Examples
    --------
    >>> import tempfile
    >>> row = {"controller": "none", "plant": "P5", "reference": "sine", "frequency_hz": 1.0,
    ...        "ts_s": 1e-3, "seed": 0, "rmse_um": 0.5}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     RowStore(Path(folder) / "rows.jsonl").append([row])
    ...     len(RowStore(Path(folder) / "rows.jsonl").rows)
    1
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[Key, Row] = {}
        self.damaged = 0
        if path.exists():
            self._read()

    def append(self, rows: Iterable[Row]) -> None:
        """Add finished rows; they are on the disk when this returns."""
        added = list(rows)
        lines = [json.dumps(row) for row in added]
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
        self.rows.update({key(row): row for row in added})

    def set_aside(self, is_stale: Callable[[Row], bool]) -> Path | None:
        """Move rows that no longer hold to a file of their own.

        Parameters
        ----------
        is_stale
            Whether a row belongs to code, a plant or a controller that has changed since.

        Returns
        -------
        Path or None
            The file that they were moved to; None where every row still holds.
        """
        stale = [row for row in self.rows.values() if is_stale(row)]
        if not stale:
            return None
        number = 1
        while (aside := self.path.with_name(f"{self.path.stem}-stale-{number}.jsonl")).exists():
            number += 1
        write_atomic(aside, _text(stale))
        self.rows = {key(row): row for row in self.rows.values() if not is_stale(row)}
        write_atomic(self.path, _text(self.rows.values()))
        return aside

    def _read(self) -> None:
        try:
            text = self.path.read_bytes().decode("utf-8", errors="replace")
        except OSError as error:
            raise InputError(f"{self.path} cannot be read ({error.strerror})") from error
        *lines, torn = text.split("\n")
        if lines and _parse(lines[0]) != _head():
            raise InputError(
                f"{self.path} is not a file of rows that this release wrote; give another folder, or move it away"
            )
        for line in lines[1:]:
            row = _parse(line)
            try:
                self.rows[key(row)] = row
            except (KeyError, TypeError, ValueError):
                self.damaged += 1
        self.damaged += bool(torn)
        if self.damaged:
            # the next line must not be appended to half a line
            write_atomic(self.path, _text(self.rows.values()))


def _head() -> dict[str, Any]:
    return {"format": FORMAT, "version": VERSION}


def _text(rows: Iterable[Row]) -> str:
    return "".join(f"{json.dumps(row)}\n" for row in [_head(), *rows])


def _parse(line: str) -> Row:
    try:
        parsed = json.loads(line)
    except json.JSONDecodeError:
        return {}
    return parsed if isinstance(parsed, dict) else {}
