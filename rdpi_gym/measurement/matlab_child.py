"""The program that reads MATLAB files for `rdpi_gym.measurement.matlab`, in a process of its own.

Standard input has one request a line, JSON: ``path``, ``kind`` ("v5" or "hdf5"), ``wanted`` (names,
that of the voltage first), ``largest`` and ``memory`` (bytes), ``seconds``. The answer is a line of JSON, either
``error`` (damaged), ``memory`` (it took more), ``refused`` (a sentence that begins with a variable's
name), or ``names``, ``shapes`` and ``not_numbers``; the arrays of ``shapes`` follow as little-endian doubles. It imports
nothing of this package, so that it starts quickly and whatever it is damaged by stays here.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
import warnings
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

# Bytes of an element, by MATLAB class; what is not here holds no numbers, or is a struct.
_SIZES = {
    **{"double": 8, "single": 4, "logical": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2},
    **{"int32": 4, "uint32": 4, "int64": 8, "uint64": 8},
}
Arrays = dict[str, NDArray[np.float64] | None]


class RefusedError(Exception):
    """A variable that is not read although the file is whole."""


def read_v5(path: str, wanted: list[str], largest: int) -> tuple[list[str], Arrays]:
    """Read variables of a MATLAB file up to v7, or fields of the one struct that has the first."""
    from scipy.io import loadmat, whosmat

    found = [entry for entry in whosmat(path, appendmat=False) if not entry[0].startswith("__")]
    names = [name for name, _, _ in found]
    if wanted[0] in names:
        present = [name for name in wanted if name in names]
        sizes = {name: 8 * math.prod(shape) for name, shape, kind in found if kind in _SIZES}
        _check(sizes, present, largest)
        values = loadmat(path, variable_names=present, simplify_cells=True, appendmat=False)
        return names, {name: _numbers(values.get(name)) for name in present}
    structs = [name for name, shape, kind in found if kind == "struct" and math.prod(shape) == 1]
    holders: list[dict[str, Any]] = []
    for name in structs:
        value = loadmat(path, variable_names=[name], simplify_cells=True, appendmat=False)[name]
        if isinstance(value, dict) and wanted[0] in value:
            holders.append(value)
    if len(holders) != 1:
        return names, {}
    fields = {name: _numbers(holders[0][name]) for name in wanted if name in holders[0]}
    sizes = {name: value.nbytes for name, value in fields.items() if value is not None}
    _check(sizes, list(sizes), largest)
    return list(holders[0]), fields


def read_hdf5(path: str, wanted: list[str], largest: int) -> tuple[list[str], Arrays]:
    """Read data sets of a MATLAB file v7.3, or those of the one group that has the first."""
    import h5py

    with h5py.File(path, "r") as file:
        group: Any = file
        if wanted[0] not in file:
            groups = [
                file[name]
                for name in _members(file)
                if isinstance(file.get(name, getlink=True), h5py.HardLink)
                and file.get(name, getclass=True) is h5py.Group
            ]
            holders = [each for each in groups if wanted[0] in _members(each)]
            group = holders[0] if len(holders) == 1 else file
        names = _members(group)
        present = [name for name in wanted if name in names]
        for name in present:
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                raise RefusedError(f"{name}: a link to another place; store the numbers themselves")
        items = {name: group[name] for name in present}
        sets = {name: item for name, item in items.items() if _is_numbers(item)}
        sizes = {}
        for name, item in sets.items():
            if item.external or item.is_virtual:
                raise RefusedError(
                    f"{name}: its numbers lie in another file; store them in this one"
                )
            sizes[name] = 8 * max(item.size, math.prod(item.chunks or ()))
        _check(sizes, list(sizes), largest)
        return names, {name: _numbers(sets[name][()]) if name in sets else None for name in items}


def _members(group: Any) -> list[str]:
    return [name for name in group if not name.startswith("#")]


def _is_numbers(item: Any) -> bool:
    import h5py

    if not isinstance(item, h5py.Dataset) or item.shape is None or item.dtype.kind not in "fiub":
        return False
    # characters are stored as their codes: no numbers to compute with
    return bool(item.attrs.get("MATLAB_class") != b"char")


def _numbers(value: Any) -> NDArray[np.float64] | None:
    if not isinstance(value, np.ndarray | np.generic | int | float):
        return None
    array = np.asarray(value)
    return np.ascontiguousarray(array, dtype="<f8") if array.dtype.kind in "fiub" else None


def _check(sizes: dict[str, int], present: list[str], largest: int) -> None:
    taken = 0
    for name in present:
        taken += sizes.get(name, 0)
        if taken > largest:
            raise RefusedError(
                f"{name}: {sizes[name] / 2**20:.0f} MiB of numbers, where what is read of this file may "
                f"take {largest / 2**20:.0f} MiB; save fewer samples, or without compression"
            )


def _limit(memory: int, seconds: float) -> None:
    """Let this process take no more than so much beyond what it has, where that can be said."""
    try:
        import resource

        with open("/proc/self/statm") as stream:  # noqa: PTH123 (pathlib is not imported for this)
            now = int(stream.read().split()[0]) * resource.getpagesize()
    except (ImportError, OSError):
        return
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    resource.setrlimit(
        resource.RLIMIT_AS, (now + memory, resource.getrlimit(resource.RLIMIT_AS)[1])
    )
    end_s = math.ceil(time.process_time() + seconds)
    resource.setrlimit(resource.RLIMIT_CPU, (end_s, resource.getrlimit(resource.RLIMIT_CPU)[1]))


def answer(request: dict[str, Any], replies: BinaryIO) -> None:
    """Answer one request."""
    reader = read_v5 if request["kind"] == "v5" else read_hdf5
    arrays: Arrays = {}
    try:
        _limit(request["memory"], request["seconds"])
        names, arrays = reader(request["path"], request["wanted"], request["largest"])
    except RefusedError as error:
        said: dict[str, Any] = {"refused": str(error)}
    except MemoryError:
        said = {"memory": request["memory"]}
    except Exception as error:  # the libraries raise many kinds on a truncated or foreign file
        said = {"error": " ".join(str(error).split())[:150] or type(error).__name__}
    else:
        said = {
            "names": names,
            "shapes": {name: a.shape for name, a in arrays.items() if a is not None},
            "not_numbers": [name for name, a in arrays.items() if a is None],
        }
    replies.write(json.dumps(said).encode() + b"\n")
    if "shapes" in said:
        for array in arrays.values():
            if array is not None and array.size:
                replies.write(array.reshape(-1).data.cast("B"))
    replies.flush()


def main() -> None:
    """Answer requests until there are no more."""
    warnings.simplefilter("ignore")
    # what a library prints must not stand between answers
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    for line in sys.stdin.buffer:
        answer(json.loads(line), replies)


if __name__ == "__main__":
    main()
