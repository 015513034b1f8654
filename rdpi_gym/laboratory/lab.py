"""The laboratory behind its page: what each action does."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from rdpi_gym import face
from rdpi_gym.laboratory import data_import, jobs, views
from rdpi_gym.laboratory.compensator_comparison import course
from rdpi_gym.laboratory.examples import examples, folder_of
from rdpi_gym.laboratory.session import Step, check_folder
from rdpi_gym.laboratory.session_jobs import Events, Models, Pending
from rdpi_gym.laboratory.session_json import noise_um, state_of
from rdpi_gym.measurement.settings import LARGEST
from rdpi_gym.measurement.table import stem_of
from rdpi_gym.plant import CORES, PlantModel
from rdpi_gym.support.errors import InputError, printable
from rdpi_gym.support.files import read_bytes, write_atomic
from rdpi_gym.support.temporaries import temporary
from rdpi_gym.support.words import quoted, some


class Lab(Models):
    """One session at work; its actions are called from the loop of the server alone."""

    def __init__(self, folder: Path, events: Events, processes: int) -> None:
        super().__init__(folder, events, processes)
        self._told = itertools.count(1)

    def state(self) -> dict[str, Any]:
        """Return everything that the page shows but traces; `told` counts the states in their order."""
        job = None if self.job is None else self.job.to_dict()
        state = state_of(self.session, job, self.problem, self.pictures)
        return state | {"told": next(self._told)}

    def noise_um(self) -> float | None:
        """Return the noise floor (µm rms) as far as it is known."""
        return noise_um(self.session)

    # bringing data

    async def put_file(self, name: str, write: Callable[[Path], Any]) -> dict[str, Any]:
        """Take a file that is sent; `write` puts its content to a path.

        Of files of one name that are sent at once each has a place of its own, and the last that is
        whole stays.
        """
        session = self.session
        check_folder(session.folder)
        try:
            safe = data_import.safe_name(name)
        except InputError as error:
            shown = printable(name)[-80:]
            if len(session.files) < data_import.MOST_FILES:
                entry = {"bytes": 0, "problem": error.fact, "row": None, "column": None}
                session.write({"do": "file", "name": shown, "entry": entry})
            self.events.changed()
            raise
        target = session.data_folder / safe
        self._check_count(safe)
        with temporary(target) as part:
            await write(part)
            async with self.acting:
                self._check_count(safe)
                part.replace(target)
                data_import.refused_file(session.data_folder, safe).unlink(missing_ok=True)
                if safe != data_import.SETTINGS:
                    self._note_file(safe, None)
        self.events.changed()
        return self.state()

    def _check_count(self, name: str) -> None:
        """Refuse one file too many."""
        files = self.session.files
        if len(files) >= data_import.MOST_FILES and name not in files:
            raise InputError(
                f"there are {data_import.MOST_FILES} files already; take one out first"
            )

    def _note_file(self, name: str, problem: data_import.Problem | None) -> None:
        folder = self.session.data_folder
        places = (folder / name, data_import.refused_file(folder, name))
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
        """Take a file out; the data are read again by :meth:`open`."""
        session = self.session
        if name not in session.files:
            raise InputError(f"there is no file {quoted(name)}; there are {some(session.files)}")
        check_folder(session.folder)
        with suppress(InputError):  # of a file that was refused by its name nothing was kept
            safe = data_import.safe_name(name)
            for path in (
                session.data_folder / safe,
                data_import.refused_file(session.data_folder, safe),
            ):
                path.unlink(missing_ok=True)
        session.write({"do": "file", "name": name, "entry": None})
        self.events.changed()
        return self.state()

    async def open(self, core: str | None = None, anew: bool = False) -> dict[str, Any]:
        """Read all files, fit the base model, and start the ranking: a new history.

        Where the records are those that are open (a file was refused, or taken out again), what was
        done with them goes on, unless it is to begin `anew`.
        """
        session = self.session
        check_folder(session.folder)
        found = await asyncio.to_thread(data_import.read, session.data_folder)
        for file in data_import.data_files(session.data_folder):
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
        known = core is None and not anew and session.steps
        if known and data_import.same(found.data, session.data):
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
            names = await asyncio.to_thread(data_import.copy_in, source, self.session.data_folder)
            for name in names:
                self._note_file(name, None)
        await self.open()

    async def take_example(self, key: str) -> dict[str, Any]:
        """Begin with an exercise or a measured example, in place of the files that are there."""
        known = {example.key: example for example in examples()}
        if key not in known:
            raise InputError(f"there is no example {quoted(key)}; there are {', '.join(known)}")
        await self._stop()
        example = known[key]
        folder, data_folder = folder_of(example), self.session.data_folder
        if folder is not None:
            await self._clear()
            await asyncio.to_thread(data_import.copy_in, folder, data_folder)
            data_import.write_settings(data_folder, example.settings, [])
            return await self.open(anew=True)

        def simulated(data: face.Dataset) -> None:
            self._in_background(self._open_written(replace(data, title=example.title)))

        arguments = dict(example.simulated or {})
        self._begin("simulate", example.title, jobs.simulate, arguments, simulated)
        return self.state()

    async def _open_written(self, data: face.Dataset) -> None:
        await self._clear()
        await asyncio.to_thread(data.write, self.session.data_folder)
        await self.open(anew=True)

    async def _clear(self) -> None:
        """Take out all files and what is said of them."""
        for name in [*self.session.files]:
            await self.delete_file(name)
        check_folder(self.session.folder)
        for path in [p for p in self.session.data_folder.iterdir() if p.is_file()]:
            path.unlink()

    async def set_settings(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Write what is said of the data, read again, fit again."""
        session = self.session
        check_folder(session.folder)
        folder = session.data_folder
        records = [r.name for r in session.data.records] if session.data is not None else []
        files = map(stem_of, data_import.data_files(folder))
        records += [stem for stem in files if stem not in records]
        path = folder / data_import.SETTINGS
        before = read_bytes(path, LARGEST) if path.exists() else None
        data_import.write_settings(folder, changes, records)
        try:
            return await self.open()
        except InputError:
            if session.data is not None:
                path.unlink() if before is None else write_atomic(path, before)
                await self.open()
            raise

    # models and steps

    async def set_core(self, core: str) -> dict[str, Any]:
        """Fit the base model with another kind of hysteresis: a new history."""
        if core not in (*CORES, "auto"):
            raise InputError(f"core {quoted(core)} is unknown; give auto, {', '.join(CORES)}")
        self.session.need_data()
        return await self.open(core)

    async def rank(self) -> dict[str, Any]:
        """Rank all candidates on the present step; without one, begin anew."""
        if self.session.current is None:
            return await self.open()
        await self._stop()
        step = self.session.present()
        self._rank_from(step, step.plant, None, None)
        return self.state()

    async def add(self, effect: str) -> dict[str, Any]:
        """Add an effect as its refit left it, and rank on from there; refit it first where none is there."""
        step = self.session.present()
        if effect not in face.effects and effect != "unknown":
            raise InputError(
                f"effect {quoted(effect)} is unknown; give one of {', '.join(face.effects)}"
            )
        if any(own.name == effect for own in step.plant.effects):
            raise InputError(f"the model has {effect} already; choose another effect")
        ranking = self.session.rankings.get(step.id)
        found = None if ranking is None else ranking.refit_of(effect)
        await self._stop()
        label = f"{views.title_of(effect)} added"
        if found is not None and found["plant"] is not None:
            made = {"kind": "candidate", "effect": effect, "form": found["form"]}
            new = self._make_step(Pending(label, made, step.id, step.held), found)
            self._go_on(step, new)
        else:
            pending = Pending(label, {"kind": "added", "effect": effect}, step.id, step.held)

            def added(found: Mapping[str, Any]) -> None:
                self._go_on(step, self._make_step(pending, found))

            arguments = {"effect": effect, "model": step.plant, "jobs": self._processes}
            self._begin("refit", label, jobs.add, self._with_data(arguments), added)
        return self.state()

    def _go_on(self, before: Step, new: Step) -> None:
        """Rank on from a step; first put back what is held, which a search does not know of."""
        moved = new
        for name in before.held:
            effect, _, parameter = name.rpartition(".")
            value = _value(before.plant, effect, parameter)
            if _value(moved.plant, effect, parameter) != value:
                moved = self._set(moved, effect, parameter, value)
        if moved is new:
            self._rank_from(new, new.plant, None, None)
        else:
            self._refit(moved, rank=True)

    async def remove(self, effect: str) -> dict[str, Any]:
        """Take an effect out, refit everything, and rank on from there."""
        step = self.session.present()
        names = [own.name for own in step.plant.effects]
        if effect not in names:
            raise InputError(
                f"the model has no effect {quoted(effect)}; it has {some(names) or 'none'}"
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
        """Hold a parameter in refits, or release it."""
        step = self.session.present()
        name = self._parameter(step.plant, effect, parameter)
        others = tuple(each for each in step.held if each != name)
        changed = replace(step, held=(*others, name) if held else others)
        self.session.write({"do": "update", "step": changed.to_dict()})
        self.events.changed()
        return self.state()

    async def refit(self) -> dict[str, Any]:
        """Fit the present model anew from where it stands; what is held stays."""
        await self._stop()
        self._refit(self.session.present(), rank=False)
        return self.state()

    def _refit(self, step: Step, rank: bool) -> None:
        made = {"kind": "refit", "held": list(step.held)}
        pending = Pending("Refitted", made, step.id, step.held)
        arguments = self._with_data({"model": step.plant, "held": list(step.held)})

        def refitted(found: Mapping[str, Any]) -> None:
            new = self._make_step(pending, found)
            if rank:
                self._rank_from(new, new.plant, None, None)

        self._begin("refit", "Refitting", jobs.refit, arguments, refitted)

    async def settle(self) -> dict[str, Any]:
        """Take the model as the ranking ended with it: the same effects, its core in few numbers."""
        step = self.session.present()
        ranking = self.session.rankings.get(step.id)
        result = None if ranking is None else ranking.result
        if result is None or result.get("settled") is None:
            raise InputError("there is no settled model: rank first, and add what is missing")
        final = result["final"]
        found = {
            "plant": result["settled"],
            "train_um": final["train_rmse"],
            "validation_um": final["validation_rmse"],
            "by_record_um": final["by_record"],
        }
        pending = Pending("In few numbers", {"kind": "settled"}, step.id, step.held)
        self._make_step(pending, found)
        return self.state()

    def moved(self, effect: str, parameter: str, value: float) -> PlantModel:
        """Return the present model with a parameter at another value."""
        plant = self.session.present().plant
        self._parameter(plant, effect, parameter)
        return _moved(plant, effect, parameter, value)

    async def set_parameter(self, effect: str, parameter: str, value: float) -> dict[str, Any]:
        """Make a step of the present model with a parameter set by hand."""
        plant = self.moved(effect, parameter, value)
        await self._stop()
        await asyncio.to_thread(self.respond, plant)  # the first time takes longer
        self._set(self.session.present(), effect, parameter, value)
        return self.state()

    def _set(self, step: Step, effect: str, parameter: str, value: float) -> Step:
        plant = _moved(step.plant, effect, parameter, value)
        made = {"kind": "set", "effect": effect, "parameter": parameter, "value": value}
        name = f"{views.title_of(effect)} {parameter}" if effect else parameter
        found = {"plant": plant.to_dict(), **views.errors_of(self.respond(plant).errors)}
        return self._make_step(Pending(f"{name} set by hand", made, step.id, step.held), found)

    async def cancel(self) -> dict[str, Any]:
        """Stop what is at work; answers when it is dead."""
        await self._stop()
        return self.state()

    async def payoff(self, reference: Mapping[str, Any]) -> dict[str, Any]:
        """Simulate what compensators of the present model gain on a reference."""
        await self._stop()
        step, data = self.session.present(), self.session.need_data()
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


def _value(plant: PlantModel, effect: str, parameter: str) -> float:
    if not effect:
        return float(getattr(plant.hysteresis, parameter))
    return next(e for e in plant.effects if e.name == effect).values[parameter]


def _moved(plant: PlantModel, effect: str, parameter: str, value: float) -> PlantModel:
    if not effect:
        return replace(plant, hysteresis=plant.hysteresis.with_shape({parameter: value}))
    own = tuple(e.with_values({parameter: value}) if e.name == effect else e for e in plant.effects)
    return replace(plant, effects=own)
