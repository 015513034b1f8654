"""Valid documents of every reader, as trees whose integers, types, keys and headers are attacked."""

from __future__ import annotations

import hashlib
import io
import json
import pickletools
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd

from rdpi_gym.measurement import DataOptions, load
from rdpi_gym.measurement.matlab import MatlabReader
from rdpi_gym.measurement.stacked import stacked_tags
from rdpi_gym.plant import P5, PlantModel, named_plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.named import PLANTS
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.store import RowStore, named_rows
from tests.fuzz import subjects
from tests.fuzz.examples import example
from tests.fuzz.folders import folders, submitted
from tests.fuzz.structure import (
    RIGHT,
    Attacks,
    Document,
    archive,
    binary_words,
    header_of,
    npy,
    packed_archive,
    zip_words,
)
from tests.fuzz.subjects import Case, Read, Subject

_ZEROS = 2**28 + 2**27
DATA = [values.tobytes() for values in subjects.COLUMNS.values()]


def json_document(name: str, tree: Any) -> Document:
    return Document(tree, lambda tree: json.dumps(tree).encode(), lambda _, raw: {name: raw})


# records


def archived(name: str, arrays: dict[str, Any], method: int, said: Any = None) -> Document:
    """Write arrays, their headers a tree, and perhaps JSON that is an array of bytes."""
    contents = {each: np.ascontiguousarray(array).tobytes() for each, array in arrays.items()}
    tree = {"headers": {each: header_of(array) for each, array in arrays.items()}, "said": said}
    if said is not None:
        tree["headers"]["document"] = header_of(np.zeros(1, np.uint8)) | {"shape": [RIGHT]}

    def build(tree: Any) -> bytes:
        members = contents if said is None else {"document": _json(tree.get("said")), **contents}
        headers = tree.get("headers")
        headers = headers if isinstance(headers, dict) else {}
        return archive(
            {
                f"{n}.npy": npy(headers[n], content)
                for n, content in members.items()
                if n in headers
            },
            method,
        )

    return Document(tree, build, lambda _, raw: {name: raw}, zip_words)


def _json(value: Any) -> bytes:
    return json.dumps(value).encode()


def npz_documents() -> list[Document]:
    stack = np.arange(240.0).reshape(40, 3, 2)
    narrow = {**subjects.COLUMNS, "u": np.arange(40, dtype=np.int8)}
    stored, packed = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED
    return [
        archived("run.npz", subjects.COLUMNS, stored),
        archived("run.npz", narrow, packed),
        archived("run.npz", {"u_low": stack, "y_low": stack, "u_test": stack, "y_test": stack}, packed),
        archived("run.npz", {"t": subjects.T, "u": stack[:, :, 0], "y": subjects.T}, stored),
        _long(),
    ]  # fmt: skip


