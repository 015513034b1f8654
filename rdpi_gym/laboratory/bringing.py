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

import rdpi_gym as rg
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import exists, write_atomic
from rdpi_gym.support.words import quoted, some

SETTINGS = "dataset.toml"
ENDINGS = (".csv", ".txt", ".dat", ".tsv", ".mat", ".npz")
"""Of files that may hold a record."""
MOST_FILES, MOST_BYTES = 64, 256 * 2**20
_REFUSED = "refused"
_LONGEST = 120  # characters of a file's name
_LINE, _COLUMN = re.compile(r"\bline (\d+)"), re.compile(r"\bcolumn (\w+)")
_SEPARATORS = re.compile(r"[,;\t]")
_RECORD_KEYS = ("role", "skip_s", "mask_s", "ts_s", "note")
_ROLES = ("train", "validation", "test")


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

    data: rg.Dataset | None
    problems: Mapping[str, Problem]
    problem: str | None = None


def safe_name(name: str) -> str:
    r"""Return the base name of a file that was sent, as it may stand in a folder.

    Raises
    ------
    InputError
        Nothing is left of it, or it is no data file's.

    Examples
    --------
    >>> safe_name("C:\\runs\\../run 1.CSV")
    'run 1.CSV'
    >>> safe_name("notes.docx")
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: notes.docx: files that end in '.docx' are not read; give .csv, .txt, .dat, .tsv, .mat, .npz
    """
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
    """Copy a data file, or those of a folder, with what is said of them; return their names.

    Parameters
    ----------
    source
        File or folder.
    folder
        Of the session's data.

    Raises
    ------
    InputError
        There is no such file, none in the folder, or too many or too large ones.
    """
    if not exists(source):
        raise InputError(f"{source} does not exist; give a data file or a folder of data files")
    files = [source]
    if source.is_dir():
        files = sorted(f for f in source.iterdir() if f.suffix.lower() in ENDINGS and f.is_file())
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
        text = settings.read_text(encoding="utf-8")
        write_atomic(folder / SETTINGS, text if source.is_dir() else _of_records(text, files))
    for file in files:
        shutil.copyfile(file, folder / safe_name(file.name))
    return [safe_name(file.name) for file in files]


def _of_records(text: str, files: Iterable[Path]) -> str:
    """Return what a ``dataset.toml`` says without records that are not there."""
    document = tomllib.loads(text)
    stems = {file.stem for file in files}
    document["records"] = {k: v for k, v in document.get("records", {}).items() if k in stems}
    return _toml(document)


def same(one: Any, other: Any) -> bool:
    """Return whether data are the same in all that they hold, sample by sample.

    Parameters
    ----------
    one, other
        Data sets, or what stands in them.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", seed=1, ts_factor=4.0)
    >>> same(data, rg.simulate("P5", seed=1, ts_factor=4.0))
    True
    >>> same(data, data.select("stairs"))
    False
    """
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
    """Read all files of a session; those that are refused are set aside and do not spoil the others.

    Parameters
    ----------
    folder
        Of the session's data.
    """
    aside = folder.parent / _REFUSED
    if aside.exists():  # other settings may make them readable
        for file in aside.iterdir():
            file.replace(folder / file.name)
    files = data_files(folder)
    if not files:
        return Read(None, {})
    try:
        return Read(_titled(rg.load(folder), files, folder), {})
    except InputError as error:
        together = error
    problems: dict[str, Problem] = {}
    good: list[Path] = []
    for file in files:
        try:
            rg.load(file)
            good.append(file)
        except InputError as error:
            problems[file.name] = _problem(error, file)
    for file in [f for f in files if f.name in problems and good]:
        try:  # a record in which nothing moves is one beside others
            rg.load([good[0], file])
            good.append(file)
            del problems[file.name]
        except InputError:
            pass
    if not problems:
        return Read(None, {}, _short(together, folder))
    if not good:
        return Read(None, problems)
    aside.mkdir(exist_ok=True)
    for name in problems:
        (folder / name).replace(aside / name)
    try:
        return Read(_titled(rg.load(folder), good, folder), problems)
    except InputError as error:
        return Read(None, problems, _short(error, folder))


