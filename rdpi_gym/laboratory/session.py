"""Session of the laboratory: an append-only log, and the steps and rankings that it folds into."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rdpi_gym import face
from rdpi_gym.laboratory.data_import import REFUSED, read
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.checks import check_type
from rdpi_gym.support.documents import PLAIN
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import BINARY, NO_LINK, check_plain, parse_json, read_bytes, write_all
from rdpi_gym.support.words import quoted, some

Entry = Mapping[str, Any]
Fields = Mapping[str, tuple[Any, Any]]
"""By name, the type of a field and what stands for one that is missing."""
_NUMBERS = Mapping[str, float]
_REFIT: Fields = {
    "effect": (str, None), "form": (str, None), "plant": (Entry | None, None),
    "train_um": (float | None, None), "validation_um": (float | None, None),
    "by_record_um": (Mapping[str, float | None], {}), "parameters": (_NUMBERS, {}),
    "at_bound": (Sequence[str], []),
}  # fmt: skip
_CANDIDATE: Fields = {
    "effect": (str, None), "form": (str, None), "share_of_excess": (float | None, None),
    "confidence": (float | None, None), "indistinguishable": (Sequence[str], []),
    "remarks": (Sequence[str], []),
}  # fmt: skip
_RESULT: Fields = {
    "candidates": (Sequence[Entry], []), "chosen": (Sequence[str], []), "headline": (str, ""),
    "lines": (Sequence[str], []), "remainder": (str, ""), "portrait_lines": (Sequence[str], []),
    "next_experiment": (str | None, None), "experiment": (Entry | None, None), "advice": (Entry | None, None),
    "noise_floor": (float | None, None), "settled": (Entry | None, None), "final": (Entry, {}),
}  # fmt: skip
_FINAL: Fields = {
    "train_rmse": (float | None, None), "validation_rmse": (float | None, None),
    "by_record": (Mapping[str, float | None], {}),
}  # fmt: skip


def refit_of(entry: Any) -> Entry:
    """Return a refit with every field."""
    return _whole(entry, _REFIT, "a refit")


def result_of(entry: Any) -> Entry | None:
    """Return what a ranking ended with, with every field; None where it has not ended."""
    if entry is None:
        return None
    found = _whole(entry, _RESULT, "a ranking")
    candidates = [_whole(each, _CANDIDATE, "a candidate") for each in found["candidates"]]
    return found | {"candidates": candidates, "final": _whole(found["final"], _FINAL, "a ranking")}


def error_um(entry: Entry) -> float:
    """Return the validation error of a refit (µm rms); one that is not finite stands as null."""
    error = entry["validation_um"]
    return math.inf if error is None else float(error)


def _whole(entry: Any, fields: Fields, what: str) -> dict[str, Any]:
    check_type(entry, Entry, what)
    found = {**entry}
    for name, (hint, missing) in fields.items():
        found.setdefault(name, missing)
        check_type(found[name], hint, f"{name} of {what}")
    return found


JOURNAL = "journal.jsonl"
DATA_FOLDER = "data"
_STEP = re.compile(r"s[1-9][0-9]{0,8}")
"""Names of steps: they stand as variables in a notebook."""
_APPEND = os.O_WRONLY | os.O_APPEND | os.O_CREAT | NO_LINK | BINARY
_LARGEST_JOURNAL = 2**26  # bytes: a thousand rankings
Event = Mapping[str, Any]


@dataclass(frozen=True)
class Step:
    """A model that was reached, and how."""

    id: str  # ``s1``, ``s2``, ...
    parent: str | None  # the step that it was made from; None: from the data alone
    label: str  # what was done, for a person
    # the same for a program: kind ``fit``, ``candidate`` (with ``effect`` and ``form``), ``added`` and ``removal`` (``effect``),
    # ``refit`` (``held``), ``set`` (``effect``, ``parameter``, ``value``), ``settled``
    made: Mapping[str, Any]
    plant: PlantModel
    train_um: float  # errors (µm rms), one offset free in each record
    validation_um: float
    by_record_um: Mapping[str, float]
    held: tuple[str, ...] = ()  # parameters that refits leave alone, as ``effect.parameter``

    def to_dict(self) -> dict[str, Any]:
        """Return the object of the journal."""
        return PLAIN.write_fields(self)

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Step:
        """Build from the object of the journal."""
        step = PLAIN.read_fields(cls, document, "a step")
        for step_name in filter(None, (step.id, step.parent)):
            if not _STEP.fullmatch(step_name):
                raise InputError(f"{quoted(step_name)} names no step")
        if step.parent is not None and int(step.parent[1:]) >= int(step.id[1:]):
            raise InputError(f"step {step.id} cannot be made from {step.parent}")
        return step


@dataclass(frozen=True)
class Ranking:
    """The candidates that were tried on a step."""

    step: str
    status: str = "running"  # ``running``, ``done``, ``cancelled`` or ``failed``
    # by (effect, form), in the order of arrival; the base model has an empty effect
    refits: Mapping[tuple[str, str], Mapping[str, Any]] = field(default_factory=dict)
    result: Mapping[str, Any] | None = None  # the object of ``diagnosis.json``
    problem: str | None = None

    def plant_with(self, effect: str, form: str | None = None) -> PlantModel | None:
        """Return the model with a candidate, everything refitted; None where it is not there yet."""
        found = self.refit_of(effect, form)
        if found is None:
            return None
        return PlantModel.from_dict(found["plant"], f"the refit with {effect}")

    def refit_of(self, effect: str, form: str | None = None) -> Mapping[str, Any] | None:
        """Return the refit of a candidate as it stands in the journal; see :meth:`plant_with`."""
        own = {f: refit for (name, f), refit in self.refits.items() if name == effect}
        usable = {f: r for f, r in own.items() if r["plant"] is not None}
        if form is None:
            form = next((c["form"] for c in self.candidates if c["effect"] == effect), None)
        if form is not None:
            return usable.get(form)
        return min(usable.values(), key=error_um, default=None)

    @property
    def candidates(self) -> list[Mapping[str, Any]]:
        """The ranking, best first; empty before it is done."""
        return [] if self.result is None else list(self.result["candidates"])


class Session:
    """A session of the laboratory in its folder: data in ``data``, events in ``journal.jsonl``.

    Every change goes through :meth:`write`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.steps: dict[str, Step] = {}
        self.path: list[str] = []  # from the base model to the present step
        self.redo: list[str] = []  # undone steps, the next one first
        self.rankings: dict[str, Ranking] = {}  # this and the next two by step
        self.payoffs: dict[str, dict[str, Any]] = {}
        # `sentence` on the residual, and `noise_um` (µm rms)
        self.said: dict[str, dict[str, Any]] = {}
        # `problem`, `row`, `column`: None where it was read
        self.files: dict[str, dict[str, Any]] = {}
        self._data: face.Dataset | None = None
        self._is_read = False
        self._count = 0
        check_folder(folder)
        self.data_folder.mkdir(parents=True, exist_ok=True)
        for number, event in enumerate(self.events(), 1):
            try:
                self._fold(_checked(event))
            except (KeyError, TypeError, AttributeError, ValueError) as error:
                raise _damaged(folder, number) from error
        # what was running when the server died runs no more
        for step, ranking in self.rankings.items():
            if ranking.status == "running":
                self.rankings[step] = replace(ranking, status="cancelled")

    @property
    def data_folder(self) -> Path:
        """Folder of the data files of the session, with their ``dataset.toml``."""
        return self.folder / DATA_FOLDER

    @property
    def data(self) -> face.Dataset | None:
        """The records; None before there are any."""
        if self._data is None and self._is_read:
            self._data = read(self.data_folder).data
        return self._data

    @property
    def current(self) -> str | None:
        """The present step."""
        return self.path[-1] if self.path else None

    def need_data(self) -> face.Dataset:
        """Return the records."""
        if self.data is None:
            raise InputError("there are no data yet; drop a file or take an exercise")
        return self.data

    def present(self) -> Step:
        """Return the present step."""
        if self.current is None:
            raise InputError("there is no model yet; drop a file or take an exercise")
        return self.step(self.current)

    def step(self, step: str) -> Step:
        """Return a step."""
        if step not in self.steps:
            raise InputError(f"step {quoted(step)} is not there; there are {some(self.steps)}")
        return self.steps[step]

    def chain(self, step: str) -> list[str]:
        """Return the steps that lead to one, itself the last."""
        found = [step]
        while (parent := self.step(found[0]).parent) is not None:
            found.insert(0, parent)
        return found

    def next_id(self) -> str:
        """Return the name of a step that is new."""
        return f"s{self._count + 1}"

    def begin(self, data: face.Dataset) -> None:
        """Take records that were read from :attr:`data_folder`: a new history begins."""
        self.write({"do": "read"})
        self._data = data

    def write(self, event: Event) -> None:
        """Write down what was done, and let it take effect."""
        line = json.dumps(event, ensure_ascii=False, allow_nan=False) + "\n"
        again = _checked(parse_json(line, JOURNAL))
        try:
            handle = os.open(self.folder / JOURNAL, _APPEND, 0o666)
            try:
                write_all(handle, line.encode())
                os.fsync(handle)
            finally:
                os.close(handle)
        except OSError as error:
            raise InputError(
                f"{self.folder / JOURNAL} cannot be written ({error.strerror})"
            ) from error
        self._fold(again)

    def events(self) -> Iterator[Event]:
        """Yield what the journal holds, in order."""
        yield from read_journal(self.folder)

    def _fold(self, event: Event) -> None:
        if event["do"] == "read":
            self._is_read, self._data = True, None
            self.steps, self.rankings, self.payoffs, self.said = {}, {}, {}, {}
            self.path, self.redo = [], []
        elif event["do"] == "file":
            if event["entry"] is None:
                self.files.pop(event["name"], None)
            else:
                self.files[event["name"]] = dict(event["entry"])
        elif event["do"] in ("step", "update"):
            step: Step = event["step"]
            self.steps[step.id] = step
            if event["do"] == "step":
                self._count += 1
                self.path, self.redo = self.chain(step.id), []
        elif event["do"] == "go":
            path, redo = list(event["path"]), list(event["redo"])
            for name in (*path, *redo):
                self.step(name)
            self.path, self.redo = path, redo
        else:
            self._fold_on(self.step(event["step"]).id, event)

    def _fold_on(self, step: str, event: Event) -> None:
        """Apply an event of a step."""
        before = self.rankings.get(step, Ranking(step))
        if event["do"] == "refit":
            refit = event["refit"]
            tried = {**before.refits, (refit["effect"], refit["form"]): refit}
            self.rankings[step] = replace(before, refits=tried)
        elif event["do"] == "ranking":
            refits = {} if event["status"] == "running" else before.refits
            self.rankings[step] = Ranking(
                step, event["status"], refits, event["result"], event.get("problem")
            )
        elif event["do"] == "payoff":
            self.payoffs[step] = dict(event["payoff"])
        elif event["do"] == "said":
            self.said[step] = {k: event[k] for k in ("sentence", "noise_um")}


