"""Attacks on folders: each entry in turn is no file, leads elsewhere, or bears the name of a module.

Whatever stands there: a value or one line, in time, and nothing outside the folder is changed. Who
writes to a name that is a link replaces the link, and never what it leads to.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import stat
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

import numpy as np

from rdpi_gym.measurement import load
from rdpi_gym.plant import P5
from rdpi_gym.support.files import write_atomic, write_json
from rdpi_gym.support.folders import replaced_folder
from rdpi_gym.support.store import named_rows
from tests.fuzz import subjects
from tests.fuzz.structure import shuffled
from tests.fuzz.subjects import Case, Subject

INSIDE, OUTSIDE = "inside", "outside"
_LARGE = 2**40
_MODULES = ("numpy", "json", "h5py", "scipy", "rdpi_gym", "sitecustomize", "matlab_child")
_CODE = "import pathlib\npathlib.Path(__file__).with_name('ran').touch()\n"


@dataclass(frozen=True)
class Target:
    """A folder that is read or written.

    Parameters
    ----------
    fill
        Makes it, whole.
    entries
        What is replaced, relative to it; what is not there is a place that is written.
    act
        Reads it, or writes to it.
    """

    fill: Callable[[Path], Any]
    entries: Sequence[str]
    act: Callable[[Path], Any]


# what stands in an entry's place; `outside` is a copy of what stood there


def _link(path: Path, outside: Path) -> None:
    path.symlink_to(outside)


def _to_nowhere(path: Path, outside: Path) -> None:
    path.symlink_to(outside.with_name("nowhere"))


def _loop(path: Path, outside: Path) -> None:
    path.symlink_to(path.name)


def _up(path: Path, outside: Path) -> None:
    path.symlink_to("..")


def _fifo(path: Path, outside: Path) -> None:
    os.mkfifo(path)


def _socket(path: Path, outside: Path) -> None:
    own, place = socket.socket(socket.AF_UNIX), Path.cwd()
    os.chdir(path.parent)  # a name of a socket is short
    try:
        own.bind(path.name)
    finally:
        os.chdir(place)
        own.close()


def _device(name: str) -> Callable[[Path, Path], None]:
    return lambda path, outside: path.symlink_to(name)


def _made_device(path: Path, outside: Path) -> None:
    try:
        os.mknod(path, stat.S_IFCHR | 0o666, os.makedev(1, 5))  # /dev/zero
    except PermissionError:  # for root alone
        path.symlink_to("/dev/zero")


def _folder(path: Path, outside: Path) -> None:
    path.mkdir()


def _full_folder(path: Path, outside: Path) -> None:
    (path / "a").mkdir(parents=True)
    (path / "a" / "b.txt").write_text("b")


def _unreadable(path: Path, outside: Path) -> None:
    shutil.copytree(outside, path) if outside.is_dir() else shutil.copyfile(outside, path)
    path.chmod(0)  # root reads it nevertheless


def _empty(path: Path, outside: Path) -> None:
    path.touch()


def _large(path: Path, outside: Path) -> None:
    path.touch()
    os.truncate(path, _LARGE)


def _absent(path: Path, outside: Path) -> None:
    pass


def _modules(path: Path, outside: Path) -> None:
    shutil.copytree(outside, path) if outside.is_dir() else shutil.copyfile(outside, path)
    for name in _MODULES:
        (path.parent / f"{name}.py").write_text(_CODE)


ATTACKS: dict[str, Callable[[Path, Path], None]] = {
    "link": _link, "link to nowhere": _to_nowhere, "loop": _loop, "link up": _up,
    "fifo": _fifo, "socket": _socket, "link to /dev/zero": _device("/dev/zero"),
    "link to /dev/full": _device("/dev/full"), "link to /dev/tty": _device("/dev/tty"),
    "device": _made_device, "folder": _folder, "full folder": _full_folder, "unreadable": _unreadable,
    "empty": _empty, "large": _large, "absent": _absent, "modules": _modules,
}  # fmt: skip


# targets


def _records(folder: Path) -> None:
    (folder / "run.csv").write_text(subjects.TEXTS[0])
    np.savez(folder / "more.npz", **subjects.COLUMNS)
    (folder / "dataset.toml").write_text('title = "a"\n')


def _matlab(folder: Path) -> None:
    (folder / "third.mat").write_bytes(subjects.v5_files()[0])
    (folder / "fourth.mat").write_bytes(subjects.v73_files()[0])


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
    from rdpi_gym.laboratory.bringing import read, write_settings
    from rdpi_gym.laboratory.session import Session
    from rdpi_gym.laboratory.telling import state_of

    session = Session(folder)
    told = json.dumps(state_of(session, None, None, {}), allow_nan=False)
    session.write({"do": "go", "path": ["s1"], "redo": []})
    write_settings(folder / "data", {"title": "b"}, ["run"])
    return told, read(folder / "data")


def _copy_in(folder: Path) -> Any:
    from rdpi_gym.laboratory.bringing import copy_in

    return copy_in(folder, folder.parent / "taken")


def _copy_over(folder: Path) -> Any:
    """Copy into a folder whose entries are attacked."""
    from rdpi_gym.laboratory.bringing import copy_in

    with tempfile.TemporaryDirectory() as name:
        _records(Path(name))
        return copy_in(Path(name), folder)


def _old(folder: Path) -> None:
    write_json(folder / "a.json", {"format": "mine", "version": 1})
    (folder / "set").mkdir()
    (folder / "set" / "a.txt").write_text("old")
    named_rows(folder / "rows.jsonl").append(subjects.ROWS[:2])


def _write_set(folder: Path) -> None:
    with replaced_folder(folder / "set") as fresh:
        write_atomic(fresh / "a.txt", "new")


def _append(folder: Path) -> Any:
    store = named_rows(folder / "rows.jsonl")
    store.append(subjects.ROWS[2:4])
    store.set_aside(lambda row: row["key"] == subjects.ROWS[0]["key"])
    return store.rows


@contextmanager
def submitted() -> Iterator[Path]:
    """A submission of a controller of one's own."""
    import sys

    from benchmarks.stages.submission import submit

    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "fuzzed_controller.py").write_text(
            "from baselines.lookup import make_controller\n"
            "def make(belief, layout):\n    return make_controller('none', belief, layout)\n"
        )
        with patch.object(sys, "path", [*sys.path, name]):
            submit("fuzzed_controller:make", ["Bare"], 1, Path(name) / "entry", jobs=1)
        yield Path(name) / "entry"


