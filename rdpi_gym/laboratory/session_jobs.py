"""A session with its running job, its models and its listeners."""

from __future__ import annotations

import asyncio
import itertools
import json
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from rdpi_gym import face
from rdpi_gym.laboratory import jobs, views
from rdpi_gym.laboratory.session import Session, Step, error_um
from rdpi_gym.laboratory.session_json import cards_of
from rdpi_gym.laboratory.work import Message, Task, Workers
from rdpi_gym.measurement.quantities import in_output
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

_OFTEN_S, _PING_S = 0.1, 15.0
_MOST_WAITING = 500


class Events:
    """Listeners, and what they are told; used in the loop of the server alone."""

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
        """Disconnect all listeners."""
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
    """The task that a worker runs."""

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
    """A session and the job that runs on it, divided among processes; used in the loop of the server alone."""

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
        return {"data": self.session.need_data(), **arguments}


_TIMES_FLOOR = 1.15  # of the noise: up to here nothing is left that matters
_KEPT = 6  # responses
_LATER_S = 2.0


@dataclass(frozen=True)
class Pending:
    """A step that is made as soon as its model is there."""

    label: str
    made: Mapping[str, Any]
    parent: str | None
    held: tuple[str, ...] = ()


class Models(SessionJobs):
    """A session whose models are tried, ranked on and made steps of."""

    def __init__(self, folder: Path, events: Events, processes: int) -> None:
        super().__init__(folder, events, processes)
        self.pictures: Mapping[str, Any] = {}
        self._looking = threading.Lock()
        self._looked: tuple[face.Dataset, face.Inspection] | None = None
        self._responses: dict[int, tuple[PlantModel, face.Response]] = {}

    def start(self) -> None:
        """Begin to listen to workers, and draw what cards show."""
        super().start()
        self._in_background(self._draw())

    # models on records: called in threads

    def respond(self, plant: PlantModel, keep: bool = True) -> face.Response:
        """Return what a model makes of all records; the last few are kept."""
        found = self._responses.get(id(plant))
        if found is not None and found[0] is plant:
            return found[1]
        response = self._look().respond(plant)
        if keep:
            if len(self._responses) >= _KEPT:
                self._responses.clear()
            self._responses[id(plant)] = (plant, response)
        return response

    def displacement(self, plant: PlantModel, record: str) -> Array:
        """Return the displacement of a model (µm) on a record, its offset free."""
        return self.respond(plant).model_um[record]

    def plant_shown(self, step: str | None) -> PlantModel | None:
        """Return the model of a step, by default the present one; None where there is none."""
        name = step or self.session.current
        return None if name is None else self.session.step(name).plant

    def plant_with(self, effect: str, step: str | None) -> PlantModel | None:
        """Return the model of a step with a candidate; None where it was not tried."""
        name = step or self.session.current
        ranking = None if name is None else self.session.rankings.get(name)
        return None if ranking is None else ranking.plant_with(effect)

    def _look(self) -> face.Inspection:
        data = self.session.need_data()
        with self._looking:
            if self._looked is None or self._looked[0] is not data:
                self._responses.clear()
                self._looked = (data, face.inspect(data))
            return self._looked[1]

    def _look_ahead(self) -> None:
        async def looked() -> None:
            await asyncio.to_thread(self._look)

        self._in_background(looked())

    # rankings and steps

    def _rank_from(
        self,
        step: Step | None,
        model: PlantModel | None,
        pending: Pending | None,
        core: str | None,
    ) -> None:
        """Rank on a step, or on one that is made when its base model is there."""
        here = step
        if here is not None:
            self.session.write({"do": "ranking", "step": here.id, "status": "running"})

        def heard(what: str, refit: Mapping[str, Any]) -> None:
            nonlocal here
            if here is None:
                assert pending is not None
                here = self._make_step(pending, refit)
                self.session.write({"do": "ranking", "step": here.id, "status": "running"})
            elif not refit["effect"]:
                here = self._bettered(here, refit)
            self.session.write({"do": "refit", "step": here.id, "refit": refit})
            if not refit["effect"]:
                self.events.changed()
            # a better form of what is there has no card
            for card in cards_of(self.session, here.id, self.pictures):
                if card["effect"] == refit["effect"]:
                    self.events.push("card", {"step": here.id, **card})

        def ended(status: str, result: Any = None, line: str | None = None) -> None:
            if here is None:
                self.problem = line
                return
            event = {"do": "ranking", "step": here.id, "status": status}
            self.session.write({**event, "result": result, "problem": line})

        label = "Ranking candidates" if pending is None else pending.label
        arguments = {"model": model, "core": core, "jobs": self._processes}
        self._begin(
            "rank" if model is not None else "fit",
            label,
            jobs.rank,
            self._with_data(arguments),
            lambda result: ended("done", result),
            lambda status, line: ended(status, None, line if status == "failed" else None),
            heard,
        )

    def _bettered(self, step: Step, refit: Mapping[str, Any]) -> Step:
        """Take the search's own refit of a step's model where it leaves less, or is the first.

        All candidates stand on the search's base model, so the staircase does too.
        """
        plant, kind = refit["plant"], step.made["kind"]
        if step.held or kind in ("set", "settled") or plant is None:
            return step
        if kind != "fit" and error_um(refit) >= step.validation_um:
            return step
        better = replace(
            step,
            plant=PlantModel.from_dict(plant, "the base model"),
            train_um=refit["train_um"],
            validation_um=refit["validation_um"],
            by_record_um=refit["by_record_um"],
        )
        self.session.write({"do": "update", "step": better.to_dict()})
        self._describe(better.id)
        return better

    def _make_step(self, pending: Pending, found: Mapping[str, Any]) -> Step:
        step = Step(
            self.session.next_id(),
            pending.parent,
            pending.label,
            pending.made,
            PlantModel.from_dict(found["plant"], pending.label),
            found["train_um"],
            found["validation_um"],
            found["by_record_um"],
            pending.held,
        )
        self.session.write({"do": "step", "step": step.to_dict()})
        self._describe(step.id)
        self.events.changed()
        return step

    def _describe(self, step: str) -> None:
        """Find the sentence on where a step fails most, in the background."""
        self._in_background(self._compare(self.session.step(step)))

    async def _compare(self, step: Step) -> None:
        found = await asyncio.to_thread(face.compare, self.session.need_data(), step.plant)
        if self.session.steps.get(step.id) is not step:
            return  # it has moved on meanwhile
        sentence = _sentence(step.validation_um, found)
        noise_um = found.noise_floor_um
        self.session.write(
            {"do": "said", "step": step.id, "sentence": sentence, "noise_um": noise_um}
        )
        self.events.changed()

    async def _draw(self) -> None:
        await asyncio.sleep(_LATER_S)  # there is more urgent work when the page is opened
        self.pictures = await asyncio.to_thread(views.pictures)
        await asyncio.to_thread(import_module, "scipy.signal")  # for the first view
        self.events.changed()


def _sentence(validation_um: float, found: face.Comparison | face.ModelComparison) -> str:
    """State the residual error, and the records with most of it."""
    assert isinstance(found, face.Comparison)
    floor = found.noise_floor_um
    error = in_output(validation_um)
    if floor > 0 and validation_um <= _TIMES_FLOOR * floor:
        said = f"Validation error {error}, no more than noise ({in_output(floor)})."
    else:
        times = f", {validation_um / floor:.1f} times the noise" if floor > 0 else ""
        where = found.findings.get("records", found.findings.get("largest", ""))
        said = f"Validation error {error}{times}. {where}".strip()
    return found.quantities.fill(said)
