"""MATLAB files (v5 and v7.3) and NumPy archives: the columns are variables."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.measurement.matlab import MatlabReader, Variables
from rdpi_gym.measurement.options import COLUMNS, OTHER
from rdpi_gym.measurement.table import Table, from_header, header_unit, label, select
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.npz import Npz, open_npz
from rdpi_gym.support.words import quoted, some

Read = Callable[[Sequence[str]], Variables]
_MOST_CHANNELS = 99


def read_matlab(
    path: Path,
    columns: Mapping[str, str | int],
    *,
    time_needed: bool = True,
    reader: MatlabReader | None = None,
) -> Table:
    """Read a MATLAB file, v5 or v7.3, with 1xN or Nx1 variables, or one struct that holds them."""
    if reader is None:
        with MatlabReader() as own:
            return read_matlab(path, columns, time_needed=time_needed, reader=own)
    return _table(path, partial(reader.read, path), "MATLAB", columns, time_needed)


def read_npz(path: Path, columns: Mapping[str, str | int], *, time_needed: bool = True) -> Table:
    """Read a NumPy archive; pickled objects are refused."""
    return _table(path, partial(_npz, path), "npz", columns, time_needed)


def _wanted(path: Path, columns: Mapping[str, str | int]) -> list[str]:
    """Return the variables that may be read, the voltage first; no other is."""
    for name, source in columns.items():
        if isinstance(source, int):
            raise InputError(
                f"{path}, variable {name}: position {source} means nothing here",
                f"name the variable with --columns {name}=...",
            )
    names = dict.fromkeys((*COLUMNS, *columns))
    sources = (str(columns.get(name, name)) for name in sorted(names, key="u".__ne__))
    return [source for source in sources if source]


def _read(path: Path, read: Read, wanted: Sequence[str], kind: str) -> Variables:
    with reading(path, kind):
        variables = read(wanted)
        if wanted[0] not in variables.values:  # perhaps a channel of u
            with_u = read(["u", *(name for name in wanted if name != "u")])
            variables = with_u if "u" in with_u.values else variables
        return _channels(variables)


def _channels(variables: Variables) -> Variables:
    """Part a ``u`` of several channels, the longer side its samples, into u1, u2, ..."""
    u = variables.values.get("u")
    if u is None or u.ndim != 2 or not 1 < min(u.shape) <= _MOST_CHANNELS:
        return variables
    each = u if u.shape[1] > u.shape[0] else u.T
    parts = {f"u{k}": channel for k, channel in enumerate(each, 1)}
    return Variables(
        [name for name in variables.names if name != "u"] + list(parts),
        {name: x for name, x in variables.values.items() if name != "u"} | parts,
    )


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a library raises on a damaged file into one line."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # the libraries raise many kinds on a truncated or foreign file
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(
            f"{path} cannot be read as {kind} file ({reason}); "
            "save it again, perhaps it was cut off or its ending is wrong"
        ) from error


def _npz(path: Path, wanted: Sequence[str]) -> Variables:
    with open_npz(path) as archive:
        present = [name for name in wanted if name in archive.names]
        return Variables(archive.names, {name: archive.read(name) for name in present})


def _table(
    path: Path, read: Read, kind: str, columns: Mapping[str, str | int], time_needed: bool
) -> Table:
    variables = _read(path, read, _wanted(path, columns), kind)
    sources = select(columns, variables.names, time_needed, str(path), "variable")
    found = [str(source) for source in sources.values()]
    if not variables.values.keys() >= set(found):  # names that carry a unit, or u1, u2, ...
        variables = _read(path, read, found, kind)
    labels = {name: label("variable", name, source) for name, source in sources.items()}
    arrays = {
        name: _vector(variables.values[str(source)], f"{path}, {labels[name]}")
        for name, source in sources.items()
    }
    samples = arrays["u"].size
    for name, array in arrays.items():
        if array.size != samples:
            raise InputError(
                f"{path}, {labels[name]}: {array.size} values where {labels['u']} has {samples}; "
                "give one value for each sample"
            )
    names, units = from_header(sources)
    return Table(source=path, columns=arrays, labels=labels, names=names, units=units)


def _vector(array: NDArray[Any] | None, where: str) -> Array:
    if array is None or array.dtype.kind not in "fiub":
        raise InputError(f"{where}: no array of real numbers; give 1xN or Nx1 numbers")
    if array.size != max(array.shape, default=1):
        raise InputError(
            f"{where}: shape {'x'.join(map(str, array.shape))}; a record has one channel, 1xN or Nx1"
        )
    return np.ascontiguousarray(array.reshape(-1), dtype=np.float64)


_AXES = ("samples", "channels", "realisations", "periods")
_JUDGED = re.compile(r"(?i)(^|[_-])(test|val|validation)($|[_-])")
_CHANNEL = re.compile(r"([uy])([1-9][0-9]?)")


def stacked_tags(path: Path) -> list[str]:
    """Return what follows ``u_`` and ``y_`` in an archive whose arrays stack channels; else nothing."""
    with reading(path, "npz"), open_npz(path) as archive:
        names = archive.names
    if "u" in names or "y" in names:
        return []
    tags = [name[2:] for name in names if name.startswith("u_") and f"y_{name[2:]}" in names]
    return [tag for tag in tags if not header_unit("u", f"u_{tag}")]


def read_stacked(path: Path, tags: Sequence[str], columns: Mapping[str, str | int]) -> list[Table]:
    """Read an archive of arrays (samples, channels, realisations, periods), each ``u_TAG``, ``y_TAG``."""
    output = _channel(path, "y", columns.get("y", "y1"))
    own = _channel(path, "u", columns.get("u", f"u{output}"))
    found = []
    with reading(path, "npz"), open_npz(path) as archive:
        for tag in tags:
            u, y = (_array(path, archive, f"{side}_{tag}") for side in "uy")
            if u.shape[:1] + u.shape[2:] != y.shape[:1] + y.shape[2:]:
                raise InputError(
                    f"{path}: u_{tag} is {_shape(u)} and y_{tag} {_shape(y)}; give both the same "
                    "samples, realisations and periods"
                )
            for side, array, channel in (("u", u, own), ("y", y, output)):
                if channel > array.shape[1]:
                    there = some([f"{side}{k + 1}" for k in range(array.shape[1])])
                    raise InputError(
                        f"{path}: {side}_{tag} has no channel {side}{channel}; there are {there}"
                    )
            found += [_stacked_table(path, tag, u, y, (own, output), k) for k in range(u.shape[2])]
    return found


def _channel(path: Path, side: str, source: str | int) -> int:
    named = _CHANNEL.fullmatch(str(source))
    if named is None or named[1] != side:
        raise InputError(
            f"{path}: channel {quoted(source)} of {side}; give one as in {side}2, counted from 1"
        )
    return int(named[2])


def _array(path: Path, archive: Npz, name: str) -> NDArray[Any]:
    array = archive.read(name)
    if array.dtype.kind not in "fiu" or not 2 <= array.ndim <= 4 or not array.size:
        raise InputError(
            f"{path}, variable {quoted(name)}: {_shape(array)} of {array.dtype}; give numbers, "
            f"{' x '.join(_AXES)}"
        )
    return array.reshape(array.shape + (1,) * (4 - array.ndim))


def _shape(array: NDArray[Any]) -> str:
    return "x".join(map(str, array.shape))


def _stacked_table(
    path: Path,
    tag: str,
    u: NDArray[Any],
    y: NDArray[Any],
    channels: tuple[int, int],
    realisation: int,
) -> Table:
    own, output = channels
    samples, inputs, _, periods = u.shape

    def line(array: NDArray[Any], channel: int) -> NDArray[np.float64]:
        return array[:, channel - 1, realisation, :].T.reshape(-1).astype(np.float64)

    columns = {"u": line(u, own), "y": line(y, output)}
    others = [k for k in range(1, inputs + 1) if k != own]
    columns |= {f"{OTHER}u{k}": line(u, k) for k in others}
    columns["period"] = np.repeat(np.arange(periods, dtype=np.float64), samples)
    labels = {name: f"variable {name[:1]}_{tag}" for name in columns}
    labels |= {"u": f"channel u{own} of u_{tag}", "y": f"channel y{output} of y_{tag}"}
    judged = "validation-" if _JUDGED.search(tag) else ""
    remark = f"channel y{output} of {y.shape[1]}, realisation {realisation + 1} of {u.shape[2]}"
    return Table(
        source=path,
        columns=columns,
        labels=labels,
        remarks=(remark,),
        name=f"{judged}{tag}-{realisation + 1}",
        settles=periods > 1,
    )
