"""Results as files: one NumPy archive with the arrays, and JSON that says where each belongs.

What is read is decided by the annotations of the result's class alone. The file names no class, no
module and no function.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, TypeVar, cast, get_args, get_origin

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rdpi_gym.diagnosis.checks import Check
from rdpi_gym.diagnosis.preprocessing import Finding
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect, effect_from_dict
from rdpi_gym.support.checks import unaliased
from rdpi_gym.support.documents import Documents
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import exists, parse_json, write_atomic
from rdpi_gym.support.npz import Npz, open_npz
from rdpi_gym.support.words import quoted, some

FORMAT, VERSION = "rdpi-result", 1
ENDING = ".npz"
_DOCUMENT = "document"
R = TypeVar("R")
_OWN = (PlantModel, Effect, Check, Finding)
"""Classes that write and read themselves: their files and their sentences are those of a release."""


def write_result(path: Path | str, kind: str, result: Any) -> Path:
    """Write a dataclass of numbers, texts, arrays, tables, plants and such dataclasses, whole or not at all.

    `kind` names its class in the file.
    """
    if Path(path).suffix.lower() != ENDING:
        raise InputError(f"{path}: a result is saved to a file that ends in {ENDING}")
    writer = _Archive()
    document = {
        "format": FORMAT,
        "version": VERSION,
        "kind": kind,
        "result": writer.write(result),
    }
    text = json.dumps(document, ensure_ascii=False, allow_nan=False).encode()
    members: dict[str, Any] = {_DOCUMENT: np.frombuffer(text, dtype=np.uint8), **writer.arrays}
    stream = io.BytesIO()
    np.savez(stream, **members)
    return write_atomic(path, stream.getvalue())


def read_result(path: Path | str, kinds: Mapping[str, type[R]]) -> R:
    """Read a result of one of the classes in `kinds` that :func:`write_result` wrote."""
    source = Path(path)
    if not exists(source):
        raise InputError(f"{source} does not exist; give a file that a result was saved to")
    try:
        with open_npz(source) as archive:
            document = _document(source, archive)
            kind = str(document.get("kind"))
            if kind not in kinds:
                raise InputError(f"it holds a {quoted(kind)}; expected {some(kinds)}")
            return _Archive(archive).read_fields(kinds[kind], document.get("result"), str(source))
    except InputError as error:
        said = str(error)
        raise (error if said.startswith(str(source)) else InputError(f"{source}: {said}")) from None
    except Exception as error:  # what a damaged archive raises, or a field of another type
        reason = " ".join(str(error).split())[:120]
        raise InputError(
            f"{source} is damaged, or was written by another release "
            f"({type(error).__name__}: {reason})"
        ) from error


def _document(source: Path, archive: Npz) -> dict[str, Any]:
    no_result = InputError(f"{source} is no saved result; give a file that a result was saved to")
    if _DOCUMENT not in archive.names:
        raise no_result
    document = parse_json(archive.read(_DOCUMENT).tobytes().decode(), str(source))
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise no_result
    version = document.get("version")
    if version != VERSION:
        raise InputError(
            f"{source} has version {quoted(version)} of {FORMAT}; this release reads version {VERSION}"
        )
    return document


class _Archive(Documents):
    """Writer and reader of results whose arrays stand beside the document, under a name each."""

    strict = True
    has_forms = False

    def __init__(self, archive: Npz | None = None) -> None:
        self.arrays: dict[str, NDArray[Any]] = {}
        self._archive = archive

    def write(self, value: Any, hint: Any = Any) -> Any:
        if _is_code(hint):  # a user's own is not saved
            return None
        if isinstance(value, np.ndarray):
            return self._keep(value)
        if isinstance(value, pd.DataFrame):
            return {"rows": len(value), "columns": [self._column(value[n]) for n in value.columns]}
        if isinstance(value, _OWN):
            return self.write(value.to_dict())
        if is_dataclass(value):
            return self.write_fields(value)
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, float) and not math.isfinite(value):
            return str(value)
        return super().write(value)

    def _keep(self, array: NDArray[Any]) -> str:
        name = f"a{len(self.arrays)}"
        self.arrays[name] = array
        return name

    def _column(self, values: pd.Series[Any]) -> dict[str, Any]:
        if values.dtype.kind in "iufb":
            return {"name": str(values.name), "array": self._keep(values.to_numpy())}
        cells = self.write([None if cell is pd.NA else cell for cell in values])
        is_text = isinstance(values.dtype, pd.StringDtype)
        return {"name": str(values.name), "cells": cells, "text": is_text}

    def read(self, hint: Any, document: Any, source: str) -> Any:
        hint = unaliased(hint)
        kind = get_origin(hint) or hint
        if _is_code(hint):
            return kind() if kind is tuple else {}
        if kind is np.ndarray:
            # NDArray[np.float64] is ndarray[shape, dtype[float64]]
            kinds = [get_args(each) for each in get_args(hint)[1:]]
            return self._array(document).astype(kinds[0][0], casting="same_kind", copy=False)
        if kind is pd.DataFrame:
            return self._table(document)
        if kind is Effect:
            return effect_from_dict(CATALOGUE, document, source)
        if kind in _OWN:
            return kind.from_dict(document, source)
        if kind is float and isinstance(document, str):
            return float(document)
        if is_dataclass(kind):
            return self.read_fields(cast(type[Any], kind), document, source)
        return super().read(hint, document, source)

    def _array(self, name: str) -> NDArray[Any]:
        assert self._archive is not None
        array = self._archive.read(name)
        if array.dtype.kind not in "biuf":
            raise ValueError(f"{quoted(name)} is an array of {array.dtype}; arrays hold numbers")
        return array

    def _table(self, document: Any) -> pd.DataFrame:
        columns: dict[str, Any] = {}
        for column in document["columns"]:
            cells = column.get("cells", ())
            if not all(type(cell) in (str, int, float, bool, type(None)) for cell in cells):
                raise ValueError("a cell of a table is neither text nor a number")
            columns[column["name"]] = (
                self._array(column["array"])
                if "array" in column
                else pd.Series(cells, dtype=str if column["text"] else object)
            )
        rows = document["rows"] if columns else 0
        if any(np.shape(values) != (rows,) for values in columns.values()):
            raise ValueError(f"a table of {quoted(rows)} rows has columns of other lengths")
        return pd.DataFrame(columns, index=pd.RangeIndex(rows))


def _is_code(hint: Any) -> bool:
    """Whether an annotation is of classes, or of functions by name."""
    parts = get_args(hint)
    inner = get_origin(parts[-1] if get_origin(hint) is Mapping else parts[0]) if parts else None
    return inner is type or inner is Callable
