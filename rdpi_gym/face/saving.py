"""Results as files: one NumPy archive with the arrays, and JSON that says where each belongs.

What is read is decided by the annotations of the result's class alone. The file names no class, no
module and no function; its arrays are no larger than the file.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

import cattrs
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect, effect_from_dict
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic

FORMAT, VERSION = "rdpi-result", 1
ENDING = ".npz"
_DOCUMENT = "document"
R = TypeVar("R")
# What a field of another type than its annotation's raises.
_UNFIT = (
    cattrs.BaseValidationError,
    cattrs.ForbiddenExtraKeysError,
    cattrs.StructureHandlerNotFoundError,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    RecursionError,
)


def write_result(path: Path | str, kind: str, result: Any) -> Path:
    """Write a result, whole or not at all.

    Parameters
    ----------
    path
        Ends in ``.npz``.
    kind
        Names the result's class in the file.
    result
        A dataclass of numbers, texts, arrays, tables, plants, and dataclasses of these.

    Raises
    ------
    InputError
        Another ending, or the file cannot be written.
    """
    if Path(path).suffix.lower() != ENDING:
        raise InputError(f"{path}: a result is saved to a file that ends in {ENDING}")
    arrays: list[NDArray[Any]] = []
    document = {
        "format": FORMAT,
        "version": VERSION,
        "kind": kind,
        "result": _converter(arrays).unstructure(result, unstructure_as=type(result)),
    }
    text = json.dumps(document, ensure_ascii=False, default=_plain_number).encode()
    stream = io.BytesIO()
    # not compressed: what is read is no larger than the file
    members: dict[str, Any] = {_DOCUMENT: np.frombuffer(text, dtype=np.uint8)}
    members |= {f"a{i}": array for i, array in enumerate(arrays)}
    np.savez(stream, **members)
    return write_atomic(path, stream.getvalue())


def read_result(path: Path | str, kinds: Mapping[str, type[R]]) -> R:
    """Read a result that :func:`write_result` wrote.

    Parameters
    ----------
    path
        The file.
    kinds
        The classes that may be in it.

    Raises
    ------
    InputError
        The file is missing, damaged, no result, or one of another kind.
    """
    source = Path(path)
    members = _members(source)
    document = _document(source, members)
    kind = str(document.get("kind"))
    if kind not in kinds:
        raise InputError(f"{source} holds a {kind[:40]!r}; expected {' or '.join(kinds)}")
    arrays = [members[f"a{i}"] for i in range(len(members) - 1) if f"a{i}" in members]
    try:
        return _converter(arrays).structure(document.get("result"), kinds[kind])
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    except _UNFIT as error:
        raise _damaged(source, error) from error


def _damaged(source: Path, error: BaseException) -> InputError:
    reason = " ".join(str(error).split())[:120] or type(error).__name__
    return InputError(
        f"{source} is damaged, or was written by another release ({type(error).__name__}: {reason})"
    )


def _members(source: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays of an archive, none larger than what the file holds for it."""
    if not source.is_file():
        raise InputError(f"{source} does not exist; give a file that a result was saved to")
    try:
        with zipfile.ZipFile(source) as archive:
            entries = archive.infolist()
            if any(entry.compress_type != zipfile.ZIP_STORED for entry in entries):
                raise InputError(f"{source} is compressed; give a file that a result was saved to")
            return {e.filename.removesuffix(".npy"): _array(archive.read(e)) for e in entries}
    except (zipfile.BadZipFile, OSError, ValueError, EOFError, NotImplementedError) as error:
        if isinstance(error, InputError):
            raise
        raise _damaged(source, error) from error


def _array(raw: bytes) -> NDArray[Any]:
    stream = io.BytesIO(raw)
    version = np.lib.format.read_magic(stream)
    if version != (1, 0):
        raise ValueError(f"an array of format {version}")
    shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(raw) - stream.tell():
        raise ValueError("an array that does not fit its header")
    stream.seek(0)
    return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))


