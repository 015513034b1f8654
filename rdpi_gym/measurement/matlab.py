"""MATLAB files, read in a process of its own: a damaged one ends that process and not the user's."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Timer
from types import TracebackType
from typing import IO, Any, Self

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.measurement import matlab_child
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import open_regular
from rdpi_gym.support.npz import largest_expansion

LIMIT_S = 8.0
"""Seconds of a processor that a file may take, and one more for every 10 MiB of it."""
_PATIENCE = 10.0
"""Seconds by the clock for each of a processor: other programs run as well."""
_BYTES_PER_S = 10 * 2**20
_HDF5_OFFSETS = (0, 512)  # MATLAB puts 512 bytes of its own before the HDF5 signature
_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_LARGEST_HEAD = 16 * 2**20
_QUIET = {"HDF5_PLUGIN_PRELOAD": "::"}  # no filter of a file loads a library
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass(frozen=True)
class Variables:
    """Variables read from a file."""

    # Names of all variables of the file, or of all fields of the struct that holds them
    names: Sequence[str]
    # Those that were asked for and are there; None: it holds no real numbers
    values: Mapping[str, NDArray[Any] | None]


class MatlabReader:
    """Reads MATLAB files, v5 and v7.3, in another process, which starts with the first file.

    The libraries that read them are written in C and end their process on some damaged files. Here
    that is one error line. The other process may take 4 times the memory that the numbers may take,
    and :data:`LIMIT_S`; numbers come back as plain doubles.

    Examples
    --------
    >>> import tempfile
    >>> from scipy.io import savemat
    >>> with tempfile.TemporaryDirectory() as folder, MatlabReader() as reader:
    ...     path = Path(folder) / "run.mat"
    ...     savemat(path, {"u": [0.0, 1.0], "notes": "at noon"})
    ...     reader.read(path, ["u", "y"])
    Variables(names=['u', 'notes'], values={'u': array([0., 1.])})
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the other process."""
        if self._process is None:
            return
        self._process.kill()
        with self._process:  # closes the pipes and waits
            self._process = None

    def read(self, path: Path, wanted: Sequence[str]) -> Variables:
        """Read variables by their names."""
        with open_regular(path) as stream:
            head = stream.read(max(_HDF5_OFFSETS) + len(_HDF5_SIGNATURE))
            size = os.fstat(stream.fileno()).st_size
        is_hdf5 = any(head[k : k + len(_HDF5_SIGNATURE)] == _HDF5_SIGNATURE for k in _HDF5_OFFSETS)
        largest = largest_expansion(size)
        seconds = LIMIT_S + size / _BYTES_PER_S
        request = {
            "path": str(path.absolute()),
            "kind": "hdf5" if is_hdf5 else "v5",
            "wanted": list(wanted),
            "largest": largest,
            "memory": 4 * largest,
            "seconds": seconds,
        }
        process = self._process = self._process or _start()
        timer = Timer(_PATIENCE * seconds, process.kill)
        timer.start()
        try:
            said, values = _ask(process, request, largest)
        except (OSError, EOFError, ValueError):
            in_time = timer.is_alive()
            self.close()
            cause = _cause(process.returncode)
            if not in_time or cause == "SIGXCPU":
                raise ValueError(f"it is not read within {seconds:.0f} s") from None
            raise ValueError(f"it ends the program that reads it, {cause}") from None
        finally:
            timer.cancel()
        if "refused" in said:
            raise InputError(f"{path}, variable {said['refused']}")
        if "memory" in said:
            raise InputError(
                f"{path} takes more than {said['memory'] / 2**20:.0f} MiB to read, too much for a file of "
                "its size; save time, voltage and displacement alone"
            )
        if "error" in said:
            raise ValueError(said["error"])
        return Variables(said["names"], values | dict.fromkeys(said["not_numbers"]))


def _start() -> subprocess.Popen[bytes]:
    # by its path and without the current folder: nothing that lies beside the data is imported
    command = [sys.executable, "-P", str(Path(matlab_child.__file__))]
    try:
        return subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **_ONE_THREAD, **_QUIET},
        )
    except OSError as error:
        raise ValueError(f"{sys.executable or 'Python'} cannot be started: {error}") from error


def _ask(
    process: subprocess.Popen[bytes], request: dict[str, Any], largest: int
) -> tuple[dict[str, Any], dict[str, NDArray[Any] | None]]:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(json.dumps(request).encode() + b"\n")
    process.stdin.flush()
    head = process.stdout.readline(_LARGEST_HEAD)
    if not head.endswith(b"\n"):
        raise EOFError
    said: dict[str, Any] = json.loads(head)
    values: dict[str, NDArray[Any] | None] = {}
    for name, shape in said.get("shapes", {}).items():
        if 8 * math.prod(shape) > largest:
            raise EOFError
        values[name] = _doubles(process.stdout, shape)
    return said, values


def _doubles(stream: IO[bytes], shape: list[int]) -> NDArray[Any]:
    array = np.empty(math.prod(shape), dtype="<f8")
    done = 0
    while done < array.nbytes:
        count = stream.readinto(array.data.cast("B")[done:])  # type: ignore[attr-defined]
        if not count:
            raise EOFError
        done += count
    return array.reshape(shape)


def _cause(status: int) -> str:
    try:
        return signal.Signals(-status).name
    except ValueError:
        return f"status {status}"
