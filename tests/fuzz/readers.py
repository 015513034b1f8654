"""Readers of files that are fuzzed, each with valid documents: damaged at random, or attacked place by place."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import pickletools
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache, partial
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

import h5py
import numpy as np
import pandas as pd
from scipy.io import savemat

from rdpi_gym.measurement import DataOptions, Dataset, load
from rdpi_gym.measurement.binary import read_matlab, stacked_tags
from rdpi_gym.measurement.checking import make_record
from rdpi_gym.measurement.matlab import MatlabReader
from rdpi_gym.measurement.record import Record
from rdpi_gym.plant import P5, P10, PlantModel, Sensor, named_plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.model import PLANTS
from rdpi_gym.signals import SIGNALS, Measured, Signal, make_signal, signal_from_dict
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import parse_json, read_json, read_utf8
from rdpi_gym.support.store import RowStore, named_rows
from rdpi_gym.virtual_lab.dataset import Truth
from tests.fuzz import mutations
from tests.fuzz.examples import example
from tests.fuzz.structure import (
    RIGHT,
    Attacks,
    Document,
    Files,
    archive,
    binary_words,
    header_of,
    npy,
    packed_archive,
    zip_words,
)

T = 0.02 * np.arange(40)
COLUMNS = {"t": T, "u": np.sin(3 * T), "y": 8 * np.sin(3 * T - 0.1)}
ROWS = [{"key": f"none/{k}", "rmse_um": 0.1 * k, "verdict": "explained"} for k in range(6)]
DATA = [values.tobytes() for values in COLUMNS.values()]
_ZEROS = 2**28 + 2**27

Write = Callable[[Random, Path], None]
Read = Callable[[Path], Any]


class Case(Random):
    """The number of a case and the seed of all, and the draws that follow from both."""

    def __new__(cls, name: str, seed: int, number: int) -> Case:
        return super().__new__(cls)

    def __init__(self, name: str, seed: int, number: int) -> None:
        super().__init__(f"{name}/{seed}/{number}")
        self.seed_of_all, self.number = seed, number


@dataclass(frozen=True)
class Subject:
    """A reader under attack; anything but a value or an InputError is a fault of it."""

    write: Write  # a damaged file, into an empty folder
    read: Read
    whole: int = 0  # of the first cases, those that are whole files
    count: int = 0  # cases before two attacks are made at a time; 0: they are drawn
    other: Callable[[], int | None] = lambda: None  # number of the process that reads


@dataclass(frozen=True)
class Reader:
    """Valid documents, the last of which are refused as they are, and what reads their files."""

    documents: Sequence[Document]
    read: Read
    refused: int = 0
    other: Callable[[], int | None] = lambda: None


READERS: dict[str, Callable[[ExitStack], Reader | Subject]] = {}
DAMAGED: dict[str, int] = {}
"""How many of 20,000 files that are damaged at random each reader has."""
STRUCTURED: dict[str, int] = {}
"""How many of 20,000 attacks on the structure of documents each reader meets."""
GROUPS: dict[str, list[str]] = {}
"""Names of both kinds by the process that runs them."""


def reader(group: str, name: str, damaged: int = 0, structured: int = 0) -> Callable[[Any], Any]:
    """Register a maker of a reader, with its numbers of cases."""

    def register(make: Callable[[ExitStack], Reader | Subject]) -> Any:
        READERS[name] = make
        for kind, shares, count in (("", DAMAGED, damaged), ("/structure", STRUCTURED, structured)):
            if count:
                shares[name + kind] = count
                GROUPS.setdefault(group, []).append(name + kind)
        return make

    return register


@contextmanager
def subject(name: str) -> Iterator[Subject]:
    """Make a subject by its name, with what it needs open while it is used."""
    with ExitStack() as stack:
        own, _, structured = name.partition("/")
        made = READERS[own](stack)
        if isinstance(made, Subject):
            yield made
        else:
            yield _attacked(made) if structured else _damaged(made)


def _attacked(made: Reader) -> Subject:
    attacks, documents = Attacks(made.documents), len(made.documents)

    def write(rng: Random, folder: Path) -> None:
        assert isinstance(rng, Case)
        put(folder, attacks.case(rng.seed_of_all, rng.number))

    whole, count = documents - made.refused, documents + len(attacks)
    return Subject(write, made.read, whole, count, made.other)


def _damaged(made: Reader) -> Subject:
    def write(rng: Random, folder: Path) -> None:
        mutations.special(rng, put(folder, mutations.damaged(rng, rng.choice(made.documents))))

    return Subject(write, made.read, other=made.other)


def put(folder: Path, files: Files) -> list[Path]:
    """Write files into a folder."""
    for name, content in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    return [folder / name for name in files]


def _json(value: Any) -> bytes:
    return json.dumps(value).encode()


def json_document(name: str, tree: Any) -> Document:
    return Document(tree, _json, lambda _, raw: {name: raw}, is_text=True)


def file_document(name: str, raw: bytes, is_text: bool = False, **words: Any) -> Document:
    return Document(
        None, lambda _: raw, lambda _, changed: {name: changed}, is_text=is_text, **words
    )


# records


def csv_text(delimiter: str = ",", decimal: str = ".", header: str = "t,u,y") -> str:
    rows = [header.replace(",", delimiter)] if header else []
    for values in zip(*COLUMNS.values(), strict=True):
        rows.append(delimiter.join(f"{v:.5f}".replace(".", decimal) for v in values))
    return "\n".join(rows) + "\n"


TEXTS = (
    csv_text(),
    csv_text(";", ","),
    csv_text("\t"),
    csv_text(" ", header=""),
    "% measured at noon\n# t u y\n" + csv_text(),
    csv_text(header="t,u,y,period,temperature").replace("\n", ",1,20.5\n").replace("e,1,20.5", "e"),
)
TOML = """title = "steps at noon"
skip_s = 0.04
[columns]
t = "t"
u = 1
[units]
y = "um"
[records.run]
role = "train"
mask_s = [[0.3, 0.36], [0.5, 0.52]]
note = "quiet"
[records.other]
role = "validation"
skip_s = 0.1
"""


def read_folder(folder: Path) -> Dataset:
    """Read by names, or by positions where there are none."""
    try:
        return load(folder)
    except InputError as error:
        if "a number where a header was expected" not in str(error):
            raise
    return load(folder, DataOptions(columns={"t": 0, "u": 1, "y": 2}))


@reader("records", "csv", damaged=3_800)
def csv(stack: ExitStack) -> Reader:
    endings = ("csv", "txt", "dat", "tsv")
    return Reader(
        [file_document(f"run.{end}", text.encode(), True) for text in TEXTS for end in endings],
        read_folder,
    )


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
        kept = {n: content for n, content in members.items() if n in headers}
        return archive({f"{n}.npy": npy(headers[n], c) for n, c in kept.items()}, method)

    return Document(tree, build, lambda _, raw: {name: raw}, zip_words)


@reader("records", "npz", damaged=2_500, structured=2_600)
def npz(stack: ExitStack) -> Reader:
    stack_of = np.arange(240.0).reshape(40, 3, 2)
    narrow = {**COLUMNS, "u": np.arange(40, dtype=np.int8)}
    beside = {**COLUMNS, "notes": np.array("junk"), "../up": T, "\x1b": T.astype("U3")}
    stored, packed = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED
    stacks = dict.fromkeys(("u_low", "y_low", "u_test", "y_test"), stack_of)

    def read(folder: Path) -> Any:
        is_stacked = stacked_tags(folder / "run.npz")
        return load(folder, DataOptions(sampling_time_s=0.02) if is_stacked else DataOptions())

    return Reader(
        [
            archived("run.npz", COLUMNS, stored),
            archived("run.npz", narrow, packed),
            archived("run.npz", stacks, packed),
            archived("run.npz", {"t": T, "u": stack_of[:, :, 0], "y": T}, stored),
            archived("run.npz", beside, packed),
            archived("run.npz", COLUMNS, zipfile.ZIP_BZIP2),
            archived("run.npz", COLUMNS, zipfile.ZIP_LZMA),
        ],
        read,
        refused=2,
    )


@reader("records", "npz of zeros", structured=400)
def npz_of_zeros(stack: ExitStack) -> Reader:
    """An archive whose voltage goes on in zeros that are 1000 times smaller on the disk."""
    tail = zlib.compressobj(wbits=-15)
    zeros = b"".join(tail.compress(bytes(2**20)) for _ in range(_ZEROS // 2**20)) + tail.flush()

    def build(tree: Any) -> bytes:
        members = {}
        for name, values in COLUMNS.items():
            head = npy(tree[name], values.tobytes()) if name in tree else b""
            packer, more = zlib.compressobj(wbits=-15), zeros if name == "u" else b""
            packed = packer.compress(head) + packer.flush(
                zlib.Z_FULL_FLUSH if more else zlib.Z_FINISH
            )
            members[f"{name}.npy"] = (packed + more, len(head) + (_ZEROS if more else 0))
        return packed_archive(members)

    tree = {name: header_of(values) for name, values in COLUMNS.items()}
    document = Document(tree, build, lambda _, raw: {"run.npz": raw}, zip_words)
    return Reader([document], lambda folder: load(folder), refused=1)


def toml_documents() -> list[Document]:
    import tomllib

    more = {
        "quantities": {"output": {"name": "force", "symbol": "F", "unit": "kN"}},
        "records": {"run": {"ts_s": 0.02}},
        "columns": {"inputs": ["u"]},
    }

    def files(_: Any, raw: bytes) -> dict[str, bytes]:
        data = TEXTS[0].encode()
        return {"dataset.toml": raw, "run.csv": data, "other.csv": data}

    written = Document(None, lambda _: TOML.encode(), files, is_text=True)
    trees = (tomllib.loads(TOML), more)
    return [
        written,
        *(Document(t, lambda t: _toml(t).encode(), files, is_text=True) for t in trees),
    ]


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


@reader("records", "dataset.toml", damaged=2_500, structured=1_000)
def toml(stack: ExitStack) -> Reader:
    return Reader(toml_documents(), read_folder)


def _matlab(stack: ExitStack, documents: list[Document], refused: int = 0) -> Reader:
    own = stack.enter_context(MatlabReader())

    def read(folder: Path) -> Record:
        return make_record(read_matlab(folder / "run.mat", {}, reader=own), "run", units={})

    return Reader(
        documents, read, refused, lambda: None if own._process is None else own._process.pid
    )


def v5_files() -> list[bytes]:
    inside = {"test": COLUMNS, "notes": "abc", "cells": np.array([{}], dtype=object)}
    narrow = {**COLUMNS, "u": np.arange(40, dtype=np.int16), "y": COLUMNS["y"].astype(np.float32)}
    found = []
    for variables, options in (
        *((COLUMNS, {"do_compression": packed}) for packed in (False, True)),
        *((inside, {"do_compression": packed}) for packed in (False, True)),
        (narrow, {}),
        (COLUMNS, {"format": "4"}),
    ):
        stream = io.BytesIO()
        savemat(stream, variables, **options)
        written = stream.getvalue()
        # the text at the head of a file holds the time of day; v4 has none
        found.append(written if "format" in options else b"MATLAB".ljust(116) + written[116:])
    return found


@reader("matlab", "matlab-v5", damaged=1_500, structured=2_200)
def matlab_v5(stack: ExitStack) -> Reader:
    """MATLAB files up to v7; the integers of a compressed one are attacked inside it as well."""

    def plain(raw: bytes) -> Document:
        first = 0 if raw[:4] != b"MATL" else 116
        return file_document("run.mat", raw, words=partial(binary_words, data=DATA, first=first))

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

    files = v5_files()
    return _matlab(stack, [*map(plain, files), *(unpacked(raw) for raw in (files[1], files[3]))])


def v73_files() -> list[bytes]:
    """MATLAB files v7.3, the last five refused as they are."""

    def grouped(file: Any) -> None:
        group = file.create_group("test")
        for name in COLUMNS:
            file.move(name, f"test/{name}")
        group["again"] = file["/"]

    def other(name: str, make: Callable[[Any], None]) -> Callable[[Any], None]:
        def change(file: Any) -> None:
            del file[name]
            make(file)

        return change

    def written(change: Callable[[Any], None], **options: Any) -> bytes:
        stream = io.BytesIO()
        with h5py.File(stream, "w", **options) as file:
            for name, values in COLUMNS.items():
                file[name] = values
            change(file)
        return stream.getvalue()

    far, u = [("/etc/passwd", 0, h5py.h5f.UNLIMITED)], COLUMNS["u"]
    return [
        *(written(c, **o) for o in ({}, {"libver": "latest"}) for c in (lambda file: None, grouped)),
        *map(
            written,
            (
                other("u", lambda f: f.create_dataset("u", data=u, chunks=(8,), compression=9)),
                other("y", lambda f: f.create_dataset("y", (40,), "i1", chunks=(4,), maxshape=(None,))),
                other("y", lambda f: f.create_dataset("y", (2**32,), "f8", chunks=(2**16,))),
                other("y", lambda f: f.create_dataset("y", (40,), "f8", external=far)),
                other("y", lambda f: f.__setitem__("y", h5py.SoftLink("/u"))),
                other("y", lambda f: f.__setitem__("y", h5py.ExternalLink("other.h5", "/y"))),
                other("y", lambda f: f.__setitem__("y", ["a", "b"])),
            ),
        ),
    ]  # fmt: skip


@reader("matlab", "matlab-v7.3", damaged=1_500, structured=2_600)
def matlab_v73(stack: ExitStack) -> Reader:
    lengths = (8, 40, 320, 64, 256, 2**16, 2**32)  # of chunks, of the data, of their descriptions
    words = partial(binary_words, data=DATA, sizes=lengths)
    return _matlab(stack, [file_document("run.mat", raw, words=words) for raw in v73_files()], 5)


# models, signals, results


@reader("models", "plant", damaged=2_000, structured=4_600)
def plant(stack: ExitStack) -> Reader:
    full = PlantModel(
        P10.hysteresis, "full", (-80.0, 80.0), (0.0, 40.0),
        effects=tuple(kind() for kind in CATALOGUE.values()), sensor=Sensor(0.01, 0.003),
        note="all effects", identification={"standard_errors": {"a0": 0.1}},
    )  # fmt: skip
    models = [full, *map(named_plant, (*PLANTS, "P5-bench"))]
    models += [
        PlantModel(P5.hysteresis, name, (-80.0, 80.0), (0.0, 40.0), effects=(kind(),))
        for name, kind in CATALOGUE.items()
    ]
    documents = [json_document("plant.json", model.to_dict()) for model in models]
    return Reader(documents, lambda folder: PlantModel.load(folder / "plant.json"))


@reader("models", "truth", damaged=500, structured=300)
def truth(stack: ExitStack) -> Reader:
    from rdpi_gym.plant.effects.base import effect_from_dict

    hidden = (CATALOGUE["creep"](), CATALOGUE["resonance"]())

    def read(folder: Path) -> Truth:
        document = read_json(folder / "truth.json", "rdpi-truth", 1)
        plant = PlantModel.from_dict(document.get("plant"), "truth.json")  # type: ignore[arg-type]
        found = document.get("hidden")
        effects = found if isinstance(found, list) else []
        them = tuple(effect_from_dict(CATALOGUE, each, "truth.json") for each in effects)
        return Truth(plant, them, noise_um=0.0, seed=0)

    tree = Truth(P10, hidden, noise_um=0.01, seed=3).to_dict()
    return Reader([json_document("truth.json", tree)], read)


@reader("models", "signal", damaged=1_500, structured=3_300)
def signal(stack: ExitStack) -> Reader:
    parts = ("sum", "sequence", "measured")
    plain = [kind() for name, kind in SIGNALS.items() if name not in parts]
    record = Measured(times_s=[0.0, 1.0, 2.0], values_um=[0.0, 3.0, 1.0])
    one = make_signal("sequence", parts=[*plain[:2], record], durations_s=[1.0] * 3)
    both = make_signal("sum", parts=[plain[1], one])

    def read(folder: Path) -> Signal:
        path = folder / "signal.json"
        found = signal_from_dict(parse_json(read_utf8(path, 2**20), str(path)))
        found.to_dict()
        return found

    trees = [each.to_dict() for each in (*plain, record, both)]
    return Reader([json_document("signal.json", tree) for tree in trees], read)


@reader("models", "result", damaged=1_000, structured=700)
def result(stack: ExitStack) -> Reader:
    """Saved results of every kind, one of each made of its annotations."""
    import rdpi_gym as rg
    from rdpi_gym.face.results import _kinds

    found = []
    with tempfile.TemporaryDirectory() as name:
        for kind in _kinds():
            path = example(kind).save(Path(name) / "result.npz")
            with np.load(path) as file:
                arrays = {each: file[each] for each in file.files if each != "document"}
                said = json.loads(file["document"].tobytes())
            found.append(archived("result.npz", arrays, zipfile.ZIP_STORED, said))

    def read(folder: Path) -> Any:
        found = rg.load_result(folder / "result.npz")
        for array in _arrays(found):
            assert array.dtype.kind in "fiub", f"an array of {array.dtype} is no numbers"
        return found

    return Reader(found, read)


def _arrays(value: Any) -> Iterator[Any]:
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, pd.DataFrame):
        for name in value.columns:
            if not isinstance(value[name].dtype, pd.StringDtype) and value[name].dtype != object:
                yield value[name].to_numpy()
    else:
        inner: Any = value if isinstance(value, tuple | list) else ()
        if is_dataclass(value):
            inner = [getattr(value, each.name) for each in fields(value)]
        for each in value.values() if isinstance(value, Mapping) else inner:
            yield from _arrays(each)


@reader("models", "diagnosis", structured=250)
def diagnosis(stack: ExitStack) -> Reader:
    from rdpi_gym.diagnosis.results import SearchResult as Stored
    from rdpi_gym.face.search import SearchResult

    found = example(SearchResult)
    kinds = [replace(found, kind=kind) for kind in ("diagnosis", "discovery", "addition")]
    trees = [json.loads(_json(each.to_dict())) for each in kinds]
    documents = [json_document("diagnosis.json", tree) for tree in trees]
    return Reader(documents, lambda folder: Stored.load(folder / "diagnosis.json"))


# rows of results, sums of which are right: who wrote them could write anything


@reader("runs", "rows", damaged=1_000)
def rows(stack: ExitStack) -> Reader:
    """Rows as they are, and rows with nested lists."""

    def stored(them: list[dict[str, Any]]) -> Document:
        with tempfile.TemporaryDirectory() as name:
            named_rows(Path(name) / "rows.jsonl").append(them)
            return file_document("rows.jsonl", (Path(name) / "rows.jsonl").read_bytes(), True)

    def read(folder: Path) -> dict[str, Any]:
        found = named_rows(folder / "rows.jsonl").rows
        for row in found.values():
            is_ours = row in ROWS or isinstance(row["rmse_um"], list)
            assert is_ours, f"a row was changed unnoticed: {row}"
        return found

    nested = [[{**ROWS[0], "rmse_um": mutations.nested(deep)}] for deep in (3, 400, 900)]
    return Reader([stored(ROWS)] * 9 + [stored(each) for each in nested], read)


def rows_document(name: str, store: RowStore[Any]) -> Document:
    def build(tree: Any) -> bytes:
        told = tree if isinstance(tree, list) else [tree]
        return store._head + b"".join(store._line(row) for row in told if isinstance(row, dict))

    return Document(list(store.rows.values()), build, lambda _, raw: {name: raw}, is_text=True)


@reader("runs", "tracking rows", structured=30)
def tracking_rows(stack: ExitStack) -> Reader:
    """Rows of `rdpi bench`, read by the run that goes on from them."""
    from benchmarks.rows import TRACKING
    from benchmarks.tracking.evaluation import evaluate
    from benchmarks.tracking.run import benchmark
    from benchmarks.tracking.selection import select

    chosen = select(["none", "classical-static"], ["P5"], ["sine"], [1e-2], [0])
    with tempfile.TemporaryDirectory() as name:
        done = benchmark(chosen, Path(name), jobs=1).rows
        document = rows_document("rows.jsonl", TRACKING.open(Path(name)))

    def read(folder: Path) -> Any:
        with patch("benchmarks.rows.run_cases", lambda *_: [done]):
            return evaluate(chosen, benchmark(chosen, folder, jobs=1)).order

    return Reader([document], read)


@reader("runs", "task rows", structured=30)
def task_rows(stack: ExitStack) -> Reader:
    """Rows of the tasks, read by the run that goes on from them."""
    from benchmarks.rows import TASKS
    from benchmarks.stages.ranking import TaskScores
    from benchmarks.stages.run import run_tasks

    with tempfile.TemporaryDirectory() as name:
        done = run_tasks(["none"], ["Bare"], 1, Path(name), jobs=1).rows
        document = rows_document("task-rows.jsonl", TASKS.open(Path(name)))

    def read(folder: Path) -> Any:
        with patch("benchmarks.rows.run_cases", lambda *_: [done]):
            found = run_tasks(["none"], ["Bare"], 1, folder, jobs=1)
        return repr(TaskScores(tuple(found.rows), "public seed 2026", found.computed, found.notes))

    return Reader([document], read)


@reader("runs", "task-rows.csv.gz", damaged=100)
def packed_rows(stack: ExitStack) -> Reader:
    """Rows of a table, which new rows are compared with; damaged as they lie and before they are packed."""
    from benchmarks.stages.row_table import FILE, checked_against, write_rows

    figures = {"rmse_percent": 0.1, "worst_percent": 0.2, "command_variation_V_s": 3.0}
    rows = [{"task": "Bare", "controller": "none", "draws": "public seed 2026", "plant": k,
             "rmse_noise": 1.5, "failure": "", **figures} for k in range(6)]  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        packed = write_rows(Path(name), rows).read_bytes()
    plain = Document(
        None,
        lambda _: gzip.decompress(packed),
        lambda _, raw: {FILE: gzip.compress(raw, mtime=0)},
        is_text=True,
    )
    return Reader([file_document(FILE, packed), plain], lambda at: checked_against(rows, at / FILE))


@reader("runs", "tasks.csv", damaged=100)
def statements(stack: ExitStack) -> Reader:
    """Statements of a table's controllers of themselves, which new rows are put among."""
    from benchmarks.stages.row_table import FILE, STATEMENTS, put_among, write_rows

    row = {"task": "Bare", "controller": "none", "draws": "public seed 2026", "plant": 0, "failure": "",
           "rmse_percent": 0.1, "worst_percent": 0.2, "command_variation_V_s": 3.0}  # fmt: skip
    said = b"task,controller,tuning_samples,sees,certificate\nBare,none,0,preview,stable\n"
    with tempfile.TemporaryDirectory() as name:
        packed = write_rows(Path(name), [row]).read_bytes()
    document = Document(
        None,
        lambda _: said,
        lambda _, raw: {STATEMENTS: raw, FILE: packed},
        is_text=True,
    )
    new = [{**row, "controller": "pi"}]
    return Reader([document], lambda at: put_among(new, at))