def _document(source: Path, members: dict[str, NDArray[Any]]) -> dict[str, Any]:
    text = members.get(_DOCUMENT)
    if text is None or text.dtype != np.uint8 or text.ndim != 1:
        raise InputError(f"{source} is no saved result; give a file that a result was saved to")
    try:
        document = json.loads(text.tobytes().decode())
    except (ValueError, RecursionError) as error:
        raise _damaged(source, error) from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(f"{source} is no saved result; give a file that a result was saved to")
    if document.get("version") != VERSION:
        raise InputError(
            f"{source} has version {str(document.get('version'))[:20]} of {FORMAT}; this release "
            f"reads version {VERSION}"
        )
    return document


def _plain_number(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} has no place in JSON")


def _converter(arrays: list[NDArray[Any]]) -> cattrs.Converter:
    """Return a converter of dataclasses whose arrays are kept in a list, in their places a number."""
    converter = cattrs.Converter(forbid_extra_keys=True, detailed_validation=False)

    def keep(array: NDArray[Any]) -> int:
        arrays.append(array)
        return len(arrays) - 1

    def kept(place: Any, _: Any) -> NDArray[Any]:
        return arrays[_whole(place)]

    def keep_table(table: pd.DataFrame) -> dict[str, Any]:
        columns = []
        for name in table.columns:
            values = table[name]
            if values.dtype.kind in "iufb":
                column: dict[str, Any] = {"values": keep(values.to_numpy())}
            else:
                text = isinstance(values.dtype, pd.StringDtype)
                column = {"values": [_cell(v) for v in values], "text": text}
            columns.append({"name": str(name), **column})
        return {"rows": len(table), "columns": columns}

    def kept_table(document: Any, _: Any) -> pd.DataFrame:
        columns: dict[str, Any] = {}
        for column in document["columns"]:
            values = column["values"]
            columns[str(column["name"])] = (
                pd.Series(values, dtype=str if column["text"] else object)
                if isinstance(values, list)
                else arrays[_whole(values)]
            )
        return pd.DataFrame(columns, index=pd.RangeIndex(_whole(document["rows"])))

    converter.register_unstructure_hook_func(_is_array, keep)
    converter.register_structure_hook_func(_is_array, kept)
    converter.register_unstructure_hook(pd.DataFrame, keep_table)
    converter.register_structure_hook(pd.DataFrame, kept_table)
    converter.register_unstructure_hook(PlantModel, lambda plant: plant.to_dict())
    converter.register_structure_hook(
        PlantModel, lambda document, _: PlantModel.from_dict(document, "plant")
    )
    converter.register_unstructure_hook(Effect, lambda effect: effect.to_dict())
    converter.register_structure_hook(
        Effect, lambda document, _: effect_from_dict(CATALOGUE, document, "effect")
    )
    # classes of a user's own are not saved
    converter.register_unstructure_hook_func(_is_classes, lambda classes: None)
    converter.register_structure_hook_func(_is_classes, lambda nothing, _: ())
    for kind in (str, int, float, bool):
        converter.register_structure_hook(kind, _exactly)
    return converter


def _is_array(hint: Any) -> bool:
    return hint is np.ndarray or get_origin(hint) is np.ndarray


def _is_classes(hint: Any) -> bool:
    return get_origin(hint) is tuple and get_origin(get_args(hint)[0]) is type


def _cell(value: Any) -> Any:
    return None if value is pd.NA or value is None else value


def _whole(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise ValueError(f"{value!r} is no place")
    return value


def _exactly(value: Any, kind: type) -> Any:
    """Return a value of the type that is expected, as JSON has it."""
    if kind is float and type(value) in (int, float, str):  # a key of a JSON object is text
        return float(value)
    if type(value) is not kind:
        raise ValueError(f"{str(value)[:40]!r} where a {kind.__name__} is expected")
    return value
