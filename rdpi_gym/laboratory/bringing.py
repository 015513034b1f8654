"""Data files of a session: taken in under a safe name, read, and what is said of them beside them."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rdpi_gym import face
from rdpi_gym.measurement.settings import LARGEST, parse_settings
from rdpi_gym.measurement.text import read_lines
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import exists, open_regular, write_atomic
from rdpi_gym.support.temporaries import temporary, writing
from rdpi_gym.support.words import quoted

SETTINGS = "dataset.toml"
ENDINGS = (".csv", ".txt", ".dat", ".tsv", ".mat", ".npz")
"""Of files that may hold a record."""
MOST_FILES, MOST_BYTES = 64, 256 * 2**20
REFUSED = "refused"
_LONGEST = 120  # characters of a file's name
_LINE, _COLUMN = re.compile(r"\bline (\d+)"), re.compile(r"\bcolumn (\w+)")


@dataclass(frozen=True)
class Problem:
    """What is wrong with a file: one line, and the place that it names."""

    line: str
    row: int | None
    column: str | None


@dataclass(frozen=True)
class Read:
    """What the files of a session hold.

    Parameters
    ----------
    data
        The records of the files that could be read; None where there are none.
    problems
        By file that was refused.
    problem
        What is wrong with all of them together.
    """

    data: face.Dataset | None
    problems: Mapping[str, Problem]
    problem: str | None = None


def safe_name(name: str) -> str:
    r"""Return the base name of a file that was sent, as it may stand in a folder."""
    base = re.split(r"[/\\]", name)[-1].lstrip(".")
    safe = "".join(c for c in base if c.isprintable() and c not in '<>:"|?*')[-_LONGEST:].strip()
    ending = Path(safe).suffix.lower()
    if safe != SETTINGS and ending not in ENDINGS:
        raise InputError(
            f"{safe or 'the file'}: files that end in {ending or 'nothing'!r} are not read; "
            f"give {', '.join(ENDINGS)}"
        )
    return safe


def copy_in(source: Path, folder: Path) -> list[str]:
    """Copy a data file, or those of a folder, with what is said of them; return their names."""
    if not exists(source):
        raise InputError(f"{source} does not exist; give a data file or a folder of data files")
    files = [source]
    if source.is_dir():
        files = data_files(source)
        if not files:
            raise InputError(f"{source}: no data file in this folder; give {', '.join(ENDINGS)}")
    if len(files) > MOST_FILES:
        raise InputError(f"{source} holds {len(files)} data files; give {MOST_FILES} at most")
    for file in files:
        safe_name(file.name)
        if file.stat().st_size > MOST_BYTES:
            raise InputError(
                f"{file} has {file.stat().st_size / 2**20:.0f} MiB; give {MOST_BYTES // 2**20} at most"
            )
    settings = (source if source.is_dir() else source.parent) / SETTINGS
    folder.mkdir(parents=True, exist_ok=True)
    if settings.exists() and not (folder / SETTINGS).exists():
        document = _document(settings, [file.stem for file in data_files(settings.parent)])
        if not source.is_dir():  # without records that are not there
            stems = {file.stem for file in files}
            own = document.get("records", {})
            document["records"] = {name: entry for name, entry in own.items() if name in stems}
        write_atomic(folder / SETTINGS, _toml(document))
    for file in files:
        target = folder / safe_name(file.name)
        with open_regular(file) as content, writing(target), temporary(target) as part:
            with part.open("wb") as copy:
                shutil.copyfileobj(content, copy)
            part.replace(target)
    return [safe_name(file.name) for file in files]


def _document(settings: Path, records: Iterable[str] | None = None) -> dict[str, Any]:
    """Return what a ``dataset.toml`` says, or refuse it in one line; of these records alone, if given."""
    text = "\n".join(read_lines(settings, LARGEST))
    parse_settings(text, str(settings), records)
    return tomllib.loads(text)


def same(one: Any, other: Any) -> bool:
    """Return whether data are the same in all that they hold, sample by sample."""
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    return bool(one == other)


def read(folder: Path) -> Read:
    """Read all files of a session; those that are refused are set aside and do not spoil the others."""
    _take_back(folder)  # other settings may make them readable
    files = data_files(folder)
    if not files:
        return Read(None, {})
    try:
        return Read(_titled(face.load(folder), files, folder), {})
    except InputError as error:
        together = error
    problems: dict[str, Problem] = {}
    good: list[Path] = []
    for file in files:
        try:
            face.load(file)
            good.append(file)
        except InputError as error:
            problems[file.name] = _problem(error, file)
    for file in [f for f in files if f.name in problems and good]:
        try:  # a record in which nothing moves is one beside others
            face.load([good[0], file])
            good.append(file)
            del problems[file.name]
        except InputError:
            pass
    if not problems:
        return Read(None, {}, _short(together, folder))
    if not good:
        return Read(None, problems)
    _set_aside(folder, problems)
    try:
        return Read(_titled(face.load(folder), good, folder), problems)
    except InputError as error:
        return Read(None, problems, _short(error, folder))


def _set_aside(folder: Path, names: Iterable[str]) -> None:
    """Put refused files beside the data, with what is said of them: no settings name absent records."""
    aside = folder.parent / REFUSED
    aside.mkdir(exist_ok=True)
    document = settings_of(folder)
    kept = dict(document.get("records", {}))
    moved = {stem: kept.pop(stem) for stem in (Path(name).stem for name in names) if stem in kept}
    if moved:
        write_atomic(aside / SETTINGS, _toml({"records": moved}))
    for name in names:
        (folder / name).replace(aside / name)
    if moved:
        write_atomic(folder / SETTINGS, _toml({**document, "records": kept}))


def _take_back(folder: Path) -> None:
    """Put what was set aside among the data again; what was said of a discarded file is forgotten."""
    aside = folder.parent / REFUSED
    if not aside.exists():
        return
    files = data_files(aside)
    stems, moved = {file.stem for file in files}, settings_of(aside).get("records", {})
    if moved := {stem: table for stem, table in moved.items() if stem in stems}:
        document = settings_of(folder)
        records = {**moved, **document.get("records", {})}
        write_atomic(folder / SETTINGS, _toml({**document, "records": records}))
    for file in files:
        file.replace(folder / file.name)
    (aside / SETTINGS).unlink(missing_ok=True)


def record_settings(folder: Path, record: str) -> dict[str, Any]:
    """Return what is said of one record, also of one whose file was refused."""
    places = (folder.parent / REFUSED, folder)
    found = [settings_of(place).get("records", {}) for place in places]
    return dict({**found[0], **found[1]}.get(record, {}))


def all_files(folder: Path) -> list[Path]:
    """Return the data files of a session, those that were refused too."""
    return data_files(folder) + data_files(folder.parent / REFUSED)


def data_files(folder: Path) -> list[Path]:
    """Return the data files of a folder, in order; none where it is not there."""
    files = folder.iterdir() if folder.is_dir() else ()
    return sorted(
        f for f in files if f.suffix.lower() in ENDINGS and f.is_file() and f.name[0] != "."
    )


def refused_file(folder: Path, name: str) -> Path:
    """Return where a file lies that was set aside."""
    return folder.parent / REFUSED / name


def _titled(data: face.Dataset, files: list[Path], folder: Path) -> face.Dataset:
    if data.title != folder.name:
        return data
    title = files[0].name if len(files) == 1 else f"{len(data.records)} records"
    return replace(data, title=title)


def _problem(error: InputError, file: Path) -> Problem:
    line = _short(error, file.parent)
    row, column = _LINE.search(line), _COLUMN.search(line)
    return Problem(line, int(row[1]) if row else None, column[1] if column else None)


def _short(error: InputError, folder: Path) -> str:
    return error.fact.replace(f"{folder}/", "")


def settings_of(folder: Path) -> dict[str, Any]:
    """Return what the ``dataset.toml`` of a session says; empty without one or where it is damaged."""
    try:
        return _document(folder / SETTINGS)  # a record that it names may have been discarded
    except InputError:
        return {}


def write_settings(folder: Path, changes: Mapping[str, Any], records: Iterable[str]) -> None:
    """Write what was said of the data into ``dataset.toml``."""
    known = ("records", "quantities", "title", "skip_s")
    if wrong := [key for key in changes if key not in known]:
        raise InputError(f"settings: {quoted(wrong[0])} is unknown; give {', '.join(known)}")
    document = settings_of(folder)
    for key in ("title", "skip_s"):
        if key in changes:
            document[key] = changes[key]
    own = document.setdefault("records", {})
    for name in _table(changes, "records"):
        entry = own[name] = record_settings(folder, name)
        for said, value in _table(_table(changes, "records"), name).items():
            key = "mask_s" if said == "masked_s" else said
            if isinstance(value, Mapping):
                entry[key] = {**_table(entry, key), **value}
            else:
                entry[key] = "test" if key == "role" and value == "unused" else value
    if "quantities" in changes:
        document["quantities"] = _table(changes, "quantities")
    text = _toml(document)
    parse_settings(text, SETTINGS, [*records, *(file.stem for file in all_files(folder))])
    write_atomic(folder / SETTINGS, text)


def _table(document: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = document.get(key) or {}
    if not isinstance(found, Mapping):
        raise InputError(f"settings: {key} is {quoted(found)}; give an object")
    return found


def _toml(document: Mapping[str, Any]) -> str:
    """Write a document of texts, numbers, lists and tables as TOML."""
    lines: list[str] = []

    def put(table: Mapping[str, Any], heading: str) -> None:
        plain = {k: v for k, v in table.items() if not isinstance(v, Mapping) and v is not None}
        if heading and (plain or not table):
            lines.extend(["", f"[{heading}]"])
        lines.extend(f"{_key(k)} = {json.dumps(v, ensure_ascii=False)}" for k, v in plain.items())
        for key, inner in table.items():
            if isinstance(inner, Mapping):
                put(inner, f"{heading}.{_key(key)}" if heading else _key(key))

    put(document, "")
    return "\n".join(lines).lstrip("\n") + "\n"


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key, ensure_ascii=False)