@contextmanager
def _runs() -> Iterator[dict[str, Target]]:
    """Folders of the benchmark, of a submission, of an export."""
    from benchmarks.stages.submission import read_submission
    from benchmarks.tracking.run import benchmark
    from benchmarks.tracking.selection import select
    from rdpi_gym.firmware.making import package_of
    from rdpi_gym.firmware.writing.package import write_package

    chosen = select(["none"], ["P5"], ["sine"], [1e-2], [0])
    package = package_of(P5, 1e-4, None)
    with tempfile.TemporaryDirectory() as name, submitted() as entry:
        place = Path(name)
        rows = benchmark(chosen, place / "bench", jobs=1).rows
        write_package(package, place / "c")
        code = next(path.name for path in entry.glob("submitted*"))

        def copied(which: Path, folder: Path) -> None:
            shutil.copytree(which, folder, dirs_exist_ok=True)

        def bench(folder: Path) -> Any:
            with patch("benchmarks.sweep.run_cases", lambda *_: [rows]):
                return benchmark(chosen, folder, jobs=1)

        yield {
            "benchmark": Target(partial(copied, place / "bench"), ["rows.jsonl"], bench),
            "submission": Target(
                partial(copied, entry), ["submission.json", "task-rows.jsonl", code], read_submission
            ),
            "export": Target(
                partial(copied, place / "c"),
                ["program.json", "main.c", "examples", "build"],
                partial(write_package, package),
            ),
        }  # fmt: skip


@contextmanager
def _trained() -> Iterator[dict[str, Target]]:
    """Folders of policies and checkpoints; none where torch is not installed."""
    try:
        described, weights = subjects.policy_files()
    except ModuleNotFoundError:
        yield {}
        return
    from baselines.learned.checkpoint import load_checkpoint, save_checkpoint
    from baselines.learned.policy import Policy
    from tests.fuzz.documents import Learner

    def policy(folder: Path) -> None:
        (folder / "policy.json").write_text(json.dumps(described))
        (folder / "weights.pt").write_bytes(weights)

    with tempfile.TemporaryDirectory() as name:
        policy(Path(name))
        whole = Policy.load(Path(name))
    where = f"{Learner.timesteps:012d}"
    kept = [where, *(f"{where}/{name}" for name in ("checkpoint.json", "model.pt", "replay.npz"))]
    yield {
        "policy": Target(policy, ["policy.json", "weights.pt"], subjects.read_policy),
        "policy written": Target(policy, ["policy.json", "weights.pt"], whole.save),
        "checkpoint": Target(
            lambda folder: save_checkpoint(folder, Learner(), {"rows": []}),
            kept,
            lambda folder: load_checkpoint(folder, Learner()),
        ),
        "checkpoint written": Target(
            lambda folder: save_checkpoint(folder, Learner(), {"rows": []}),
            kept,
            lambda folder: save_checkpoint(folder, Learner(), {"rows": [1]}),
        ),
    }


_RECORDS = ("run.csv", "more.npz", "dataset.toml")
_TARGETS = {
    "records": Target(_records, _RECORDS, load),
    "matlab": Target(_matlab, ["third.mat", "fourth.mat"], load),
    "record": Target(_records, _RECORDS, lambda folder: load(folder / "run.csv")),
    "session": Target(
        _session,
        ["journal.jsonl", "data", "refused", "refused/bad.csv", "data/.run.csv.part"]
        + [f"data/{name}" for name in _RECORDS],
        _go_on,
    ),
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


@contextmanager
def folders() -> Iterator[Subject]:
    """Every attack on every entry of every folder."""
    with ExitStack() as stack:
        targets = {
            **_TARGETS,
            **stack.enter_context(_runs()),
            **stack.enter_context(_trained()),
        }
        combined = [
            (target, entry, attack)
            for target in targets.values()
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
                target = list(targets.values())[rng.number]
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

        yield Subject(write, read, len(targets), len(targets) + len(combined))


def _seen(folder: Path) -> dict[Path, Any]:
    """Return what is in a folder: content, time of the last change, rights."""
    found = {}
    for path in sorted(folder.rglob("*")):
        told = path.lstat()
        content = path.read_bytes() if path.is_file() else None
        found[path] = (content, None if content is None else told.st_mtime_ns, told.st_mode)
    return found