@reader("runs", "candidates", structured=100)
def candidates(stack: ExitStack) -> Reader:
    """Visited sets of a search."""
    from rdpi_gym.diagnosis.beam.checkpoint import FORMAT, Checkpoint
    from tests.faults.sets import evidence, made, read_stages

    here = evidence()
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "candidates.jsonl"
        checkpoint = Checkpoint(path, here)
        for stage, one in made().items():
            checkpoint.stage(stage, {}, lambda one=one: [one])  # type: ignore[misc]
        document = rows_document("candidates.jsonl", named_rows(path, FORMAT))
    return Reader([document], lambda folder: read_stages(folder / "candidates.jsonl", here))


@cache
def _submitted() -> Files:
    """A submission of a controller of one's own."""
    import sys

    from benchmarks.stages.submission import submit

    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "fuzzed_controller.py").write_text(
            "from baselines.lookup import make_controller\n"
            "def make(belief, layout):\n    return make_controller('none', belief, layout)\n"
        )
        entry = Path(name) / "entry"
        with patch.object(sys, "path", [*sys.path, name]):
            submit("fuzzed_controller:make", ["Bare"], 1, entry, jobs=1)
        return {path.name: path.read_bytes() for path in entry.iterdir() if path.is_file()}


@reader("runs", "submission", structured=80)
def submission(stack: ExitStack) -> Reader:
    """Description of a submission, beside its code and its rows."""
    from benchmarks.stages.submission import FILE, read_submission

    files = _submitted()
    document = json_document(FILE, json.loads(files[FILE]))
    return Reader([replace(document, files=lambda _, raw: {**files, FILE: raw})], read_submission)


