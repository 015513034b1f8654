"""A controller alone in its process: observations in, actions out, nothing of the plant.

The judge starts ``python -I -m benchmarks.stages.worker`` in an empty folder that holds the submitted
code, with pipes as its only descriptors. Every message has a kind, a length and bytes: arrays as they
lie in memory, the rest as JSON. Nothing is unpickled on either side.
"""

from __future__ import annotations

import json
import os
import struct
import sys
import sysconfig
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numba.core.caching import Cache, _CacheLocator
from numpy.typing import NDArray

from baselines import CONTROLLERS, make_controller
from benchmarks.stages.confinement import confine
from benchmarks.tracking.episode import one_line
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.arrays import Array

HEAD = struct.Struct("<cQ")
"""Kind and length of a message."""
MAKE, FIRST, NEXT, PLAN, LEARN, STATE, TIME = b"M", b"F", b"N", b"P", b"L", b"S", b"T"
"""Requests: a controller, actions for the first and for later samples, a reference, a pass, its statements, its processor time."""
ACTION, DOCUMENT, FAILURE = b"A", b"D", b"E"
"""Answers: float64 a lane, JSON, a reason."""
_PACKAGES = ("baselines", "benchmarks", "rdpi_gym")
_MACHINE = ("/usr", "/lib", "/lib64", "/etc/ld.so.cache", "/etc/localtime", "/dev/urandom",
            "/proc/self", "/proc/cpuinfo", "/proc/meminfo", "/sys/devices/system")  # fmt: skip


class Reader(Protocol):
    """A pipe's end to read from."""

    def read(self, size: int, /) -> bytes:
        """Return that many bytes, fewer at its end."""
        ...


def read_message(pipe: Reader) -> tuple[bytes, bytes] | None:
    """Return kind and content of the next request; None at the end."""
    head = pipe.read(HEAD.size)
    if len(head) < HEAD.size:
        return None
    kind, size = HEAD.unpack(head)
    return kind, pipe.read(size)


class _Served:
    """The controller of this process, and what it hands over from sample to sample."""

    def __init__(self, confined: bool) -> None:
        self._confined = confined
        self._controller: Any = None
        self._layout: ObservationLayout
        self._state: Any = None

    def answer(self, kind: bytes, content: bytes) -> tuple[bytes, bytes]:
        """Return kind and content of the answer."""
        if kind in (FIRST, NEXT):
            return ACTION, self._actions(kind == FIRST, content).tobytes()
        if kind == TIME:
            return DOCUMENT, json.dumps(time.process_time()).encode()
        if kind == MAKE:
            self._make(**json.loads(content))
        elif kind == PLAN:
            self._controller.plan(*_columns(content, 1))
        elif kind == LEARN:
            self._controller.learn(*_columns(content, 3))
        return DOCUMENT, json.dumps(self._statements()).encode()

    def _make(self, controller: str, belief: dict[str, Any], layout: dict[str, Any]) -> None:
        command_range = tuple(layout["command_range_V"])
        self._layout = ObservationLayout.from_dict(layout | {"command_range_V": command_range})
        self._controller = make_controller(controller, PlantModel.from_dict(belief), self._layout)
        self._state = None

    def _actions(self, is_first: bool, content: bytes) -> Array:
        observation = np.frombuffer(content, np.float32).reshape(-1, self._layout.size).copy()
        lanes = len(observation)
        starts = np.full(lanes, is_first)
        answer, self._state = self._controller.predict(
            observation, None if is_first else self._state, starts, deterministic=True
        )
        return np.ascontiguousarray(np.reshape(answer, lanes), dtype=np.float64)

    def _statements(self) -> dict[str, Any]:
        own = self._controller
        texts = {name: getattr(own, name, None) for name in ("warning", "certificate")}
        return {
            "confined": self._confined,
            "plans": hasattr(own, "plan"),
            "repeats": bool(getattr(own, "repeats", False)),
            "plant_samples": int(getattr(own, "plant_samples", 0)),
            **{name: None if text is None else text() for name, text in texts.items()},
        }


def _columns(content: bytes, count: int) -> list[NDArray[np.float64]]:
    """Return arrays (samples, lanes) that stand one after the other, their number of lanes first."""
    lanes = int.from_bytes(content[:8], "little")
    values = np.frombuffer(content, np.float64, offset=8).reshape(count, -1, lanes)
    return [np.array(each) for each in values]


def readable_places() -> list[Path]:
    """Return what imports need: Python, its packages, these packages, facts of the machine."""
    found = filter(None, map(find_spec, _PACKAGES))
    own = [Path(str(each.origin)).parent for each in found]
    places = {*sysconfig.get_paths().values(), sys.prefix, sys.base_prefix}
    places |= {each for each in sys.path if Path(each).name in ("site-packages", "dist-packages")}
    caches = [Path(os.environ[name]) for name in ("NUMBA_CACHE_DIR",) if name in os.environ]
    return [*own, *caches, *map(Path, sorted(places)), *map(Path, _MACHINE)]


def keep_compiled() -> None:
    """Let kernels find their compiled code where the judge's do, and leave it as it is."""
    list(CONTROLLERS), list(CATALOGUE)  # looks for it while folders can be written to
    Cache.save_overload = lambda *_: None
    _CacheLocator.ensure_cache_path = lambda *_: None


def main() -> None:
    """Answer requests until there are no more."""
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):  # what a controller prints or reads goes nowhere
        os.dup2(nowhere, descriptor)
    os.close(nowhere)
    keep_compiled()
    here = Path.cwd()
    served = _Served(confine(readable_places(), [here, Path(os.devnull)]))
    sys.path.append(str(here))
    while (request := read_message(requests)) is not None:
        try:
            with np.errstate(invalid="ignore", over="ignore"):
                kind, content = served.answer(*request)
        except Exception as error:  # of the controller, which may raise anything
            reason = one_line(f"{type(error).__name__}: {error}")
            kind, content = FAILURE, reason.encode(errors="replace")
        answers.write(HEAD.pack(kind, len(content)) + content)
        answers.flush()


if __name__ == "__main__":
    main()
