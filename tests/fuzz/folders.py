"""Attacks on folders: each entry in turn is no file, leads elsewhere, or bears the name of a module.

Whatever stands there: a value or one line, in time, and nothing outside the folder is changed. Who
writes to a name that is a link replaces the link, and never what it leads to.
"""

from __future__ import annotations

import os
import shutil
import socket
import stat
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from rdpi_gym.measurement import load
from rdpi_gym.plant import P5
from rdpi_gym.support.files import replaced_folder, write_atomic, write_json
from rdpi_gym.support.store import named_rows
from tests.fuzz import readers
from tests.fuzz.readers import Case, Learner, Subject
from tests.fuzz.structure import shuffled

INSIDE, OUTSIDE = "inside", "outside"
_MODULES = ("numpy", "json", "h5py", "scipy", "rdpi_gym", "sitecustomize", "matlab_child")
_CODE = "import pathlib\npathlib.Path(__file__).with_name('ran').touch()\n"


@dataclass(frozen=True)
class Target:
    """A folder that is read or written."""

    fill: Callable[[Path], Any]
    entries: Sequence[str]  # replaced one by one; one that is not there is a place that is written
    act: Callable[[Path], Any]


def _socket(path: Path, outside: Path) -> None:
    own, place = socket.socket(socket.AF_UNIX), Path.cwd()
    os.chdir(path.parent)  # a name of a socket is short
    try:
        own.bind(path.name)
    finally:
        os.chdir(place)
        own.close()


def _made_device(path: Path, outside: Path) -> None:
    try:
        os.mknod(path, stat.S_IFCHR | 0o666, os.makedev(1, 5))  # /dev/zero
    except PermissionError:  # for root alone
        path.symlink_to("/dev/zero")


def _full_folder(path: Path, outside: Path) -> None:
    (path / "a").mkdir(parents=True)
    (path / "a" / "b.txt").write_text("b")


def _again(path: Path, outside: Path) -> None:
    shutil.copytree(outside, path) if outside.is_dir() else shutil.copyfile(outside, path)


def _unreadable(path: Path, outside: Path) -> None:
    _again(path, outside)
    path.chmod(0)  # root reads it nevertheless


def _large(path: Path, outside: Path) -> None:
    path.touch()
    os.truncate(path, 2**40)


def _modules(path: Path, outside: Path) -> None:
    _again(path, outside)
    for name in _MODULES:
        (path.parent / f"{name}.py").write_text(_CODE)


def _link(leads_to: Callable[[Path, Path], Path | str]) -> Callable[[Path, Path], None]:
    return lambda path, outside: path.symlink_to(leads_to(path, outside))


ATTACKS: dict[str, Callable[[Path, Path], None]] = {
    "link": _link(lambda path, outside: outside),
    "link to nowhere": _link(lambda path, outside: outside.with_name("nowhere")),
    "loop": _link(lambda path, outside: path.name),
    "link up": _link(lambda path, outside: ".."),
    **{f"link to {name}": _link(lambda path, outside, name=name: name)  # type: ignore[misc]
       for name in ("/dev/zero", "/dev/full", "/dev/tty")},
    "fifo": lambda path, outside: os.mkfifo(path),
    "socket": _socket,
    "device": _made_device,
    "folder": lambda path, outside: path.mkdir(),
    "full folder": _full_folder,
    "unreadable": _unreadable,
    "empty": lambda path, outside: path.touch(),
    "large": _large,
    "absent": lambda path, outside: None,
    "modules": _modules,
}  # fmt: skip
"""What stands in an entry's place; `outside` is a copy of what stood there."""


# targets


def _records(folder: Path) -> None:
    (folder / "run.csv").write_text(readers.TEXTS[0])
    np.savez(folder / "more.npz", **readers.COLUMNS)
    (folder / "dataset.toml").write_text('title = "a"\n')


def _session(folder: Path) -> None:
    from rdpi_gym.laboratory.session import Session, Step

    session = Session(folder)
    _records(folder / "data")
    session.write({"do": "read"})
    step = Step("s1", None, "a", {"kind": "fit"}, P5, 0.5, 0.6, {"run": 0.5})
    session.write({"do": "step", "step": step.to_dict()})
    (folder / "refused").mkdir()
    (folder / "refused" / "bad.csv").write_text("u,y\n")


def _go_on(folder: Path) -> Any:
    """Open a session, tell its state, and write to its journal and settings."""
    from rdpi_gym.laboratory.data_import import read, write_settings
    from rdpi_gym.laboratory.session import Session

    told = readers.read_journal(folder)
    Session(folder).write({"do": "go", "path": ["s1"], "redo": []})
    write_settings(folder / "data", {"title": "b"}, ["run"])
    return told, read(folder / "data")


def _copy_in(folder: Path) -> Any:
    from rdpi_gym.laboratory.data_import import copy_in

    return copy_in(folder, folder.parent / "taken")


def _copy_over(folder: Path) -> Any:
    """Copy into a folder whose entries are attacked."""
    from rdpi_gym.laboratory.data_import import copy_in

    with tempfile.TemporaryDirectory() as name:
        _records(Path(name))
        return copy_in(Path(name), folder)


