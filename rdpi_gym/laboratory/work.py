"""Long work in processes of their own: progress as it comes, and a cancel that takes effect at once."""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import IO, Any

from rdpi_gym.support.errors import InputError

Message = tuple[Any, ...]
"""``("progress", stage, done, total)``, ``("news", what, value)``, or at the end ``("done", value)``,
``("refused", line)``, ``("died", line)``."""
Listener = Callable[[Message], None]
Task = Callable[..., Any]
"""Called with ``tell`` (see :class:`Tell`) and its own arguments, in a worker process."""

# the path is handed over: modules that the user named are found, those of the current folder are not
_PROGRAM = """\
import json, sys
sys.path[:], helpers = json.loads(sys.argv[1])
from rdpi_gym.laboratory.worker import main
main(helpers)
"""
_WAIT_S = 0.3  # until a process that was asked to end is killed
_OFTEN_S = 0.1  # progress is not told more often than that
_ORPHAN_S = 1.0
_RESERVE_S = (
    10.0  # after the start of a job, until a process is made that takes its place if need be
)


@dataclass(frozen=True)
class Tell:
    """Callbacks of a task; `send` takes a message to the server."""

    send: Callable[[Message], None]

    def progress(self, stage: str, done: int, total: int) -> None:
        """Tell where the job stands, as :class:`rdpi_gym.support.progress.Progress` says."""
        self.send(("progress", stage, done, total))

    def news(self, what: str, value: Any) -> None:
        """Tell a result that is there already."""
        self.send(("news", what, value))


class Worker:
    """A process in a group of its own, with everything loaded that a job needs.

    A `warm` one loads what jobs need, and starts its `helpers`, before the first job comes.

    Examples
    --------
    >>> worker = Worker(warm=False)
    >>> worker.stop()
    >>> worker.is_alive
    False
    """

    def __init__(self, warm: bool = True, helpers: int = 0) -> None:
        start = json.dumps([sys.path, helpers if warm else None])
        command = [sys.executable, "-P", "-c", _PROGRAM, start]
        # what cleans up behind processes that were ended says so at length
        quiet = {
            **os.environ,
            "PYTHONSAFEPATH": "1",  # its own children import nothing from the current folder either
            "PYTHONWARNINGS": "ignore:resource_tracker:UserWarning",
        }
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
            env=quiet,
        )
        self._listener: Listener | None = None
        self._lock = threading.Lock()
        threading.Thread(target=self._listen, daemon=True).start()

    @property
    def is_alive(self) -> bool:
        """True while the process runs."""
        return self._process.poll() is None

    def begin(self, task: Task, arguments: dict[str, Any], listener: Listener) -> None:
        """Start a task; one at a time."""
        with self._lock:
            self._listener = listener
        try:
            assert self._process.stdin is not None
            pickle.dump((task, arguments), self._process.stdin)
            self._process.stdin.flush()
        except OSError:
            self._over(self._died())

    def stop(self) -> None:
        """End the process and all that it started; no message comes any more."""
        with self._lock:
            self._listener = None
        # what holds shared memory of the group ignores this signal, cleans up and ends by itself
        _signal_group(self._process.pid, signal.SIGTERM)
        try:
            self._process.wait(_WAIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with contextlib.suppress(EOFError, pickle.UnpicklingError, OSError):
            while True:
                message: Message = pickle.load(self._process.stdout)
                if message[0] in ("done", "refused"):
                    self._over(message)
                else:
                    with self._lock:
                        listener = self._listener
                    if listener is not None:
                        listener(message)
        self._process.wait()
        _signal_group(self._process.pid, signal.SIGTERM)  # those that it left behind
        self._over(self._died())

    def _died(self) -> Message:
        try:
            status = self._process.wait(_WAIT_S)
        except subprocess.TimeoutExpired:  # it lives, but does not listen
            self.stop()
            status = self._process.wait()
        why = f"signal {-status}" if status < 0 else f"status {status}"
        hint = "; close other programs or give fewer samples" if status == -9 else ""
        return ("died", f"the process that did the work died ({why}){hint}; start it again")

    def _over(self, message: Message) -> None:
        with self._lock:
            listener, self._listener = self._listener, None
        if listener is not None:
            listener(message)


class Workers:
    """One worker at work and one in reserve, so that a job begins at once after a cancel."""

    def __init__(self, make: Callable[..., Worker] = Worker, helpers: int = 0) -> None:
        self._make = make
        self._ready = [make(helpers=helpers)]
        self._lock = threading.Lock()
        self._busy: Worker | None = None
        self._closed = False

    def begin(
        self,
        task: Task,
        arguments: dict[str, Any],
        listener: Listener,
        wanted: Callable[[], bool] = lambda: True,
    ) -> None:
        """Start a task; what was at work is stopped."""
        self.cancel()
        with self._lock:
            if not wanted():
                return
            self._ready = [w for w in self._ready if w.is_alive] or [self._make()]
            worker = self._busy = self._ready.pop(0)
        # not at once: it would take a core from the job that begins
        later = threading.Timer(_RESERVE_S, self._reserve)
        later.daemon = True
        later.start()

        def heard(message: Message) -> None:
            if message[0] in ("done", "refused", "died"):
                self._free(worker)
            listener(message)

        worker.begin(task, arguments, heard)

    def cancel(self) -> bool:
        """Stop what is at work; True where something was."""
        with self._lock:
            worker, self._busy = self._busy, None
        if worker is None:
            return False
        worker.stop()
        self._reserve()
        return True

    def close(self) -> None:
        """End all processes."""
        with self._lock:
            workers = [*self._ready, *([self._busy] if self._busy else [])]
            self._ready, self._busy, self._closed = [], None, True
        for worker in workers:
            worker.stop()

    def _reserve(self) -> None:
        with self._lock:
            if not self._closed and not self._ready:
                self._ready.append(self._make())

    def _free(self, worker: Worker) -> None:
        with self._lock:
            if self._busy is worker:
                self._busy = None
                if worker.is_alive:
                    self._ready.insert(0, worker)
        self._reserve()


def _signal_group(group: int, number: int) -> None:
    if not hasattr(os, "killpg"):  # Windows
        return
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(group, number)


def serve(tasks: IO[bytes], answers: IO[bytes]) -> None:
    """Do the tasks that come, one after the other, until none can come any more."""
    lock, told = threading.Lock(), dict[str, float]()

    def send(message: Message) -> None:
        now = time.monotonic()
        with lock:
            if message[0] == "progress":
                _, stage, done, total = message
                if 0 < done < total and now - told.get(stage, 0.0) < _OFTEN_S:
                    return
                told[stage] = now
            pickle.dump(message, answers)
            answers.flush()

    while True:
        try:
            task, arguments = pickle.load(tasks)
        except EOFError:
            return
        told.clear()
        try:
            send(("done", task(Tell(send), **arguments)))
        except InputError as error:
            send(("refused", error.fact))
        except BrokenPipeError:  # nobody waits for it any more
            return
        except Exception as error:
            import traceback

            traceback.print_exc()
            line = " ".join(f"{type(error).__name__}: {error}".split())
            send(("refused", f"this failed in a way that nobody foresaw ({line[:200]}); report it"))


def end_with_parent() -> None:
    """End this process and its own where the one that started it is gone, killed or not."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_ORPHAN_S)
    _signal_group(os.getpgrp() if hasattr(os, "getpgrp") else 0, signal.SIGTERM)
    os._exit(1)