@reader("runs", "program", structured=30)
def program(stack: ExitStack) -> Reader:
    """Description of exported code."""
    from rdpi_gym.firmware.making import package_again, package_of
    from rdpi_gym.firmware.writing.package import FORMAT, VERSION

    few = PlantModel(P5.hysteresis, "few", (-80.0, 80.0), (0.0, 40.0))
    recipes = [package_of(few, 1e-4, name).recipe for name in (None, "none")]

    def read(folder: Path) -> Any:
        path = folder / "program.json"
        return package_again(read_json(path, FORMAT, VERSION), str(path))

    head = {"format": FORMAT, "version": VERSION}
    return Reader([json_document("program.json", {**head, **each}) for each in recipes], read)


@reader("runs", "tuning", structured=200)
def tuning(stack: ExitStack) -> Reader:
    from baselines.registry import known_controller
    from baselines.tuning import TUNED, read_tunings

    name = "adaptive-dual-loop"
    tree = json.loads((TUNED / f"{name}.json").read_text())
    knobs = known_controller(name).knobs
    return Reader(
        [json_document("tuned.json", tree)], lambda f: read_tunings(f / "tuned.json", name, knobs)
    )


# the laboratory


@reader("runs", "journal", structured=250)
def journal(stack: ExitStack) -> Reader:
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
    final = {"train_rmse": 0.4, "validation_rmse": 0.5, "by_record": {}}
    left |= {"settled": plant, "final": final}
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
        return {"journal.jsonl": raw, "data/run.csv": TEXTS[0].encode()}

    # each event alone, after what it needs: of a long list the ends alone are attacked
    before = {4: [3], 6: [5], 7: [5]}
    orders = [[*([1, 2] if k >= 2 else []), *before.get(k, []), k] for k in range(len(events))]
    return Reader(
        [Document([events[j] for j in order], build, files) for order in orders], read_journal
    )