def _old(folder: Path) -> None:
    write_json(folder / "a.json", {"format": "mine", "version": 1})
    (folder / "set").mkdir()
    (folder / "set" / "a.txt").write_text("old")
    named_rows(folder / "rows.jsonl").append(readers.ROWS[:2])


def _write_set(folder: Path) -> None:
    with replaced_folder(folder / "set") as fresh:
        write_atomic(fresh / "a.txt", "new")


def _append(folder: Path) -> Any:
    store = named_rows(folder / "rows.jsonl")
    store.append(readers.ROWS[2:4])
    store.set_aside(lambda row: row["key"] == readers.ROWS[0]["key"])
    return store.rows


def _read(stack: ExitStack) -> dict[str, Target]:
    """Folders of the documents of readers; those of policies where torch is installed."""
    found = {}
    for name in ("matlab-v5", "matlab-v7.3", "tracking rows", "submission", *_LEARNED):
        with suppress(ModuleNotFoundError):
            made = readers.READERS[name](stack)
            files = made.documents[0].attacked(())
            folders = {str(Path(each).parent) for each in files} - {"."}
            found[name] = Target(partial(readers.put, files=files), [*files, *folders], made.read)
    return found


def _written(read: Mapping[str, Target]) -> dict[str, Target]:
    """The same folders written over, and an export."""
    from rdpi_gym.firmware.making import package_of
    from rdpi_gym.firmware.writing.package import write_package

    package = package_of(P5, 1e-4, None)
    made = ["program.json", "main.c", "examples", "build"]
    again = partial(write_package, package)
    found = {"export": Target(again, made, again)}
    if {*_LEARNED} <= {*read}:
        from baselines.learned.checkpoint import save_checkpoint
        from baselines.learned.policy import Policy

        with tempfile.TemporaryDirectory() as name:
            read["policy"].fill(Path(name))
            save = Policy.load(Path(name)).save
        found["policy written"] = replace(read["policy"], act=save)
        found["checkpoint written"] = replace(
            read["checkpoint"], act=lambda folder: save_checkpoint(folder, Learner(), {"rows": [1]})
        )
    return found


_LEARNED = ("policy", "checkpoint")
_RECORDS = ("run.csv", "more.npz", "dataset.toml")
_SESSION = ("journal.jsonl", "data", "refused", "refused/bad.csv", "data/.run.csv.part",
            *(f"data/{name}" for name in _RECORDS))  # fmt: skip
_TARGETS = {
    "records": Target(_records, _RECORDS, load),
    "record": Target(_records, _RECORDS, lambda folder: load(folder / "run.csv")),
    "session": Target(_session, _SESSION, _go_on),
    "brought": Target(_records, _RECORDS, _copy_in),
    "brought over": Target(_records, _RECORDS, _copy_over),
    "file": Target(
        _old,
        ["a.json", "new.json"],
        lambda folder: [write_atomic(folder / name, "new") for name in ("a.json", "new.json")],
    ),
    "set": Target(_old, ["set", "set/a.txt"], _write_set),
    "rows": Target(_old, ["rows.jsonl", "rows-stale-1.jsonl"], _append),
}


def attacked_folders(stack: ExitStack) -> Subject:
    """Every attack on every entry of every folder."""
    read_ones = _read(stack)
    targets = [*_TARGETS.values(), *read_ones.values(), *_written(read_ones).values()]
    combined = [
        (target, entry, attack)
        for target in targets
        for entry in target.entries
        for attack in ATTACKS.values()
    ]
    acting: list[tuple[Target, dict[Path, Any]]] = []

    def write(rng: Random, folder: Path) -> None:
        assert isinstance(rng, Case)
        inside, outside = folder / INSIDE, folder / OUTSIDE
        inside.mkdir()
        outside.mkdir()
        if rng.number < len(targets):
            target = targets[rng.number]
            target.fill(inside)
        else:
            number = shuffled(rng.seed_of_all, len(combined), rng.number - len(targets))
            target, entry, attack = combined[number]
            target.fill(inside)
            path, copy = inside / entry, outside / Path(entry).name
            path.rename(copy) if path.exists() else copy.write_text("canary")
            attack(path, copy)
        acting[:] = [(target, _seen(outside))]

    def read(folder: Path) -> Any:
        ((target, before),) = acting
        try:
            return target.act(folder / INSIDE)
        finally:
            after = _seen(folder / OUTSIDE)
            assert after == before, f"changed outside: {before} {after}"
            ran = list(folder.rglob("ran"))
            assert not ran, f"code of the folder was run: {ran}"

    return Subject(write, read, len(targets), len(targets) + len(combined))


def _seen(folder: Path) -> dict[Path, Any]:
    """Return what is in a folder: content, time of the last change, rights."""
    found = {}
    for path in sorted(folder.rglob("*")):
        told = path.lstat()
        content = path.read_bytes() if path.is_file() else None
        found[path] = (content, None if content is None else told.st_mtime_ns, told.st_mode)
    return found
