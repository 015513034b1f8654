"""Import of data files into a session: safe names, reading, settings, and previews."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from rdpi_gym import face
from rdpi_gym.measurement.binary import reading, stacked_tags
from rdpi_gym.measurement.matlab import MatlabReader
from rdpi_gym.measurement.options import UNITS
from rdpi_gym.measurement.settings import LARGEST, parse_settings
from rdpi_gym.measurement.table import (
    ENDINGS,
    READ,
    REQUIRED,
    TEXTS,
    ending_of,
    header_unit,
    stem_of,
)
from rdpi_gym.measurement.text import (
    SEPARATORS,
    find_rows,
    is_number,
    read_export,
    read_lines,
    split_cells,
    taken,
)
from rdpi_gym.measurement.units import plain_unit, split_name
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import exists, open_regular, write_atomic
from rdpi_gym.support.npz import open_npz
from rdpi_gym.support.temporaries import temporary, writing
from rdpi_gym.support.words import quoted, short

SETTINGS = "dataset.toml"
MOST_FILES, MOST_BYTES = 64, 256 * 2**20
REFUSED = "refused"
_LONGEST = 120  # characters of a file's name
_LINE, _COLUMN = re.compile(r"\bline (\d+)"), re.compile(r"\bcolumn (\w+)")


@dataclass(frozen=True)
class Problem:
    """Fault of a file: one line, and the place that it names."""

    line: str
    row: int | None
    column: str | None


@dataclass(frozen=True)
class Read:
    """Records of the readable files of a session, the fault of each other file, and that of all together."""

    data: face.Dataset | None
    problems: Mapping[str, Problem]
    problem: str | None = None


def safe_name(name: str) -> str:
    r"""Return the base name of a file that was sent, as it may stand in a folder."""
    base = re.split(r"[/\\]", name)[-1].lstrip(".")
    safe = "".join(c for c in base if c.isprintable() and c not in '<>:"|?*')[-_LONGEST:].strip()
    ending = ending_of(Path(safe))
    if safe != SETTINGS and ending not in ENDINGS:
        raise InputError(
            f"{safe or 'the file'}: files that end in {ending or 'nothing'!r} are not read; "
            f"give {READ}"
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
            raise InputError(f"{source}: no data file in this folder; give {READ}")
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
        document = _document(settings, [stem_of(file) for file in data_files(settings.parent)])
        if not source.is_dir():  # without records that are not there
            stems = {stem_of(file) for file in files}
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
    moved = {
        stem: kept.pop(stem) for stem in (stem_of(Path(name)) for name in names) if stem in kept
    }
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
    stems, moved = {stem_of(file) for file in files}, settings_of(aside).get("records", {})
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
    return sorted(f for f in files if ending_of(f) in ENDINGS and f.is_file() and f.name[0] != ".")


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
    parse_settings(text, SETTINGS, [*records, *(stem_of(file) for file in all_files(folder))])
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


_HEAD_BYTES, _ROWS = 2**16, 8
_MOST_COLUMNS, _SHOWN_COLUMNS = 1000, 30
_USUAL = {"t": "s", "u": "V", "y": "µm"}
_SIDES = {"u": "input", "y": "output"}
_WORDS = {
    "t": "t time times timestamp clock sec seconds zeit temps tiempo",
    "u": "u v in command cmd input drive voltage volt volts amplifier amp control spannung eingang",
    "y": "y x out output pos position displacement disp sensor measured stroke travel weg ausgang",
}
_KNOWN = {role: frozenset(words.split()) for role, words in _WORDS.items()}


@dataclass(frozen=True)
class Column:
    """One column of a file, or one variable."""

    # in settings: its name, or its position where the name is none or there twice
    source: str | int
    name: str


@dataclass(frozen=True)
class Head:
    """The beginning of a file; only a text has rows of cells and the name of a separator."""

    columns: Sequence[Column]
    rows: Sequence[Sequence[str]] = ()
    separator: str = ""
    taken: Sequence[str] = ()  # what a reader should know of how it was read, one clause each


def preview(
    folder: Path, known: Mapping[str, Mapping[str, Any]], name: str, separator: str | None = None
) -> dict[str, Any]:
    """Return the beginning of a data file of a session that has read it, and how it may be read."""
    files = {file.name: file for file in all_files(folder) if not file.is_symlink()}
    if name not in known or name not in files:
        raise InputError(f"there is no data file {quoted(name)} in this session")
    file = files[name]
    own, document = record_settings(folder, stem_of(file)), settings_of(folder)
    if separator is None:
        separator = str(own.get("separator", ""))
    if separator and separator not in SEPARATORS:
        raise InputError(f"separator {quoted(separator)}; give {', '.join(SEPARATORS)}")
    is_refused = known[name]["problem"] is not None
    with MatlabReader() as matlab:
        try:
            head = _head(file, separator, matlab)
        except InputError as error:
            raise InputError(error.fact.replace(f"{file.parent}/", "")) from error
        alike = [
            stem_of(other)
            for other_name, entry in known.items()
            if other_name != name
            and (other := files.get(other_name)) is not None
            and ending_of(other) == ending_of(file)
            and (entry["problem"] is not None) == is_refused
            and _has(head.columns, other, separator, matlab)
        ]
    stated = {**document.get("columns", {}), **own.get("columns", {})}
    chosen = guess_columns(head, stated)
    units = _units(head, chosen, {**document.get("units", {}), **own.get("units", {})})
    for role, side in _SIDES.items():
        if side in document.get("quantities", {}) and units[role] == _USUAL[role]:
            units[role] = ""
    return {
        "record": stem_of(file),
        "columns": [
            {"source": c.source, "name": short(c.name), "unit": split_name(c.name)[1]}
            for c in head.columns[:_MOST_COLUMNS]
        ],
        "rows": [[short(cell) for cell in row[:_SHOWN_COLUMNS]] for row in head.rows],
        "separator": {"chosen": separator, "found": head.separator} if head.separator else None,
        "taken": list(head.taken),
        "chosen": chosen,
        "units": units,
        "ts_s": own.get("ts_s"),
        "alike": alike,
    }


def guess_columns(head: Head, stated: Mapping[str, Any]) -> dict[str, str | int]:
    """Guess which columns are time, command and displacement."""
    columns = {column.source: column for column in head.columns}
    positions = dict(enumerate(columns))
    found: dict[str, str | int] = {}
    for role in REQUIRED:
        source = stated.get(role)
        source = positions.get(source) if isinstance(source, int) else source
        if not isinstance(source, str | int) or source in found.values():
            continue
        if source in columns or (role, source) == ("t", ""):
            found[role] = source
    scores = sorted(
        (-_likeness(role, column.name), k, role)
        for k, column in enumerate(head.columns)
        for role in REQUIRED
    )
    for score, k, role in scores:
        source = head.columns[k].source
        if score < 0 and role not in found and source not in found.values():
            found[role] = source
    rest = [source for source in columns if source not in found.values()]
    if not found and len(rest) > 2 and _increases([row[0] for row in head.rows if row]):
        found["t"] = rest.pop(0)
    found.setdefault("t", "")
    for role in ("u", "y"):
        if role not in found and columns:
            found[role] = rest.pop(0) if rest else list(columns)[-1]
    return {role: found[role] for role in REQUIRED if role in found}


def _likeness(role: str, name: str) -> int:
    bare, unit = split_name(name)
    parted = re.sub("(?<=[a-z])(?=[A-Z])", " ", bare).lower()
    words = set(re.findall(r"[^\W\d_]+", parted))
    others = sum(len(words & known) for other, known in _KNOWN.items() if other != role)
    own = 2 * len(words & _KNOWN[role]) + 4 * (bare == role)
    return own - others + 3 * (plain_unit(unit) in UNITS[role])


def _increases(cells: Sequence[str]) -> bool:
    values = [float(cell.replace(",", ".")) for cell in cells if is_number(cell)]
    return len(values) == len(cells) and all(one < other for one, other in pairwise(values))


def _units(
    head: Head, chosen: Mapping[str, str | int], stated: Mapping[str, Any]
) -> dict[str, str]:
    names = {column.source: column.name for column in head.columns}
    by_header = {role: header_unit(role, names.get(chosen.get(role, ""), "")) for role in REQUIRED}
    return {role: str(stated.get(role) or by_header[role] or _USUAL[role]) for role in REQUIRED}


def _has(columns: Sequence[Column], other: Path, separator: str, matlab: MatlabReader) -> bool:
    """Return whether another file has the same columns."""
    try:
        return _head(other, separator, matlab).columns == columns
    except InputError:
        return False


def _head(file: Path, separator: str, matlab: MatlabReader) -> Head:
    ending = ending_of(file)
    if ending in TEXTS:
        return _text(file, separator)
    if ending == ".npz":
        if stacked_tags(file):  # of channels, which settings of one file do not choose
            return Head([])
        with reading(file, "npz"), open_npz(file) as archive:
            return _variables(archive.names)
    with reading(file, "MATLAB"):
        return _variables(matlab.read(file, ["u"]).names)


def _variables(names: Sequence[str]) -> Head:
    return Head([Column(name, name) for name in names])


def _text(file: Path, separator: str) -> Head:
    lines, encoding = read_export(file, _HEAD_BYTES)
    layout, _, rows = find_rows(file, lines, separator)
    names = () if layout.is_shifted else layout.header
    columns = [
        Column(names[k] if k < len(names) and names.count(names[k]) == 1 and names[k] else k,
               (names[k] if k < len(names) else "") or f"column {k}")
        for k in range(max(layout.width, len(names)))
    ]  # fmt: skip
    found = next(name for name, mark in SEPARATORS.items() if mark == layout.delimiter)
    shown = [split_cells(row, layout.delimiter) for row in rows[:_ROWS]]
    return Head(columns, shown, found, taken(layout, encoding))