def read_journal(folder: Path) -> Any:
    from rdpi_gym.laboratory.session import Session
    from rdpi_gym.laboratory.session_json import state_of

    session = Session(folder)
    return json.dumps(state_of(session, None, None, {}), allow_nan=False)


@reader("runs", "session data", structured=80)
def session_data(stack: ExitStack) -> Reader:
    """Settings of the data of a session, beside a file that is not read with it."""

    def moved(document: Document) -> Document:
        def files(tree: Any, raw: bytes) -> Files:
            data = {f"data/{name}": content for name, content in document.files(tree, raw).items()}
            return {**data, "journal.jsonl": b'{"do": "read"}\n'}

        return replace(document, files=files)

    def read(folder: Path) -> Any:
        """Tell the state, change a setting, take one file and all into another session."""
        from rdpi_gym.laboratory.data_import import copy_in, write_settings

        def tried(action: Callable[[], Any]) -> str:
            try:
                return str(action())
            except InputError as error:
                return str(error)

        data = folder / "data"
        told = [
            tried(lambda: read_journal(folder)),
            tried(lambda: copy_in(data / "run.csv", folder / "other")),
            tried(lambda: copy_in(data, folder / "all")),
            tried(lambda: write_settings(data, {"records": {"run": {"role": "train"}}}, ["run"])),
        ]
        long = [line for line in told if "\n" in line]
        assert not long, long
        return told

    return Reader([moved(each) for each in toml_documents()[1:]], read)


