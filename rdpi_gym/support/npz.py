"""NumPy archives without traps: only what is asked for, sizes checked before memory is taken."""

from __future__ import annotations

import math
import os
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from tokenize import TokenError
from typing import IO, cast

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import open_regular
from rdpi_gym.support.words import quoted

EXPANSION = 20
"""Times its size that a compressed file may expand to, where that is more than `FREE_BYTES`."""
FREE_BYTES = 128 * 2**20
"""What the arrays that are read of one file may take, however small it is."""
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_LONGEST_HEADER = 4096
_LARGEST_READ = 2**20
"""Bytes read at once: the list of members too, of which the reader makes objects twenty times as large."""


def largest_expansion(file_size: int) -> int:
    """Return how many bytes the arrays that are read of a file may take."""
    return max(FREE_BYTES, EXPANSION * file_size)


class Npz:
    """An open archive; see :func:`open_npz`.

    Attributes
    ----------
    names : list of str
        Of the arrays.
    """

    def __init__(self, archive: zipfile.ZipFile, path: Path, left: int) -> None:
        self._archive, self._path, self._left = archive, path, left
        members = archive.infolist()
        self.names = [member.filename.removesuffix(".npy") for member in members]
        self._members = dict(zip(self.names, members, strict=True))

    def read(self, name: str) -> NDArray[np.generic]:
        """Read one array."""
        member = self._members[name]
        if member.compress_type not in _METHODS:
            raise ValueError(f"{quoted(name)} is compressed in a way that NumPy does not use")
        try:
            return self._array(name, member)
        except (EOFError, SyntaxError, TokenError, OverflowError, zlib.error) as error:
            raise ValueError(f"{quoted(name)} is damaged ({error})") from error

    def _array(self, name: str, member: zipfile.ZipInfo) -> NDArray[np.generic]:
        with self._archive.open(member) as stream:
            version = npy.read_magic(stream)
            header = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
            if version not in header:
                raise ValueError(f"{quoted(name)} is of version {version} of the npy format")
            shape, is_fortran, dtype = header[version](stream, max_header_size=_LONGEST_HEADER)
            if dtype.hasobject:
                raise ValueError(f"{quoted(name)} holds Python objects, which are not read")
            if any(side < 0 for side in shape):
                raise ValueError(f"{quoted(name)} has a side below 0: {quoted(shape)}")
            stated = math.prod(shape) * dtype.itemsize
            self._left -= max(stated, 8 * math.prod(shape))  # numbers become doubles
            if self._left < 0:
                raise InputError(
                    f"{self._path}, {quoted(name)}: expands to {stated / 2**20:.0f} MiB; what is read of this "
                    f"file may take {EXPANSION} times its size, or {FREE_BYTES / 2**20:.0f} MiB where that is more"
                )
            content = np.empty(stated, dtype=np.uint8)
            if stated > member.file_size or not _fills(content, stream):
                raise ValueError(
                    f"{quoted(name)} does not hold the {stated} bytes that its header states"
                )
        return content.view(dtype).reshape(shape, order="F" if is_fortran else "C")


def _fills(content: NDArray[np.uint8], stream: IO[bytes]) -> bool:
    """Read a stream to its end; return whether it holds just the bytes that fit."""
    done = 0
    while done < content.size:
        part = stream.read(min(_LARGEST_READ, content.size - done))
        if not part:
            return False
        content[done : done + len(part)] = np.frombuffer(part, dtype=np.uint8)
        done += len(part)
    return not stream.read(1)


class _Bounded:
    """A stream that hands out 1 MiB at most at once: no number in an archive sizes memory."""

    def __init__(self, stream: BufferedReader) -> None:
        self._stream = stream
        self.seek, self.tell, self.seekable = stream.seek, stream.tell, stream.seekable

    def read(self, count: int = -1) -> bytes:
        """Read as the stream does, or refuse."""
        content = self._stream.read(
            _LARGEST_READ + 1 if count < 0 else min(count, _LARGEST_READ + 1)
        )
        if len(content) > _LARGEST_READ:
            raise ValueError(f"its list of arrays has more than {_LARGEST_READ / 2**20:.0f} MiB")
        return content


@contextmanager
def open_npz(path: Path) -> Iterator[Npz]:
    """Open a NumPy archive; nothing of its arrays is read yet, and no Python object ever."""
    with open_regular(path) as stream:
        if stream.read(len(npy.MAGIC_PREFIX)) == npy.MAGIC_PREFIX:
            raise ValueError("it holds one array without a name")
        size = os.fstat(stream.fileno()).st_size
        with zipfile.ZipFile(cast(IO[bytes], _Bounded(stream))) as archive:
            yield Npz(archive, path, largest_expansion(size))
