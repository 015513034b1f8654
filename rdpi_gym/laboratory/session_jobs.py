"""What a server works with: its session, the job that runs, and what goes on behind."""

from __future__ import annotations

import asyncio
import itertools
import json
import sys
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rdpi_gym import face
from rdpi_gym.laboratory.session import Session, Step
from rdpi_gym.laboratory.work import Message, Task, Workers
from rdpi_gym.support.errors import InputError

_OFTEN_S, _PING_S = 0.1, 15.0
_MOST_WAITING = 500


class Events:
    """Listeners, and what they are told; used in the loop of the server alone.

    Attributes
    ----------
    state : callable
        Returns the whole state.
    """

    def __init__(self) -> None:
        self.state: Callable[[], dict[str, Any]] = dict
        self._listeners: set[asyncio.Queue[str | None]] = set()
        self._waits = False

    def push(self, event: str, data: dict[str, Any]) -> None:
        """Tell all listeners of an event."""
        text = f"event: {event}\ndata: {json.dumps(data, ensure_ascii=False, allow_nan=False)}\n\n"
        for queue in [*self._listeners]:
            if queue.qsize() < _MOST_WAITING:  # a page that sleeps hears the state when it wakes
                queue.put_nowait(text)

    def changed(self) -> None:
        """Tell all listeners the whole state, soon."""
        if not self._waits:
            self._waits = True
            asyncio.get_running_loop().call_later(_OFTEN_S, self._tell)

    def close(self) -> None:
        """Let all listeners go."""
        for queue in self._listeners:
            queue.put_nowait(None)

    def _tell(self) -> None:
        self._waits = False
        if self._listeners:
            self.push("state", self.state())

    async def listen(self) -> AsyncIterator[str]:
        """Yield events as they go over the wire, the whole state first."""
        queue: asyncio.Queue[str | None] = asyncio.Queue()
        self._listeners.add(queue)
        try:
            state = json.dumps(self.state(), ensure_ascii=False, allow_nan=False)
            yield f"event: state\ndata: {state}\n\n"
            while True:
                try:
                    text = await asyncio.wait_for(queue.get(), _PING_S)
                except TimeoutError:
                    yield "event: ping\ndata: {}\n\n"
                    continue
                if text is None:
                    return
                yield text
        finally:
            self._listeners.discard(queue)


@dataclass
class Job:
    """What a worker does just now."""

    id: str
    what: str
    label: str
    began_s: float
    finish: Callable[[Any], None]
    fail: Callable[[str, str], None]
    """Called with ``cancelled`` or ``failed`` and a line."""
    heard: Callable[[str, Any], None] = lambda what, value: None
    stage: str = ""
    done: int = 0
    total: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Return what the page is told."""
        keys = ("id", "what", "label", "stage", "done", "total")
        seconds = round(time.monotonic() - self.began_s, 2)
        return {**{key: getattr(self, key) for key in keys}, "seconds": seconds}


class SessionJobs:
    """A session and the job that runs on it; used in the loop of the server alone.

    Parameters
    ----------
    folder
        Of the session.
    events
        Who listens.
    processes
        Among which a ranking divides its candidates.
    """

    def __init__(self, folder: Path, events: Events, processes: int) -> None:
        self.session = Session(folder)
        self.events = events
        self.acting = asyncio.Lock()
        """Held by what changes the session: a second click waits for the first."""
        self.job: Job | None = None
        self.problem: str | None = None
        self._processes = processes
        self._workers = Workers(helpers=processes)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ids = itertools.count(1)
        self._tasks: set[asyncio.Task[None]] = set()

    def start(self) -> None:
        """Begin to listen to workers: called once, in the loop of the server."""
        self._loop = asyncio.get_running_loop()

    def close(self) -> None:
        """End all work."""
        self._workers.close()

    def _begin(
        self,
        what: str,
        label: str,
        task: Task,
        arguments: dict[str, Any],
        finish: Callable[[Any], None],
        fail: Callable[[str, str], None] | None = None,
        heard: Callable[[str, Any], None] = lambda what, value: None,
    ) -> None:
        def failed(status: str, line: str) -> None:
            if status == "failed":
                self.problem = line

        self.problem = None
        job = Job(
            f"j{next(self._ids)}", what, label, time.monotonic(), finish, fail or failed, heard
        )
        self.job = job
        loop = self._loop
        assert loop is not None

        def message(told: Message) -> None:
            loop.call_soon_threadsafe(self._on, job, told)

        # a task and its data are written into a pipe: not in the loop
        self._in_background(self._hand_over(job, task, arguments, message))
        self.events.changed()

    async def _hand_over(
        self, job: Job, task: Task, arguments: dict[str, Any], listener: Callable[[Message], None]
    ) -> None:
        begin = self._workers.begin
        await asyncio.to_thread(begin, task, arguments, listener, lambda: self.job is job)

    def _on(self, job: Job, message: Message) -> None:
        """Hear a worker; one whose job is over is not heard any more."""
        if self.job is not job:
            return
        try:
            self._hear(job, message)
        except InputError as error:  # the journal cannot be written
            self.job = None
            self.problem = error.fact
            self.events.changed()

    def _hear(self, job: Job, message: Message) -> None:
        kind, *told = message
        if kind == "progress":
            job.stage, job.done, job.total = told
            self.events.push("progress", job.to_dict())
            return
        if kind == "news":
            what, value = told
            job.heard(what, value)
            return
        self.job = None
        if kind == "done":
            job.finish(told[0])
        else:
            job.fail("failed", told[0])
        self.events.changed()

    async def _stop(self) -> None:
        """Stop the job, if any, and say so where it stands."""
        job, self.job = self.job, None
        if job is None:
            return
        await asyncio.to_thread(self._workers.cancel)
        job.fail("cancelled", f"{job.label}: cancelled")
        self.events.changed()

    def _in_background(self, work: Any) -> None:
        async def guarded() -> None:
            try:
                await work
            except InputError as error:
                self.problem = error.fact
                self.events.changed()

        task = asyncio.get_running_loop().create_task(guarded())
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            print(f"rdpi lab: {type(error).__name__}: {error}", file=sys.stderr)

    def _with_data(self, arguments: dict[str, Any]) -> dict[str, Any]:
        return {"data": self.need_data(), **arguments}

    def need_data(self) -> face.Dataset:
        """Return the records."""
        data = self.session.data
        if data is None:
            raise InputError("there are no data yet; drop a file or take an exercise")
        return data

    def _current(self) -> Step:
        current = self.session.current
        if current is None:
            raise InputError("there is no model yet; drop a file or take an exercise")
        return self.session.step(current)