# policies and what trains them


def policy_files() -> tuple[dict[str, Any], bytes]:
    """Make a policy: its description, and its weights."""
    import torch

    from baselines.learned.policy import Network, Policy
    from rdpi_gym.envs import ObservationLayout

    torch.set_num_threads(1)
    torch.manual_seed(0)
    layout = ObservationLayout.for_plant(P10, 1e-4, preview=2, action="correction")
    actor = Network((layout.size + 6, 8, 1), "Tanh", "Hardtanh").build()
    policy = Policy(layout, 2, 100.0, 0.02, actor, "classical-static", {"seed": 1})
    with tempfile.TemporaryDirectory() as name:
        saved = policy.save(Path(name) / "policy")
        described = json.loads((saved / "policy.json").read_text())
        weights = (saved / "weights.pt").read_bytes()
    return described, weights


def read_policy(folder: Path) -> Any:
    from baselines.learned.policy import Policy
    from baselines.lookup import make_controller
    from rdpi_gym.envs import ObservationLayout

    found = Policy.load(folder)
    plain = ObservationLayout.for_plant(P10, found.layout.ts_s, preview=4)
    return make_controller(f"learned:{folder}", P10, plain)


def _hashed(described: Mapping[str, Any], name: str) -> Callable[[Any, bytes], Files]:
    """Files of a description and weights, of which the hash is right unless it is attacked."""

    def files(tree: Any, raw: bytes) -> Files:
        said = tree.get("said")
        if isinstance(said, dict) and said.get("weights_sha256") == described["weights_sha256"]:
            said = {**said, "weights_sha256": hashlib.sha256(raw).hexdigest()}
        return {"policy.json": _json(said), name: raw}

    return files


