"""The judge's side of a controller that runs in a process of its own."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baselines import policy_of
from benchmarks.stages.worker import (
    ACTION,
    DOCUMENT,
    FAILURE,
    FIRST,
    HEAD,
    LEARN,
    MAKE,
    NEXT,
    PLAN,
    STATE,
    TIME,
)
from benchmarks.tracking.episode import one_line
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.files import check_plain
from rdpi_gym.support.plugins import find_here

PATIENCE_S = 120.0
"""Time (s) after which a process without an answer is ended: kernels are compiled in less."""
KEPT_VARIABLES = (
    "HOME",
    "LANG",
    "LC_ALL",
    "NUMBA_CACHE_DIR",
    "PATH",
    "SYSTEMROOT",
    "XDG_CACHE_HOME",
)
"""Environment variables that say where programs and compiled code are."""
_LARGEST = 2**20  # bytes of an answer
# Whether other processes' clocks can be read, and the kind of such a clock, see clock_getcpuclockid(3).
_HAS_CLOCKS, _PROCESS_CLOCK = sys.platform == "linux", 2


def environment_in(folder: Path) -> dict[str, str]:
    """Return the environment variables of a process that works in a folder of its own, confined."""
    # one thread: decisions are timed, and the kernel confines threads that are still to come
    single = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    known = {name: os.environ[name] for name in KEPT_VARIABLES if name in os.environ}
    return known | single | {"TMPDIR": str(folder)}


class ControllerFailed(Exception):
    """The controller raised an error, said in one line, or its process gave no answer."""


class ControllerProcess:
    """A process that holds one controller at a time, and is told what a controller may know.

    It has no argument, environment variable, open file or parent of its code that leads to the
    plants: a name, a belief, a layout and observations come through a pipe, and actions go back.

    Parameters
    ----------
    name
        As :func:`baselines.make_controller` takes it.
    code
        File or folder of the controller's own code, copied to where the process works.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> layout = ObservationLayout.for_plant(P10, ts_s=1e-4)
    >>> with ControllerProcess("classical-static") as process:
    ...     action, _ = process.make(P10, layout).predict(np.zeros((3, layout.size), np.float32))
    >>> action.shape
    (3,)
    """

    def __init__(self, name: str, code: Path | None = None) -> None:
        self.name, self._code = name, code
        self._asked_at: float | None = None
        self._over = threading.Event()

    def __enter__(self) -> ControllerProcess:
        self._folder = TemporaryDirectory(prefix="controller-", ignore_cleanup_errors=True)
        here = Path(self._folder.name)
        if self._code is not None:
            self.name = _moved(self.name, self._code, here)
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-m", "benchmarks.stages.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=here,
            env=environment_in(here),
            start_new_session=True,
        )
        threading.Thread(target=self._watch, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: object, where: TracebackType | None
    ) -> None:
        self._over.set()
        _kill(self._process)
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):  # what was still to be written has no reader
                    pipe.close()
        self._process.wait()
        self._folder.cleanup()

    def make(self, belief: PlantModel, layout: ObservationLayout) -> RemoteController:
        """Make the controller anew."""
        document = {
            "controller": self.name,
            "belief": belief.to_dict(),
            "layout": layout.to_dict(),
        }
        stated = json.loads(self.ask(MAKE, DOCUMENT, json.dumps(document).encode()))
        return (RemotePlanner if stated["plans"] else RemoteController)(self, stated)

    def ask(self, kind: bytes, wanted: bytes, *content: bytes) -> bytes:
        """Send a request, and return the content of the answer."""
        stdin, stdout = self._process.stdin, self._process.stdout
        if stdin is None or stdout is None:
            raise ControllerFailed("its process has no pipes")
        self._asked_at = time.monotonic()
        try:
            stdin.write(HEAD.pack(kind, sum(map(len, content))))
            for part in content:
                stdin.write(part)
            stdin.flush()
            head = stdout.read(HEAD.size)
            found, size = HEAD.unpack(head) if len(head) == HEAD.size else (b"", 0)
            answer = stdout.read(size) if size <= _LARGEST else b""
        except OSError:
            found, size, answer = b"", 0, b""
        waited, self._asked_at = time.monotonic() - self._asked_at, None
        if found == FAILURE:
            raise ControllerFailed(one_line(answer.decode(errors="replace")))
        if found != wanted or len(answer) < size:
            late = f"after {waited:.0f} s without an answer" if waited > PATIENCE_S else "early"
            raise ControllerFailed(f"its process ended {late}, or answered something else")
        return answer

    def processor_s(self) -> float:
        """Processor time (s) that the process has taken; the kernel says so on Linux, elsewhere itself."""
        if _HAS_CLOCKS:
            return time.clock_gettime(~self._process.pid << 3 | _PROCESS_CLOCK)
        return float(json.loads(self.ask(TIME, DOCUMENT)))

    def _watch(self) -> None:
        while not self._over.wait(1.0):
            since = self._asked_at
            if since is not None and time.monotonic() - since > PATIENCE_S:
                _kill(self._process)


class RemoteController:
    """A controller whose code runs in a :class:`ControllerProcess`.

    It sees the lanes in an order of chance, so none tells which episodes share a plant.
    """

    def __init__(self, process: ControllerProcess, stated: dict[str, Any]) -> None:
        self._process = process
        self._order = np.empty(0, dtype=np.int64)
        self.repeats = bool(stated["repeats"])
        self.plant_samples = int(stated["plant_samples"])
        self.processor_s = process.processor_s

    def predict(
        self,
        observation: NDArray[Any],
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[Any], Any]:
        """Return an action for each lane; the process itself keeps what it remembers."""
        lanes = len(observation)
        order = self._ordered(lanes)
        sent = np.asarray(observation, dtype=np.float32)[order]
        kind = FIRST if state is None else NEXT
        answer = self._process.ask(kind, ACTION, sent.tobytes())
        if len(answer) != 8 * lanes:
            raise ControllerFailed(f"an answer of {len(answer)} bytes for {lanes} lanes")
        action = np.empty(lanes)
        action[order] = np.frombuffer(answer)
        return action, self

    def learn(self, *signals: Array) -> None:
        """Hand over a pass: reference, measured displacement (µm) and command (V), ``(K, B)`` each."""
        self._process.ask(LEARN, DOCUMENT, self._bytes(signals))

    def statements(self) -> dict[str, Any]:
        """Return what the controller says of itself now."""
        return dict(json.loads(self._process.ask(STATE, DOCUMENT)))

    def warning(self) -> str | None:
        """Return its warning, one line."""
        return self._text("warning")

    def certificate(self) -> str | None:
        """Return its certificate, one line."""
        return self._text("certificate")

    @property
    def is_confined(self) -> bool:
        """Whether the kernel keeps its process from files and from other processes."""
        return bool(self.statements()["confined"])

    def _ordered(self, lanes: int) -> NDArray[np.int64]:
        """Return the order in which that many lanes are shown, the same from pass to pass."""
        if len(self._order) != lanes:
            self._order = np.random.default_rng().permutation(lanes)
        return self._order

    def _bytes(self, signals: Sequence[Array]) -> bytes:
        lanes = int(signals[0].shape[1])
        stacked = np.stack(signals).astype(np.float64)[..., self._ordered(lanes)]
        return lanes.to_bytes(8, "little") + stacked.tobytes()

    def _text(self, name: str) -> str | None:
        value = self.statements()[name]
        return None if value is None else one_line(value)


class RemotePlanner(RemoteController):
    """One that is given the whole reference beforehand."""

    def plan(self, reference_um: Array) -> None:
        """Hand over the reference (µm), ``(K, B)``."""
        self._process.ask(PLAN, DOCUMENT, self._bytes([reference_um]))


def _moved(name: str, code: Path, folder: Path) -> str:
    """Copy a controller's code into a folder, and return its name there."""
    prefix, _, attribute = name.partition(":")
    if policy_of(name) is None:
        shutil.copyfile(code, folder / code.name, follow_symlinks=False)
        return f"{code.stem}:{attribute}"
    check_plain([code, *(each for each in code.rglob("*") if each.is_dir())])
    shutil.copytree(code, folder / code.name)
    return f"{prefix}:{code.name}"


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a process and, where there are sessions, all that it started."""
    process.kill()
    if os.name == "posix":
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def own_code(name: str) -> Path | None:
    """Return the one file in which ``module:attribute`` is defined, None where there is none; nothing is run."""
    module = name.partition(":")[0]
    if module.isidentifier():
        find_here(module)
        spec = find_spec(module)
    else:  # to find a module of a package would import the package
        spec = getattr(sys.modules.get(module), "__spec__", None)
    if spec is None or spec.origin is None or spec.submodule_search_locations:
        return None
    return Path(spec.origin) if Path(spec.origin).is_file() else None
