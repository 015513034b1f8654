"""Results as files: one NumPy archive with the arrays, and JSON that says where each belongs.

What is read is decided by the annotations of the result's class alone. The file names no class, no
module and no function.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

import cattrs
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rdpi_gym.diagnosis.checks import Check
from rdpi_gym.diagnosis.preprocessing.finding import Finding
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect, effect_from_dict
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.fields import Fields
from rdpi_gym.support.files import exists, parse_json, write_atomic
from rdpi_gym.support.npz import Npz, open_npz
from rdpi_gym.support.words import quoted, some

FORMAT, VERSION = "rdpi-result", 1
ENDING = ".npz"
_DOCUMENT = "document"
R = TypeVar("R")


def write_result(path: Path | str, kind: str, result: Any) -> Path:
    """Write a dataclass of numbers, texts, arrays, tables, plants and such dataclasses, whole or not at all.

    `kind` names its class in the file.
    """
    if Path(path).suffix.lower() != ENDING:
        raise InputError(f"{path}: a result is saved to a file that ends in {ENDING}")
    arrays: dict[str, NDArray[Any]] = {}
    document = {
        "format": FORMAT,
        "version": VERSION,
        "kind": kind,
        "result": _json(_writer(arrays).unstructure(result, unstructure_as=type(result))),
    }
    text = json.dumps(document, ensure_ascii=False, allow_nan=False).encode()
    members: dict[str, Any] = {_DOCUMENT: np.frombuffer(text, dtype=np.uint8), **arrays}
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
            return _reader(archive).structure(document.get("result"), kinds[kind])
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


def _json(value: Any) -> Any:
    """Return a value as JSON has it: a number that is not finite is text."""
    if isinstance(value, dict):
        return {key: _json(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_json(each) for each in value]
    if isinstance(value, np.generic):
        value = value.item()
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _writer(arrays: dict[str, NDArray[Any]]) -> cattrs.Converter:
    """Return a converter of dataclasses that leaves a name in place of each array."""
    converter = cattrs.Converter()

    def keep(array: NDArray[Any]) -> str:
        name = f"a{len(arrays)}"
        arrays[name] = array
        return name

    def keep_table(table: pd.DataFrame) -> dict[str, Any]:
        columns = []
        for name in table.columns:
            values = table[name]
            if values.dtype.kind in "iufb":
                column: dict[str, Any] = {"array": keep(values.to_numpy())}
            else:
                cells = [None if cell is pd.NA else cell for cell in values]
                column = {"cells": cells, "text": isinstance(values.dtype, pd.StringDtype)}
            columns.append({"name": str(name), **column})
        return {"rows": len(table), "columns": columns}

    converter.register_unstructure_hook_func(_is_array, keep)
    converter.register_unstructure_hook(pd.DataFrame, keep_table)
    converter.register_unstructure_hook_func(_is_plant, lambda plant: plant.to_dict())
    converter.register_unstructure_hook(Effect, lambda effect: effect.to_dict())
    # their sentences, in the words of this release
    for kind in (Check, Finding):
        converter.register_unstructure_hook(kind, kind.to_dict)
    # a user's own code is not saved
    converter.register_unstructure_hook_func(_is_classes, lambda classes: None)
    converter.register_unstructure_hook_func(_is_functions, lambda functions: None)
    return converter


def _reader(archive: Npz) -> cattrs.Converter:
    """Return a converter that builds what the annotations say, and takes arrays from an archive."""
    converter = cattrs.Converter(forbid_extra_keys=True, detailed_validation=False)

    def kept_array(name: str, hint: Any) -> NDArray[Any]:
        array = archive.read(name)
        if array.dtype.kind not in "biuf":
            raise ValueError(f"{quoted(name)} is an array of {array.dtype}; arrays hold numbers")
        # NDArray[np.float64] is ndarray[shape, dtype[float64]]
        kinds = [get_args(each) for each in get_args(hint)[1:]]
        return array.astype(kinds[0][0], casting="same_kind", copy=False) if kinds else array

    def kept_column(column: Any) -> Any:
        if "array" in column:
            return kept_array(column["array"], np.ndarray)
        if not all(type(cell) in (str, int, float, bool, type(None)) for cell in column["cells"]):
            raise ValueError("a cell of a table is neither text nor a number")
        return pd.Series(column["cells"], dtype=str if column["text"] else object)

    def kept_table(document: Any, _: Any) -> pd.DataFrame:
        columns = {column["name"]: kept_column(column) for column in document["columns"]}
        rows = document["rows"] if columns else 0
        if any(np.shape(values) != (rows,) for values in columns.values()):
            raise ValueError(f"a table of {quoted(rows)} rows has columns of other lengths")
        return pd.DataFrame(columns, index=pd.RangeIndex(rows))

    converter.register_structure_hook_func(_is_array, kept_array)
    converter.register_structure_hook(pd.DataFrame, kept_table)
    converter.register_structure_hook_func(
        _is_plant, lambda document, _: PlantModel.from_dict(document, "plant")
    )
    converter.register_structure_hook(
        Effect, lambda document, _: effect_from_dict(CATALOGUE, document, "effect")
    )
    converter.register_structure_hook(
        Check, lambda document, _: Check.from_fields(Fields(document, "check"))
    )
    converter.register_structure_hook(
        Finding, lambda document, _: Finding.from_fields(Fields(document, "finding"))
    )
    converter.register_structure_hook_func(_is_classes, lambda nothing, _: ())
    converter.register_structure_hook_func(_is_functions, lambda nothing, _: {})
    for kind in (str, int, float, bool):
        converter.register_structure_hook(kind, _exactly)
    return converter


def _is_plant(hint: Any) -> bool:
    # with any hysteresis core: PlantModel[...] too
    return hint is PlantModel or get_origin(hint) is PlantModel


def _is_array(hint: Any) -> bool:
    return hint is np.ndarray or get_origin(hint) is np.ndarray


def _is_classes(hint: Any) -> bool:
    return get_origin(hint) is tuple and get_origin(get_args(hint)[0]) is type


def _is_functions(hint: Any) -> bool:
    return get_origin(hint) is Mapping and get_origin(get_args(hint)[1]) is Callable


def _exactly(value: Any, kind: type) -> Any:
    """Return a value of the type that is expected; a key of a JSON object is always text."""
    if kind is float and type(value) in (int, float, str):
        return float(value)
    if type(value) is not kind:
        raise ValueError(f"{quoted(value)} where a {kind.__name__} is expected")
    return value