@reader("learned", "policy", damaged=1_500, structured=400)
def policy(stack: ExitStack) -> Reader:
    """Policies: description, archive and pickle."""
    described, weights = policy_files()
    with zipfile.ZipFile(io.BytesIO(weights)) as file:
        members = {name: file.read(name) for name in file.namelist()}
    pickled = next(name for name in members if name.endswith("data.pkl"))
    files, tree = _hashed(described, "weights.pt"), {"said": described}
    whole = Document(tree, lambda _: archive(members), files, zip_words)
    inside = Document(
        tree,
        lambda _: members[pickled],
        lambda tree, raw: files(tree, archive({**members, pickled: raw})),
        _pickled_integers,
    )
    return Reader([whole, inside], read_policy)


def _pickled_integers(content: bytes) -> list[tuple[int, int]]:
    sizes = {"BININT": 4, "BININT1": 1, "BININT2": 2, "BINPUT": 1, "BINGET": 1, "BINUNICODE": 4}
    sizes |= {"LONG_BINPUT": 4, "LONG_BINGET": 4, "PROTO": 1, "SHORT_BINUNICODE": 1}
    return [
        (at + 1, sizes[code.name])
        for code, _, at in pickletools.genops(content)
        if code.name in sizes and at is not None
    ]


def _with_arrays(
    arrays: dict[str, Any], said: Any, files: Callable[[Any, bytes], Files]
) -> Document:
    """A description beside an archive of arrays, both attacked."""
    inner = archived("", arrays, zipfile.ZIP_STORED)
    return replace(inner, tree={**inner.tree, "said": said}, files=files)


