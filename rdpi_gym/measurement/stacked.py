"""Archives of several channels and realisations: one record for each realisation, one channel of y."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.measurement.binary import reading
from rdpi_gym.measurement.options import OTHER
from rdpi_gym.measurement.table import Table, header_unit
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.npz import Npz, open_npz
from rdpi_gym.support.words import quoted, some

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
            found += [_table(path, tag, u, y, (own, output), k) for k in range(u.shape[2])]
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


def _table(
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
