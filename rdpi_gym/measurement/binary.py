"""MATLAB files (v5 and v7.3) and NumPy archives: the columns are variables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rdpi_gym.measurement.table import Table, label, select
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

_HDF5_OFFSETS = (0, 512)  # MATLAB puts 512 bytes of its own before the HDF5 signature
_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"


def read_matlab(path: Path, columns: Mapping[str, str | int], *, time_needed: bool = True) -> Table:
    """Read a MATLAB file, v5 or v7.3, with 1xN or Nx1 variables, or one struct that holds them.

    Raises
    ------
    InputError
        Not a whole MATLAB file, a missing variable, one that is not a row or column of numbers.

    Examples
    --------
    >>> import tempfile
    >>> from scipy.io import savemat
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "run.mat"
    ...     savemat(path, {"t": [0.0, 0.1], "u": [0.0, 1.0], "y": [0.0, 8.0]})
    ...     read_matlab(path, {}).columns["y"]
    array([0., 8.])
    """
    raw = _read(path, lambda: path.read_bytes()[:520], "MATLAB")
    is_hdf5 = any(raw[k : k + len(_HDF5_SIGNATURE)] == _HDF5_SIGNATURE for k in _HDF5_OFFSETS)
    variables = _read(path, lambda: (_hdf5 if is_hdf5 else _v5)(path), "MATLAB")
    u = columns.get("u", "u")
    structs = [value for value in variables.values() if isinstance(value, dict) and u in value]
    if u not in variables and len(structs) == 1:
        variables = structs[0]
    return _table(path, variables, columns, time_needed)


def read_npz(path: Path, columns: Mapping[str, str | int], *, time_needed: bool = True) -> Table:
    """Read a NumPy archive; pickled objects are refused.

    Raises
    ------
    InputError
        Not a whole archive, a missing array, one that is not a row or column of numbers.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "run.npz"
    ...     np.savez(path, t=[0.0, 0.1], volt=[0.0, 1.0], y=[0.0, 8.0])
    ...     read_npz(path, {"u": "volt"}).columns["u"]
    array([0., 1.])
    """
    variables = _read(path, lambda: _npz(path), "npz")
    return _table(path, variables, columns, time_needed)


def _read(path: Path, reader: Callable[[], Any], kind: str) -> Any:
    try:
        return reader()
    except Exception as error:  # the libraries raise many kinds on a truncated or foreign file
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{path} cannot be read as {kind} file ({reason}); "
            "save it again, perhaps it was cut off or its ending is wrong"
        ) from error


def _v5(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    variables: dict[str, Any] = loadmat(path, simplify_cells=True)
    return {name: value for name, value in variables.items() if not name.startswith("__")}


def _hdf5(path: Path) -> dict[str, Any]:
    import h5py

    def read(item: Any) -> Any:
        if isinstance(item, h5py.Group):
            return {name: read(member) for name, member in item.items()}
        # characters are stored as their codes: no numbers to compute with
        return str(item) if item.attrs.get("MATLAB_class") == b"char" else item[()]

    with h5py.File(path, "r") as file:
        return {name: read(item) for name, item in file.items() if not name.startswith("#")}


def _npz(path: Path) -> dict[str, Any]:
    # opened here, since numpy leaves a broken archive open
    with path.open("rb") as stream:
        archive = np.load(stream, allow_pickle=False)
        if isinstance(archive, np.ndarray):
            raise ValueError("it holds one array without a name")
        return {name: archive[name] for name in archive.files}


def _table(
    path: Path, variables: Mapping[str, Any], columns: Mapping[str, str | int], time_needed: bool
) -> Table:
    for name, source in columns.items():
        if isinstance(source, int):
            raise InputError(
                f"{path}, variable {name}: position {source} means nothing here; "
                f"name the variable with --columns {name}=..."
            )
    sources = select(columns, list(variables), time_needed, str(path), "variable")
    labels = {name: label("variable", name, source) for name, source in sources.items()}
    arrays = {
        name: _vector(variables[str(source)], f"{path}, {labels[name]}")
        for name, source in sources.items()
    }
    samples = arrays["u"].size
    for name, array in arrays.items():
        if array.size != samples:
            raise InputError(
                f"{path}, {labels[name]}: {array.size} values where {labels['u']} has {samples}; "
                "give one value for each sample"
            )
    return Table(source=path, columns=arrays, labels=labels)


def _vector(value: Any, where: str) -> Array:
    array = np.asarray(value)
    if array.dtype.kind not in "fiub":
        raise InputError(f"{where}: no array of real numbers; give 1xN or Nx1 numbers")
    if array.size != max(array.shape, default=1):
        raise InputError(
            f"{where}: shape {'x'.join(map(str, array.shape))}; a record has one channel, 1xN or Nx1"
        )
    return np.ascontiguousarray(array.reshape(-1), dtype=np.float64)