@reader("learned", "student", structured=150)
def student(stack: ExitStack) -> Reader:
    """A shipped student: description and arrays."""
    from baselines.learned.controller import find_learned
    from baselines.learned.policy import policy_folder

    folder = policy_folder("imitation-creep")
    said = json.loads((folder / "policy.json").read_text())
    name = next(path.name for path in folder.iterdir() if path.suffix == ".npz")
    with np.load(folder / name) as file:
        arrays = {each: file[each] for each in file.files}
    return Reader([_with_arrays(arrays, said, _hashed(said, name))], lambda f: find_learned(str(f)))


@reader("learned", "hyperparameters", damaged=500, structured=300)
def hyperparameters(stack: ExitStack) -> Reader:
    """Hyper-parameters; JSON is YAML."""
    import yaml
    from stable_baselines3 import PPO, SAC

    from baselines.learned import settings

    kinds = {"ppo.yml": PPO, "sac.yml": SAC}
    texts = {name: (settings.SHIPPED / name).read_text() for name in kinds}

    def read(folder: Path) -> Any:
        (path,) = folder.iterdir()
        return settings.read_settings(path, kinds[path.name])

    written = [file_document(name, text.encode(), True) for name, text in texts.items()]
    trees = [json_document(name, yaml.safe_load(text)) for name, text in texts.items()]
    return Reader([*written, *trees], read)


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