def _checked(event: Event) -> Event:
    """Return an event whose step is built, and whose refit or ranking has every field."""
    if event["do"] in ("step", "update"):
        return {**event, "step": Step.from_dict(event["step"])}
    if event["do"] == "refit":
        return {**event, "refit": refit_of(event["refit"])}
    if event["do"] == "ranking":
        return {**event, "result": result_of(event.get("result"))}
    return event


def check_folder(folder: Path) -> None:
    """Refuse a session that would read or write elsewhere."""
    check_plain([folder, folder / DATA_FOLDER, folder / REFUSED])


def read_journal(folder: Path) -> Iterator[Event]:
    """Yield what the journal of a session holds; a last line that is torn is taken off."""
    path = folder / JOURNAL
    check_folder(folder)
    if not path.exists():
        return
    whole, end, torn = read_bytes(path, _LARGEST_JOURNAL).rpartition(b"\n")
    if torn:  # the server died in the middle of a line
        os.truncate(path, len(whole) + len(end))
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            yield parse_json(line.decode(), JOURNAL)
        except ValueError as error:
            raise _damaged(folder, number) from error


def _damaged(folder: Path, number: int) -> InputError:
    return InputError(
        f"{folder / JOURNAL}, line {number} is damaged; delete it, or begin a new session"
    )
