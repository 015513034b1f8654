"""Per-plant rows of a table as one compressed file, a check of new rows against it, and new rows among them."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_bytes, write_atomic
from rdpi_gym.support.store import Row

FILE, STATEMENTS = "task-rows.csv.gz", "tasks.csv"
_KEY = ["task", "controller", "draws", "plant"]
_FIGURES = ["rmse_percent", "worst_percent", "command_variation_V_s"]
_COLUMNS = [*_KEY, *_FIGURES, "rmse_noise", "microseconds_per_sample", "failure"]
_SAID = ["sees", "certificate", "tuning_samples"]
_ROUNDING = 1e-4
"""Relative difference of figures up to which rows agree: six digits are written, another machine rounds otherwise."""
_LARGEST, _LARGEST_TEXT = 2**26, 2**29  # bytes, compressed and as text


def write_rows(folder: Path, rows: Sequence[Row]) -> Path:
    """Write the rows of every plant, six digits each, in the same bytes for the same rows."""
    table = pd.DataFrame(list(rows)).reindex(columns=_COLUMNS)
    text = table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    return write_atomic(folder / FILE, gzip.compress(text.encode(), mtime=0))


def checked_against(rows: Sequence[Row], path: Path) -> str:
    """Say in one sentence how many rows a file of :func:`write_rows` states likewise.

    Raises
    ------
    InputError
        The file is none, or states none of the rows.
    """
    stated = _read(path).set_index(_KEY)
    own = pd.DataFrame(list(rows)).reindex(columns=_COLUMNS).set_index(_KEY)
    common = own.index.intersection(stated.index)
    if common.empty:
        raise InputError(
            f"{path} states none of these rows; take controllers, tasks and plants that it holds"
        )
    one, other = own.loc[common], stated.loc[common]
    found, known = (part[_FIGURES].to_numpy(dtype=np.float64) for part in (one, other))
    agree = np.isclose(found, known, rtol=_ROUNDING, atol=0.0, equal_nan=True).all(axis=1)
    words = [part["failure"].fillna("").str.partition(":")[0].to_numpy() for part in (one, other)]
    same = int(np.sum(agree & (words[0] == words[1])))
    return f"{same} of {len(common)} rows are as {path.name} states them."


def put_among(rows: Sequence[Row], folder: Path) -> list[Row]:
    """Return the rows of a table with these in place of their like; the others stay as they are written.

    Raises
    ------
    InputError
        The folder holds no table, or one of other plants than the rows.
    """
    said = _statements(folder / STATEMENTS)
    fresh = {tuple(row[name] for name in _KEY): row for row in rows}
    anew = {key[:2] for key in fresh}
    merged: list[Row] = []
    stated = _read(folder / FILE).fillna({"failure": ""})
    for values in stated.itertuples(index=False, name=None):
        row: Row = dict(zip(_COLUMNS, values, strict=True))
        key = tuple(row[name] for name in _KEY)
        if key in fresh:
            merged.append(fresh.pop(key))
        elif key[:2] not in anew:
            merged.append(row | said.get(key[:2], {}))
    merged += fresh.values()
    for task, part in pd.DataFrame(merged).reindex(columns=_KEY).groupby("task"):
        plants = len(part[["draws", "plant"]].drop_duplicates())
        if len(part) != plants * part["controller"].nunique():
            raise InputError(
                f"{folder} holds not the plants of {task} that were scored; score as many of the same seed"
            )
    return merged


def _statements(path: Path) -> dict[tuple[str, str], Row]:
    """Read what controllers state of themselves on each task of a table."""
    try:
        table = pd.read_csv(io.BytesIO(read_bytes(path, _LARGEST)))
        table["tuning_samples"] = table["tuning_samples"].astype("Int64")
        return {
            (task, name): {
                key: value for key, value in zip(_SAID, said, strict=True) if pd.notna(value)
            }
            for task, name, *said in table[[*_KEY[:2], *_SAID]].itertuples(index=False)
        }
    except (ValueError, TypeError, KeyError, MemoryError) as error:
        raise InputError(
            f"{path} is no {STATEMENTS} that rdpi bench wrote; give the folder of a table"
        ) from error


def _read(path: Path) -> pd.DataFrame:
    reader = zlib.decompressobj(wbits=zlib.MAX_WBITS | 16)
    try:
        text = reader.decompress(read_bytes(path, _LARGEST), _LARGEST_TEXT)
        table = pd.read_csv(io.BytesIO(text), keep_default_na=True)
        table["failure"] = table["failure"].astype("string")
        return table[_COLUMNS].astype(dict.fromkeys(_FIGURES, np.float64))
    except (zlib.error, ValueError, KeyError, MemoryError) as error:
        raise InputError(
            f"{path} is no {FILE} that rdpi bench wrote; give that of a table"
        ) from error