@reader("learned", "checkpoint", structured=300)
def checkpoint(stack: ExitStack) -> Reader:
    """Checkpoint of an interrupted training: description, archive of tensors, replay buffer."""
    from baselines.learned.checkpoint import _seal, load_checkpoint, save_checkpoint

    with tempfile.TemporaryDirectory() as name:
        save_checkpoint(Path(name), Learner(), {"rows": [], "timesteps": 100})
        (folder,) = Path(name).iterdir()
        said = json.loads((folder / "checkpoint.json").read_text())
        model = (folder / "model.pt").read_bytes()

    def files(tree: Any, raw: bytes) -> Files:
        parts = {"model.pt": model, "replay.npz": raw}
        told = tree.get("said")
        if isinstance(told, dict):
            if told.get("files") == said["files"]:
                sums = {n: hashlib.sha256(content).hexdigest() for n, content in parts.items()}
                told = {**told, "files": sums}
            if told.get("sha256") == said["sha256"]:
                told = {**told, "sha256": _seal(told)}
        them = {"checkpoint.json": _json(told), **parts}
        return {f"{folder.name}/{name}": content for name, content in them.items()}

    document = _with_arrays(Learner().arrays(), said, files)
    return Reader([document], lambda folder: load_checkpoint(folder, Learner()))


@reader("runs", "folders", structured=100)
def folders(stack: ExitStack) -> Subject:
    from tests.fuzz.folders import attacked_folders

    return attacked_folders(stack)