def _long() -> Document:
    """Make an archive whose voltage goes on in zeros that are 1000 times smaller on the disk."""
    tail = zlib.compressobj(wbits=-15)
    zeros = b"".join(tail.compress(bytes(2**20)) for _ in range(_ZEROS // 2**20)) + tail.flush()

    def build(tree: Any) -> bytes:
        members = {}
        for name, values in subjects.COLUMNS.items():
            head = npy(tree[name], values.tobytes()) if name in tree else b""
            packer = zlib.compressobj(wbits=-15)
            if name == "u":
                packed = packer.compress(head) + packer.flush(zlib.Z_FULL_FLUSH) + zeros
            else:
                packed = packer.compress(head) + packer.flush()
            members[f"{name}.npy"] = (packed, len(head) + (_ZEROS if name == "u" else 0))
        return packed_archive(members)

    tree = {name: header_of(values) for name, values in subjects.COLUMNS.items()}
    return Document(tree, build, lambda _, raw: {"run.npz": raw}, zip_words)


def toml_documents() -> list[Document]:
    import tomllib

    tree = tomllib.loads(subjects.TOML)
    more = {
        "quantities": {"output": {"name": "force", "symbol": "F", "unit": "kN"}},
        "records": {"run": {"ts_s": 0.02}},
        "columns": {"inputs": ["u"]},
    }

    def files(_: Any, raw: bytes) -> dict[str, bytes]:
        data = subjects.TEXTS[0].encode()
        return {"dataset.toml": raw, "run.csv": data, "other.csv": data}

    return [Document(each, lambda tree: _toml(tree).encode(), files) for each in (tree, more)]


def _toml(tree: Any) -> str:
    lines = [f"{json.dumps(key)} = {_toml_value(value)}" for key, value in tree.items()]
    return "\n".join(line for line in lines if not line.endswith("= ")) + "\n"


def _toml_value(value: Any) -> str:
    if isinstance(value, dict):
        inner = [f"{json.dumps(k)} = {_toml_value(v)}" for k, v in value.items() if v is not None]
        return "{" + ", ".join(inner) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_toml_value(v) for v in value if v is not None) + "]"
    return "" if value is None else json.dumps(value)


def v5_documents() -> list[Document]:
    """MATLAB files up to v7; the integers of a compressed one are attacked inside it as well."""

    def plain(raw: bytes) -> Document:
        return Document(
            None,
            lambda _: raw,
            lambda _, changed: {"run.mat": changed},
            partial(binary_words, data=DATA, first=0 if raw[:4] != b"MATL" else 116),
        )

    def unpacked(raw: bytes) -> Document:
        elements, at = [], 128
        while at < len(raw):
            size = struct.unpack_from("<I", raw, at + 4)[0]
            elements.append(zlib.decompress(raw[at + 8 : at + 8 + size]))
            at += 8 + size

        def packed(_: Any, inner: bytes) -> dict[str, bytes]:
            parts, at = [raw[:128]], 0
            for each in elements:
                content = zlib.compress(inner[at : at + len(each)])
                parts.append(struct.pack("<II", 15, len(content)) + content)
                at += len(each)
            return {"run.mat": b"".join(parts)}

        words = partial(binary_words, data=DATA)
        return Document(None, lambda _: b"".join(elements), packed, words)

    files = subjects.v5_files()
    return [*map(plain, files), *(unpacked(raw) for raw in (files[1], files[3]))]


def v73_documents() -> list[Document]:
    files = subjects.v73_files()
    files = [*files[:3], *files[8:], *files[3:8]]  # the last five are refused as they are
    lengths = (8, 40, 320, 64, 256, 2**16, 2**32)  # of chunks, of the data, of what is told of them
    return [
        Document(
            None,
            lambda _, raw=raw: raw,
            lambda _, changed: {"run.mat": changed},
            partial(binary_words, data=DATA, sizes=lengths),
        )
        for raw in files
    ]


# models, signals, results


def plant_documents() -> list[Document]:
    trees = [named_plant(name).to_dict() for name in PLANTS]
    trees += [
        PlantModel(P5.hysteresis, name, (-80.0, 80.0), (0.0, 40.0), effects=(kind(),)).to_dict()
        for name, kind in CATALOGUE.items()
    ]
    return [json_document("plant.json", tree) for tree in (*subjects.plants(), *trees)]


def result_documents() -> list[Document]:
    """Saved results of every kind, one of each made of its annotations."""
    from rdpi_gym.face.results import _kinds

    found = []
    with tempfile.TemporaryDirectory() as name:
        for kind in _kinds():
            path = example(kind).save(Path(name) / "result.npz")
            with np.load(path) as file:
                arrays = {each: file[each] for each in file.files if each != "document"}
                said = json.loads(file["document"].tobytes())
            found.append(archived("result.npz", arrays, zipfile.ZIP_STORED, said))
    return found


def diagnosis_documents() -> list[Document]:
    from rdpi_gym.face.search import SearchResult

    found = example(SearchResult)
    kinds = [replace(found, kind=kind) for kind in ("diagnosis", "discovery", "addition")]
    return [json_document("diagnosis.json", json.loads(_json(each.to_dict()))) for each in kinds]


def read_diagnosis(folder: Path) -> Any:
    from rdpi_gym.diagnosis.results import SearchResult

    return SearchResult.load(folder / "diagnosis.json")


# rows of results, sums of which are right: who wrote them could write anything


def rows_document(name: str, store: RowStore[Any]) -> Document:
    rows = list(store.rows.values())

    def build(tree: Any) -> bytes:
        told = tree if isinstance(tree, list) else [tree]
        return store._head + b"".join(store._line(row) for row in told if isinstance(row, dict))

    return Document(rows, build, lambda _, raw: {name: raw})


@contextmanager
def tracking() -> Iterator[Subject]:
    """Rows of `rdpi bench`, read by the run that goes on from them."""
    from benchmarks.rows import TRACKING
    from benchmarks.tracking.evaluation import evaluate
    from benchmarks.tracking.run import benchmark
    from benchmarks.tracking.selection import select

    chosen = select(["none", "classical-static"], ["P5"], ["sine"], [1e-2], [0])
    with tempfile.TemporaryDirectory() as name:
        rows = benchmark(chosen, Path(name), jobs=1).rows
        document = rows_document("rows.jsonl", TRACKING.open(Path(name)))

    def read(folder: Path) -> Any:
        with patch("benchmarks.sweep.run_cases", lambda *_: [rows]):
            return evaluate(chosen, benchmark(chosen, folder, jobs=1)).order

    yield subject_of([document], read)


@contextmanager
def stages() -> Iterator[Subject]:
    """Rows of the tasks, read by the run that goes on from them."""
    from benchmarks.rows import TASKS
    from benchmarks.stages.run import run_tasks
    from benchmarks.stages.tables import TaskScores

    with tempfile.TemporaryDirectory() as name:
        rows = run_tasks(["none"], ["Bare"], 1, Path(name), jobs=1).rows
        document = rows_document("task-rows.jsonl", TASKS.open(Path(name)))

    def read(folder: Path) -> Any:
        with patch("benchmarks.sweep.run_cases", lambda *_: [rows]):
            found = run_tasks(["none"], ["Bare"], 1, folder, jobs=1)
        return repr(TaskScores(tuple(found.rows), "public seed 2026", found.computed, found.notes))

    yield subject_of([document], read)


@contextmanager
def candidates() -> Iterator[Subject]:
    """Finished candidates of a search."""
    from rdpi_gym.diagnosis.search.checkpoint import FORMAT, Checkpoint
    from rdpi_gym.identification.jacobian import Variant
    from rdpi_gym.identification.joint import JointFit
    from rdpi_gym.measurement import Record

    t = subjects.T
    record = Record("run", t, np.sin(t), 8.0 * np.sin(t), ts_s=0.02)
    kinds = [CATALOGUE[name] for name in ("creep", "resonance")]
    start = P5.hysteresis
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "candidates.jsonl"
        checkpoint = Checkpoint(path, [record])
        for kind in kinds:
            fit = JointFit(Variant(start, (kind(),)), 0.1, ("a",), {"δ2": 0.1}, 3, True)
            checkpoint.put(start, (), kind, None, fit)
        document = rows_document("candidates.jsonl", named_rows(path, FORMAT))

    def read(folder: Path) -> Any:
        checkpoint = Checkpoint(folder / "candidates.jsonl", [record])
        return [checkpoint.get(start, (), kind) for kind in kinds]

    yield subject_of([document], read)


@contextmanager
def submissions() -> Iterator[Subject]:
    """Description of a submission, beside its code and its rows."""
    from benchmarks.stages.submission import FILE, read_submission

    with submitted() as folder:
        said = json.loads((folder / FILE).read_text())
        beside = {
            path.name: path.read_bytes()
            for path in folder.iterdir()
            if path.is_file() and path.name != FILE
        }
    document = json_document(FILE, said)
    document = replace(document, files=lambda _, raw: {FILE: raw, **beside})
    yield subject_of([document], read_submission)


# policies and what trains them


@contextmanager
def policies() -> Iterator[Subject]:
    """Policies: description, archive and pickle, the hash of the weights right."""
    described, weights = subjects.policy_files()
    with zipfile.ZipFile(io.BytesIO(weights)) as file:
        members = {name: file.read(name) for name in file.namelist()}
    pickled = next(name for name in members if name.endswith("data.pkl"))

    def files(tree: Any, raw: bytes) -> dict[str, bytes]:
        said = tree.get("said")
        if isinstance(said, dict) and said.get("weights_sha256") == described["weights_sha256"]:
            said = {**said, "weights_sha256": hashlib.sha256(raw).hexdigest()}
        return {"policy.json": _json(said), "weights.pt": raw}

    tree = {"said": described}
    whole = Document(tree, lambda _: archive(members), files, zip_words)
    inside = Document(
        tree,
        lambda _: members[pickled],
        lambda tree, raw: files(tree, archive({**members, pickled: raw})),
        _pickled_integers,
    )
    yield subject_of([whole, inside], subjects.read_policy)


def _pickled_integers(content: bytes) -> list[tuple[int, int]]:
    sizes = {"BININT": 4, "BININT1": 1, "BININT2": 2, "BINPUT": 1, "BINGET": 1, "BINUNICODE": 4}
    sizes |= {"LONG_BINPUT": 4, "LONG_BINGET": 4, "PROTO": 1, "SHORT_BINUNICODE": 1}
    return [
        (at + 1, sizes[code.name])
        for code, _, at in pickletools.genops(content)
        if code.name in sizes and at is not None
    ]


def student_documents() -> list[Document]:
    """A shipped student: description and arrays, the hash right."""
    from baselines.learned.policy import policy_folder

    folder = policy_folder("imitation-creep")
    said = json.loads((folder / "policy.json").read_text())
    name = next(path.name for path in folder.iterdir() if path.suffix == ".npz")
    with np.load(folder / name) as file:
        arrays = {each: file[each] for each in file.files}
    inner = archived(name, arrays, zipfile.ZIP_STORED)

    def build(tree: Any) -> bytes:
        headers = tree.get("headers")
        return inner.build({"headers": headers, "said": None})

    def files(tree: Any, raw: bytes) -> dict[str, bytes]:
        told = tree.get("said")
        if isinstance(told, dict) and told.get("weights_sha256") == said["weights_sha256"]:
            told = {**told, "weights_sha256": hashlib.sha256(raw).hexdigest()}
        return {"policy.json": _json(told), name: raw}

    return [Document({**inner.tree, "said": said}, build, files, zip_words)]


@contextmanager
def hyperparameters() -> Iterator[Subject]:
    """Hyper-parameters; JSON is YAML."""
    import yaml
    from stable_baselines3 import PPO, SAC

    from baselines.learned import settings

    kinds = {"ppo.yml": PPO, "sac.yml": SAC}
    documents = [
        json_document(name, yaml.safe_load((settings.SHIPPED / name).read_text())) for name in kinds
    ]

    def read(folder: Path) -> Any:
        (path,) = folder.iterdir()
        return settings.read_settings(path, kinds[path.name])

    yield subject_of(documents, read)


class Learner:
    """Parts of a checkpoint, without a training."""

    kind, timesteps, updates = "sac", 100, 7

    def tensors(self) -> Any:
        import torch

        return {"actor": {"weight": torch.ones(3, 2)}}

    def arrays(self) -> Any:
        return {"observations": np.arange(12.0).reshape(4, 3), "position": np.array([2])}

    def restore(self, kept: Any) -> None:
        assert kept.tensors["actor"]["weight"].shape == (3, 2)
        for name in self.arrays():
            kept.read(name)


@contextmanager
def checkpoints() -> Iterator[Subject]:
    """Checkpoint of an interrupted training: description, archive of tensors, replay buffer."""
    from baselines.learned.checkpoint import _seal, load_checkpoint, save_checkpoint

    with tempfile.TemporaryDirectory() as name:
        save_checkpoint(Path(name), Learner(), {"rows": [], "timesteps": 100})
        (folder,) = Path(name).iterdir()
        said = json.loads((folder / "checkpoint.json").read_text())
        model = (folder / "model.pt").read_bytes()
    inner = archived("replay.npz", Learner().arrays(), zipfile.ZIP_STORED)

    def files(tree: Any, raw: bytes) -> dict[str, bytes]:
        told = tree.get("said")
        if isinstance(told, dict):
            if told.get("files") == said["files"]:
                hashed = {"model.pt": model, "replay.npz": raw}
                sums = {n: hashlib.sha256(content).hexdigest() for n, content in hashed.items()}
                told = {**told, "files": sums}
            if told.get("sha256") == said["sha256"]:
                told = {**told, "sha256": _seal(told)}
        where = folder.name
        return {f"{where}/checkpoint.json": _json(told), f"{where}/model.pt": model, f"{where}/replay.npz": raw}  # fmt: skip

    document = Document(
        {**inner.tree, "said": said},
        lambda tree: inner.build({"headers": tree.get("headers"), "said": None}),
        files,
        zip_words,
    )
    yield subject_of([document], lambda folder: load_checkpoint(folder, Learner()))


def tuning_documents() -> list[Document]:
    from baselines.tuning import TUNED

    return [
        json_document("tuned.json", json.loads((TUNED / "adaptive-dual-loop.json").read_text()))
    ]


# the laboratory


def journal_documents() -> list[Document]:
    """A session in which everything was done that a journal can hold."""
    from rdpi_gym.laboratory.session import Step

    plant = named_plant("P5").to_dict()
    numbers = {"train_um": 0.5, "validation_um": 0.6, "by_record_um": {"run": 0.5}}
    found = {"effect": "creep", "form": "", "plant": plant, **numbers, "parameters": {"a": 1.0}}
    found |= {"standard_errors": {"a": 0.1}, "at_bound": ["a"], "remark": ""}
    step = Step("s1", None, "Base model", {"kind": "fit", "core": None}, P5, 0.5, 0.6, {"run": 0.5})
    second = {**step.to_dict(), "id": "s2", "parent": "s1", "held": ["delta2_s"]}
    entry = {"bytes": 1000, "problem": None, "row": 3, "column": "u"}
    ranked = {"effect": "creep", "form": "", "share_of_excess": 0.5, "confidence": 0.9}
    ranked |= {"indistinguishable": ["resonance"], "remarks": ["a"], "probability": 0.5}
    left = {"remainder": "", "portrait_lines": [], "next_experiment": None, "noise_floor": 0.01}
    left |= {
        "settled": plant,
        "final": {"train_rmse": 0.4, "validation_rmse": 0.5, "by_record": {}},
    }
    result = {"candidates": [ranked], "chosen": ["creep"], "headline": "a", "lines": ["a"]}
    events = [
        {"do": "file", "name": "run.csv", "entry": entry},
        {"do": "read"},
        {"do": "step", "step": step.to_dict()},
        {"do": "refit", "step": "s1", "refit": found},
        {"do": "ranking", "step": "s1", "status": "done", "result": {**result, **left}},
        {"do": "step", "step": second},
        {"do": "update", "step": {**second, "held": []}},
        {"do": "go", "path": ["s1"], "redo": ["s2"]},
        {"do": "payoff", "step": "s1", "payoff": {"step": "s1", "rows": []}},
        {"do": "said", "step": "s1", "sentence": "a", "noise_um": 0.01},
    ]

    def build(tree: Any) -> bytes:
        return b"".join(_json(event) + b"\n" for event in tree)

    def files(_: Any, raw: bytes) -> dict[str, bytes]:
        return {"journal.jsonl": raw, "data/run.csv": subjects.TEXTS[0].encode()}

    # each event alone, after what it needs: of a long list the ends alone are attacked
    before = {4: [3], 6: [5], 7: [5]}
    parts = [
        [events[j] for j in [*([] if k < 2 else [1, 2]), *before.get(k, []), k]]
        for k in range(len(events))
    ]
    return [Document(part, build, files) for part in parts]


def read_journal(folder: Path) -> Any:
    from rdpi_gym.laboratory.session import Session
    from rdpi_gym.laboratory.telling import state_of

    session = Session(folder)
    return json.dumps(state_of(session, None, None, {}), allow_nan=False)


def settings_documents() -> list[Document]:
    """Settings of the data of a session, beside a file that is not read with it."""
    return [
        replace(
            each,
            files=lambda tree, raw, each=each: (
                {f"data/{name}": content for name, content in each.files(tree, raw).items()}
                | {"journal.jsonl": b'{"do": "read"}\n'}
            ),
        )
        for each in toml_documents()
    ]


def read_settings(folder: Path) -> Any:
    """Tell the state, change a setting, take one file and all into another session."""
    from rdpi_gym.laboratory.bringing import copy_in, write_settings

    def tried(what: Callable[[], Any]) -> str:
        try:
            return str(what())
        except InputError as error:
            return str(error)

    data, other = folder / "data", folder / "other"
    told = [
        tried(lambda: read_journal(folder)),
        tried(lambda: copy_in(data / "run.csv", other)),
        tried(lambda: copy_in(data, folder / "all")),
        tried(lambda: write_settings(data, {"records": {"run": {"role": "train"}}}, ["run"])),
    ]
    long = [line for line in told if "\n" in line]
    assert not long, long
    return told


# exported code


def program_documents() -> list[Document]:
    from rdpi_gym.firmware.making import package_of
    from rdpi_gym.firmware.writing.package import FORMAT, VERSION

    few = PlantModel(P5.hysteresis, "few", (-80.0, 80.0), (0.0, 40.0))
    return [
        json_document(
            "program.json",
            {"format": FORMAT, "version": VERSION, **package_of(few, 1e-4, name).recipe},
        )
        for name in (None, "none")
    ]


def read_program(folder: Path) -> Any:
    from rdpi_gym.firmware.making import package_again
    from rdpi_gym.firmware.writing.package import FORMAT, VERSION
    from rdpi_gym.support.files import read_json

    path = folder / "program.json"
    return package_again(read_json(path, FORMAT, VERSION), str(path))


# all of them


def subject_of(documents: list[Document], read: Read, refused: int = 0) -> Subject:
    """Make a subject of documents, the last of which are refused as they are."""
    attacks = Attacks(documents)

    def write(rng: Random, folder: Path) -> None:
        assert isinstance(rng, Case)
        for name, content in attacks.case(rng.seed_of_all, rng.number).items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(content)

    return Subject(write, read, len(documents) - refused, len(attacks) + len(documents))


@contextmanager
def _matlab(make: Callable[[], list[Document]], refused: int) -> Iterator[Subject]:
    with MatlabReader() as reader:
        made = subject_of(make(), subjects.read_mat(reader), refused)
        yield replace(made, other=subjects.pid_of(reader))


@contextmanager
def _plain(make: Callable[[], list[Document]], read: Read, refused: int = 0) -> Iterator[Subject]:
    yield subject_of(make(), read, refused)


def _read_record(folder: Path) -> Any:
    stacked = stacked_tags(folder / "run.npz")
    return load(folder, DataOptions(sampling_time_s=0.02) if stacked else DataOptions())


def _read_result(folder: Path) -> Any:
    import rdpi_gym as rg

    found = rg.load_result(folder / "result.npz")
    for array in _arrays(found):
        assert array.dtype.kind in "fiub", f"an array of {array.dtype} is no numbers"
    return found


def _arrays(value: Any) -> Iterator[Any]:
    if isinstance(value, np.ndarray):
        yield value
    elif is_dataclass(value):
        for each in fields(value):
            yield from _arrays(getattr(value, each.name))
    elif isinstance(value, Mapping):
        for each in value.values():
            yield from _arrays(each)
    elif isinstance(value, tuple | list):
        for each in value:
            yield from _arrays(each)
    elif isinstance(value, pd.DataFrame):
        for name in value.columns:
            if not isinstance(value[name].dtype, pd.StringDtype) and value[name].dtype != object:
                yield value[name].to_numpy()


def _read_student(folder: Path) -> Any:
    from baselines.learned.found import find_learned

    return find_learned(str(folder))


def _read_tunings(folder: Path) -> Any:
    from baselines.registry import known_controller
    from baselines.tuning import read_tunings

    name = "adaptive-dual-loop"
    return read_tunings(folder / "tuned.json", name, known_controller(name).knobs)


MAKERS: dict[str, Callable[[], AbstractContextManager[Subject]]] = {
    "npz": partial(_plain, npz_documents, _read_record, 1),
    "result": partial(_plain, result_documents, _read_result),
    "plant": partial(_plain, plant_documents, lambda f: PlantModel.load(f / "plant.json")),
    "truth": partial(
        _plain,
        lambda: [json_document("truth.json", tree) for tree in subjects.truths()],
        subjects.read_truth,
    ),
    "signal": partial(
        _plain,
        lambda: [json_document("signal.json", tree) for tree in subjects.signals()],
        subjects.read_signal,
    ),
    "dataset.toml": partial(_plain, toml_documents, subjects.read_folder),
    "matlab-v5": partial(_matlab, v5_documents, 0),
    "matlab-v7.3": partial(_matlab, v73_documents, 5),
    "policy": policies,
    "student": partial(_plain, student_documents, _read_student),
    "checkpoint": checkpoints,
    "hyperparameters": hyperparameters,
    "tuning": partial(_plain, tuning_documents, _read_tunings),
    "diagnosis": partial(_plain, diagnosis_documents, read_diagnosis),
    "journal": partial(_plain, journal_documents, read_journal),
    "session data": partial(_plain, settings_documents, read_settings),
    "tracking rows": tracking,
    "task rows": stages,
    "candidates": candidates,
    "submission": submissions,
    "folders": folders,
    "program": partial(_plain, program_documents, read_program),
}
"""Attacks on each reader of `subjects.STRUCTURED`."""
