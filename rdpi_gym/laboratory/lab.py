"""The laboratory behind its page: what each action does, and what the page is told."""

from __future__ import annotations

import asyncio
import itertools
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import rdpi_gym as rg
from rdpi_gym.laboratory import bringing, jobs, views
from rdpi_gym.laboratory.buying import course
from rdpi_gym.laboratory.events import Events
from rdpi_gym.laboratory.examples import examples, folder_of
from rdpi_gym.laboratory.session import Session, Step
from rdpi_gym.laboratory.work import Message, Task, Workers
from rdpi_gym.measurement import Quantities
from rdpi_gym.plant import CORES, PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import micrometres, quoted

_TIMES_FLOOR = 1.15  # of the noise: up to here nothing is left that matters
_KEPT = 6  # responses
_LATER_S = 2.0


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


@dataclass(frozen=True)
class Pending:
    """A step that is made as soon as its model is there."""

    label: str
    made: Mapping[str, Any]
    parent: str | None
    held: tuple[str, ...] = ()


class Lab:
    """One session at work; its actions are called from the loop of the server alone.

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
        self.job: Job | None = None
        self.problem: str | None = None
        self.pictures: Mapping[str, Any] = {}
        self._processes = processes
        self._workers = Workers()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ids = itertools.count(1)
        self._tasks: set[asyncio.Task[None]] = set()
        self._looking = threading.Lock()
        self._looked: tuple[rg.Dataset, rg.Inspection] | None = None
        self._responses: dict[int, tuple[PlantModel, rg.Response]] = {}

    def start(self) -> None:
        """Begin to listen to workers: called once, in the loop of the server."""
        self._loop = asyncio.get_running_loop()
        self._in_background(self._draw())

    def close(self) -> None:
        """End all work."""
        self._workers.close()

    # what the page is told

    def state(self) -> dict[str, Any]:
        """Return everything that the page shows but traces."""
        session = self.session
        data, current = session.data, session.current
        said = {} if current is None else session.said.get(current, {})
        quantities = Quantities() if data is None else data.quantities
        return {
            "title": "New session" if data is None else data.title,
            "session_folder": str(session.folder),
            "problem": self.problem,
            "quantities": views.quantities_of(quantities),
            "files": [{"name": name, **entry} for name, entry in sorted(session.files.items())],
            "records": self._records(),
            "settings": self._settings(),
            "noise_um": self.noise_um(),
            "steps": {id: views.step_row(step) for id, step in session.steps.items()},
            "path": session.path,
            "redo": session.redo,
            "current": current,
            "sentence": said.get("sentence"),
            "ranking": self._ranking(),
            "job": None if self.job is None else self.job.to_dict(),
            "payoff": None if current is None else session.payoffs.get(current),
        }

    def _records(self) -> list[dict[str, Any]]:
        data, folder = self.session.data, self.session.data_folder
        if data is None:
            return []
        said = bringing.settings_of(folder).get("records", {})
        files = {file.stem: file.name for file in bringing.data_files(folder)}
        only = next(iter(files.values()), "")
        return [
            views.record_row(r, files.get(r.name, only), said.get(r.name, {})) for r in data.records
        ]

    def _settings(self) -> dict[str, Any]:
        folder = self.session.data_folder
        document = bringing.settings_of(folder)
        chosen = document.get("columns", {})
        plain = {"time": "t", "input": "u", "output": "y"}
        columns = {
            file.name: {
                "available": bringing.columns_of(file),
                **{key: chosen.get(column) for key, column in plain.items()},
            }
            for file in bringing.data_files(folder)
        }
        units = document.get("units", {})
        return {
            "title": document.get("title"),
            "skip_s": document.get("skip_s"),
            "columns": columns,
            "units": {key: units.get(column) for key, column in plain.items()},
            "quantities": document.get("quantities", {}),
            "cores": [{"key": key, "title": core.title} for key, core in CORES.items()],
        }

    def noise_um(self) -> float | None:
        """Return the noise floor (µm rms) as far as it is known."""
        session, current = self.session, self.session.current
        for step in [] if current is None else reversed(session.path):
            ranking = session.rankings.get(step)
            if ranking is not None and ranking.result is not None:
                return float(ranking.result["noise_floor"])
        said = [session.said[s]["noise_um"] for s in session.path if s in session.said]
        return min(said, default=None)

    def _ranking(self) -> dict[str, Any] | None:
        session, current = self.session, self.session.current
        ranking = None if current is None else session.rankings.get(current)
        if current is None or ranking is None:
            return None
        result = ranking.result
        return {
            "step": ranking.step,
            "status": ranking.status,
            "problem": ranking.problem,
            "cards": self._cards(current),
            "verdict": None if result is None else result["headline"],
            "lines": [] if result is None else result["lines"],
            "left": None if result is None else self._left(current, result),
        }

    def _left(self, step: str, result: Mapping[str, Any]) -> dict[str, Any]:
        return {
            "sentence": result["remainder"],
            "portrait_lines": result["portrait_lines"],
            "next_experiment": result["next_experiment"],
            "experiment": result.get("experiment"),
        }

    def _cards(self, step: str) -> list[dict[str, Any]]:
        session = self.session
        ranking, own = session.rankings[step], session.step(step)
        base = ranking.refits.get(("", ""))
        base_um = own.validation_um if base is None else base["validation_um"]
        plant = own.plant
        return views.cards(
            ranking,
            base_um,
            self.noise_um(),
            type(plant.hysteresis),
            {effect.name for effect in plant.effects},
            self.pictures,
        )

    # bringing data

    async def put_file(self, name: str, write: Callable[[Path], Any]) -> dict[str, Any]:
        """Take a file that is sent; `write` puts its content to a path.

        Raises
        ------
        InputError
            Its name is no data file's, or there are too many.
        """
        session = self.session
        try:
            safe = bringing.safe_name(name)
        except InputError as error:
            shown = name[-80:]
            entry = {"bytes": 0, "problem": str(error), "row": None, "column": None}
            session.write({"do": "file", "name": shown, "entry": entry})
            self.events.changed()
            raise
        if len(session.files) >= bringing.MOST_FILES and safe not in session.files:
            raise InputError(f"there are {bringing.MOST_FILES} files already; take one out first")
        target = session.data_folder / safe
        part = target.with_name(f".{safe}.part")
        try:
            await write(part)
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
        bringing.refused_file(session.data_folder, safe).unlink(missing_ok=True)
        if safe != bringing.SETTINGS:
            self._note_file(safe, None)
        self.events.changed()
        return self.state()

    def _note_file(self, name: str, problem: bringing.Problem | None) -> None:
        folder = self.session.data_folder
        places = (folder / name, bringing.refused_file(folder, name))
        size = next((p.stat().st_size for p in places if p.exists()), 0)
        entry = {
            "bytes": size,
            "problem": None if problem is None else problem.line,
            "row": None if problem is None else problem.row,
            "column": None if problem is None else problem.column,
        }
        if {**self.session.files.get(name, {})} != entry:
            self.session.write({"do": "file", "name": name, "entry": entry})

    async def delete_file(self, name: str) -> dict[str, Any]:
        """Take a file out; the data are read again by :meth:`open`.

        Raises
        ------
        InputError
            There is no such file.
        """
        session = self.session
        if name not in session.files:
            raise InputError(
                f"there is no file {quoted(name)}; there are {', '.join(session.files)}"
            )
        folder = session.data_folder
        for path in (folder / Path(name).name, bringing.refused_file(folder, Path(name).name)):
            path.unlink(missing_ok=True)
        session.write({"do": "file", "name": name, "entry": None})
        self.events.changed()
        return self.state()

    async def open(self, core: str | None = None) -> dict[str, Any]:
        """Read all files, fit the base model, and start the ranking: a new history.

        Where the records are those that are open (a file was refused, or taken out again), what was
        done with them goes on.

        Raises
        ------
        InputError
            No file can be read; the files say which and where.
        """
        session = self.session
        found = await asyncio.to_thread(bringing.read, session.data_folder)
        for file in bringing.data_files(session.data_folder):
            self._note_file(file.name, found.problems.get(file.name))
        for name, problem in found.problems.items():
            self._note_file(name, problem)
        self.problem = found.problem
        if found.data is None:
            self.events.changed()
            first = next(iter(found.problems.values()), None)
            raise InputError(
                found.problem or (first.line if first else "there are no data yet; drop a file")
            )
        if core is None and session.steps and bringing.same(found.data, session.data):
            self.events.changed()
            return self.state()
        await self._stop()
        session.begin(found.data)
        self._look_ahead()
        made = {"kind": "fit", "core": core}
        self._rank_from(None, None, Pending("Base model", made, None), core)
        return self.state()

    async def bring(self, sources: list[Path]) -> None:
        """Copy files and folders that the command line names, and open them."""
        for source in sources:
            names = await asyncio.to_thread(bringing.copy_in, source, self.session.data_folder)
            for name in names:
                self._note_file(name, None)
        await self.open()

    async def take_example(self, key: str) -> dict[str, Any]:
        """Begin with an exercise or a measured example, in place of the files that are there.

        Raises
        ------
        InputError
            There is no such example.
        """
        known = {example.key: example for example in examples()}
        if key not in known:
            raise InputError(f"there is no example {quoted(key)}; there are {', '.join(known)}")
        await self._stop()
        example = known[key]
        session = self.session
        for name in [*session.files]:
            await self.delete_file(name)
        for path in [p for p in session.data_folder.iterdir() if p.is_file()]:
            path.unlink()
        folder = folder_of(example)
        if folder is not None:
            await self.bring([folder])
            return self.state()

        def written(data: rg.Dataset) -> None:
            named = replace(data, title=example.title)
            self._in_background(self._open_written(named))

        self._begin(
            "simulate", example.title, jobs.simulate, dict(example.simulated or {}), written
        )
        return self.state()

    async def _open_written(self, data: rg.Dataset) -> None:
        await asyncio.to_thread(data.write, self.session.data_folder)
        for file in bringing.data_files(self.session.data_folder):
            self._note_file(file.name, None)
        await self.open()

    async def set_settings(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Write what is said of the data, read again, fit again.

        Raises
        ------
        InputError
            A setting that there is not; one that the data cannot be read with is taken back.
        """
        session = self.session
        folder = session.data_folder
        records = [r.name for r in session.data.records] if session.data is not None else []
        records += [f.stem for f in bringing.data_files(folder) if f.stem not in records]
        path = folder / bringing.SETTINGS
        before = path.read_bytes() if path.exists() else None
        bringing.write_settings(folder, changes, records)
        try:
            return await self.open()
        except InputError:
            if session.data is not None:
                path.unlink() if before is None else path.write_bytes(before)
                await self.open()
            raise

    # models and steps

    async def set_core(self, core: str) -> dict[str, Any]:
        """Fit the base model with another kind of hysteresis: a new history.

        Raises
        ------
        InputError
            There is no such kind.
        """
        if core not in (*CORES, "auto"):
            raise InputError(f"core {quoted(core)} is unknown; give auto, {', '.join(CORES)}")
        self.need_data()
        return await self.open(core)

    async def rank(self) -> dict[str, Any]:
        """Rank all candidates on the present step; without one, begin anew."""
        if self.session.current is None:
            return await self.open()
        await self._stop()
        step = self._current()
        self._rank_from(step, step.plant, None, None)
        return self.state()

    async def add(self, effect: str) -> dict[str, Any]:
        """Add an effect as its refit left it, and rank on from there; refit it first where none is there.

        Raises
        ------
        InputError
            There is no such effect, or the model has it.
        """
        step = self._current()
        if effect not in rg.effects and effect != "unknown":
            raise InputError(
                f"effect {quoted(effect)} is unknown; give one of {', '.join(rg.effects)}"
            )
        if any(own.name == effect for own in step.plant.effects):
            raise InputError(f"the model has {effect} already; choose another effect")
        ranking = self.session.ranking_of(step.id)
        found = None if ranking is None else ranking.refit_of(effect)
        await self._stop()
        label = f"{views.title_of(effect)} added"
        if found is not None and found["plant"] is not None:
            made = {"kind": "candidate", "effect": effect, "form": found["form"]}
            new = self._make_step(Pending(label, made, step.id, step.held), found)
            self._rank_from(new, new.plant, None, None)
        else:
            pending = Pending(label, {"kind": "added", "effect": effect}, step.id, step.held)

            def added(found: Mapping[str, Any]) -> None:
                new = self._make_step(pending, found)
                self._rank_from(new, new.plant, None, None)

            arguments = {"effect": effect, "model": step.plant, "jobs": self._processes}
            self._begin("refit", label, jobs.add, self._with_data(arguments), added)
        return self.state()

    async def remove(self, effect: str) -> dict[str, Any]:
        """Take an effect out, refit everything, and rank on from there.

        Raises
        ------
        InputError
            The model does not have it.
        """
        step = self._current()
        names = [own.name for own in step.plant.effects]
        if effect not in names:
            raise InputError(
                f"the model has no effect {quoted(effect)}; it has {', '.join(names) or 'none'}"
            )
        await self._stop()
        kept = tuple(own for own in step.plant.effects if own.name != effect)
        held = tuple(name for name in step.held if not name.startswith(f"{effect}."))
        made = {"kind": "removal", "effect": effect}
        pending = Pending(f"{views.title_of(effect)} removed", made, step.id, held)
        self._rank_from(None, replace(step.plant, effects=kept), pending, None)
        return self.state()

    async def undo(self) -> dict[str, Any]:
        """Go back a step."""
        path = self.session.path
        if len(path) < 2:
            raise InputError("there is nothing to undo: this is the base model")
        return await self._go(path[:-1], [path[-1], *self.session.redo])

    async def redo(self) -> dict[str, Any]:
        """Go forward again."""
        redo = self.session.redo
        if not redo:
            raise InputError("there is nothing to redo")
        return await self._go([*self.session.path, redo[0]], redo[1:])

    async def go(self, step: str) -> dict[str, Any]:
        """Go to a step."""
        path, chain = [*self.session.path, *self.session.redo], self.session.chain(step)
        later = path[len(chain) :] if path[: len(chain)] == chain else []
        return await self._go(chain, later)

    async def _go(self, path: list[str], redo: list[str]) -> dict[str, Any]:
        await self._stop()
        self.session.write({"do": "go", "path": path, "redo": redo})
        self.events.changed()
        return self.state()

    async def hold(self, effect: str, parameter: str, held: bool) -> dict[str, Any]:
        """Let refits leave a parameter alone, or not any more."""
        step = self._current()
        name = self._parameter(step.plant, effect, parameter)
        others = tuple(each for each in step.held if each != name)
        changed = replace(step, held=(*others, name) if held else others)
        self.session.write({"do": "update", "step": changed.to_dict()})
        self.events.changed()
        return self.state()

    async def refit(self) -> dict[str, Any]:
        """Fit the present model anew from where it stands; what is held stays."""
        await self._stop()
        step = self._current()
        made = {"kind": "refit", "held": list(step.held)}
        pending = Pending("Refitted", made, step.id, step.held)
        arguments = self._with_data({"model": step.plant, "held": list(step.held)})

        def refitted(found: Mapping[str, Any]) -> None:
            self._make_step(pending, found)

        self._begin("refit", "Refitting", jobs.refit, arguments, refitted)
        return self.state()

    def moved(self, effect: str, parameter: str, value: float) -> PlantModel:
        """Return the present model with a parameter at another value.

        Raises
        ------
        InputError
            There is no such parameter, or the value is not physical.
        """
        plant = self._current().plant
        self._parameter(plant, effect, parameter)
        if not effect:
            return replace(plant, hysteresis=plant.hysteresis.with_shape({parameter: value}))
        own = tuple(
            e.with_values({parameter: value}) if e.name == effect else e for e in plant.effects
        )
        return replace(plant, effects=own)

    async def set_parameter(self, effect: str, parameter: str, value: float) -> dict[str, Any]:
        """Make a step of the present model with a parameter set by hand."""
        plant = self.moved(effect, parameter, value)
        await self._stop()
        step = self._current()
        response = await asyncio.to_thread(self.respond, plant)
        errors = response.errors
        made = {"kind": "set", "effect": effect, "parameter": parameter, "value": value}
        name = f"{views.title_of(effect)} {parameter}" if effect else parameter
        found = {
            "plant": plant.to_dict(),
            "train_um": errors.train_rmse_um,
            "validation_um": errors.validation_rmse_um,
            "by_record_um": dict(errors.by_record_um),
        }
        self._make_step(Pending(f"{name} set by hand", made, step.id, step.held), found)
        return self.state()

    async def cancel(self) -> dict[str, Any]:
        """Stop what is at work; answers when it is dead."""
        await self._stop()
        return self.state()

    async def payoff(self, reference: Mapping[str, Any]) -> dict[str, Any]:
        """Simulate what compensators of the present model gain on a reference."""
        await self._stop()
        step, data = self._current(), self.need_data()
        ts_s = min(record.ts_s for record in data.records)
        course(reference, step.plant, ts_s)  # what cannot be run is said at once
        base = self.session.step(self.session.path[0])

        def bought(found: Mapping[str, Any]) -> None:
            self.session.write({"do": "payoff", "step": step.id, "payoff": found})

        arguments = {
            "before": base.plant, "after": step.plant, "reference": dict(reference), "ts_s": ts_s,
            "step": step.id,
        }  # fmt: skip
        self._begin("payoff", "Compensators", jobs.payoff, arguments, bought)
        return self.state()

    # models on records: called in threads

    def respond(self, plant: PlantModel, keep: bool = True) -> rg.Response:
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
        return None if name is None else self.session.plant_of(name)

    def plant_with(self, effect: str, step: str | None) -> PlantModel | None:
        """Return the model of a step with a candidate; None where it was not tried."""
        name = step or self.session.current
        ranking = None if name is None else self.session.ranking_of(name)
        return None if ranking is None else ranking.plant_with(effect)

    def _look(self) -> rg.Inspection:
        data = self.need_data()
        with self._looking:
            if self._looked is None or self._looked[0] is not data:
                self._responses.clear()
                self._looked = (data, rg.inspect(data))
            return self._looked[1]

    def _look_ahead(self) -> None:
        async def looked() -> None:
            await asyncio.to_thread(self._look)

        self._in_background(looked())

    # jobs

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
            for card in self._cards(here.id):  # a better form of what is there has none
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
        if step.held or kind == "set" or plant is None:
            return step
        if kind != "fit" and refit["validation_um"] >= step.validation_um:
            return step
        better = replace(
            step,
            plant=PlantModel.from_dict(plant, "the base model"),
            train_um=refit["train_um"],
            validation_um=refit["validation_um"],
            by_record_um=refit["by_record_um"],
        )
        self.session.write({"do": "update", "step": better.to_dict()})
        self._say(better.id)
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
        self._say(step.id)
        self.events.changed()
        return step

    def _say(self, step: str) -> None:
        """Find the sentence on where a step fails most, in the background."""
        self._in_background(self._compare(self.session.step(step)))

    async def _compare(self, step: Step) -> None:
        found = await asyncio.to_thread(rg.compare, self.need_data(), step.plant)
        if self.session.steps.get(step.id) is not step:
            return  # it has moved on meanwhile
        sentence = _sentence(step.validation_um, found)
        noise_um = found.noise_floor_um
        self.session.write(
            {"do": "said", "step": step.id, "sentence": sentence, "noise_um": noise_um}
        )
        self.events.changed()

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
        if self.job is job:
            await asyncio.to_thread(self._workers.begin, task, arguments, listener)

    def _on(self, job: Job, message: Message) -> None:
        """Hear a worker; one whose job is over is not heard any more."""
        if self.job is not job:
            return
        try:
            self._hear(job, message)
        except InputError as error:  # the journal cannot be written
            self.job = None
            self.problem = str(error)
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
                self.problem = str(error)
                self.events.changed()

        task = asyncio.get_running_loop().create_task(guarded())
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            print(f"rdpi lab: {type(error).__name__}: {error}", file=sys.stderr)

    async def _draw(self) -> None:
        await asyncio.sleep(_LATER_S)  # there is more urgent work when the page is opened
        self.pictures = await asyncio.to_thread(views.pictures)
        await asyncio.to_thread(import_module, "scipy.signal")  # for the first view
        self.events.changed()

    def _with_data(self, arguments: dict[str, Any]) -> dict[str, Any]:
        return {"data": self.need_data(), **arguments}

    def need_data(self) -> rg.Dataset:
        """Return the records.

        Raises
        ------
        InputError
            There are none yet.
        """
        data = self.session.data
        if data is None:
            raise InputError("there are no data yet; drop a file or take an exercise")
        return data

    def _current(self) -> Step:
        current = self.session.current
        if current is None:
            raise InputError("there is no model yet; drop a file or take an exercise")
        return self.session.step(current)

    @staticmethod
    def _parameter(plant: PlantModel, effect: str, parameter: str) -> str:
        """Return the name of a parameter as refits know it."""
        owner: Any = plant.hysteresis
        known = [p.name for p in type(plant.hysteresis).shape]
        if effect:
            owner = next((e for e in plant.effects if e.name == effect), None)
            known = [] if owner is None else [p.name for p in owner.parameters]
        if owner is None or parameter not in known:
            where = f"{effect} " if effect else ""
            raise InputError(
                f"{where}has no parameter {quoted(parameter)}; it has {', '.join(known) or 'none'}"
            )
        return f"{effect}.{parameter}" if effect else parameter


def _sentence(validation_um: float, found: rg.Comparison | rg.ModelComparison) -> str:
    """Say how much is left, and where most of it is."""
    assert isinstance(found, rg.Comparison)
    floor = found.noise_floor_um
    error = micrometres(validation_um)
    if floor > 0 and validation_um <= _TIMES_FLOOR * floor:
        said = f"{error} is left on validation records: the noise, {micrometres(floor)}."
    else:
        times = f", {validation_um / floor:.1f} times the noise" if floor > 0 else ""
        where = found.findings.get("records", found.findings.get("largest", ""))
        said = f"{error} is left on validation records{times}. {where}".strip()
    return found.quantities.said(said, [t.name for t in found.traces])