def data_files(folder: Path) -> list[Path]:
    """Return the data files of a folder, in order."""
    return sorted(f for f in folder.iterdir() if f.suffix.lower() in ENDINGS and f.is_file())


def refused_file(folder: Path, name: str) -> Path:
    """Return where a file lies that was set aside."""
    return folder.parent / _REFUSED / name


def _titled(data: rg.Dataset, files: list[Path], folder: Path) -> rg.Dataset:
    if data.title != folder.name:
        return data
    title = files[0].name if len(files) == 1 else f"{len(data.records)} records"
    return replace(data, title=title)


def _problem(error: InputError, file: Path) -> Problem:
    line = _short(error, file.parent)
    row, column = _LINE.search(line), _COLUMN.search(line)
    return Problem(line, int(row[1]) if row else None, column[1] if column else None)


def _short(error: InputError, folder: Path) -> str:
    return str(error).replace(f"{folder}/", "")


def settings_of(folder: Path) -> dict[str, Any]:
    """Return what the ``dataset.toml`` of a session says; empty without one or where it is damaged."""
    try:
        return tomllib.loads((folder / SETTINGS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def write_settings(folder: Path, changes: Mapping[str, Any], records: Iterable[str]) -> None:
    """Write what was said of the data into ``dataset.toml``.

    Parameters
    ----------
    folder
        Of the session's data.
    changes
        As the page sends them: ``records``, ``columns``, ``units``, ``quantities``, ``title``.
    records
        Names of all records.

    Raises
    ------
    InputError
        A key or a role that there is not, a value of another kind; the file stays as it was.
    """
    known = ("records", "columns", "units", "quantities", "title", "skip_s")
    if wrong := [key for key in changes if key not in known]:
        raise InputError(f"settings: {quoted(wrong[0])} is unknown; give {', '.join(known)}")
    document = settings_of(folder)
    for key in ("title", "skip_s"):
        if key in changes:
            document[key] = changes[key]
    names = list(records)
    own = document.setdefault("records", {})
    for name in _table(changes, "records"):
        if name not in names:
            raise InputError(
                f"settings: there is no record {quoted(name)}; there are {some(names)}"
            )
        entry = own.setdefault(name, {})
        for said, value in _table(_table(changes, "records"), name).items():
            key = "mask_s" if said == "masked_s" else said
            if key not in _RECORD_KEYS:
                raise InputError(
                    f"settings: {quoted(key)} of {name} is unknown; give {', '.join(_RECORD_KEYS)}"
                )
            entry[key] = "test" if key == "role" and value == "unused" else value
        if entry.get("role") not in (None, *_ROLES):
            raise InputError(f"settings: role {quoted(entry['role'])}; give {', '.join(_ROLES)}")
    # one choice of columns holds for all files of a session
    plain = {"time": "t", "input": "u", "output": "y"}
    for said in _table(changes, "columns").values():
        chosen = said if isinstance(said, Mapping) else {}
        for key, column in chosen.items():
            document.setdefault("columns", {})[plain.get(key, key)] = column
    for key, unit in _table(changes, "units").items():
        document.setdefault("units", {})[plain.get(key, key)] = unit
    if "quantities" in changes:
        document["quantities"] = _table(changes, "quantities")
    write_atomic(folder / SETTINGS, _toml(document))


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


def columns_of(file: Path) -> list[str]:
    """Return the names in the header of a text file, for a list to choose from; none of others."""
    if file.suffix.lower() not in (".csv", ".txt", ".dat", ".tsv"):
        return []
    with file.open(encoding="utf-8", errors="replace") as stream:
        for line in stream:
            bare = line.strip().lstrip("#%")
            words = [w.strip().strip('"') for w in _SEPARATORS.split(bare)]
            if len(words) == 1:
                words = bare.split()
            if any(words):
                return [w for w in words if w and not _is_number(w)]
    return []


def _is_number(word: str) -> bool:
    try:
        float(word.replace(",", "."))
    except ValueError:
        return False
    return True
