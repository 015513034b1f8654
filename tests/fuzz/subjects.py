"""What is fuzzed: every reader of a file, with valid files of it and ways to damage them."""

from __future__ import annotations

import hashlib
import io
import json
import os
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
from scipy.io import savemat

from rdpi_gym.measurement import DataOptions, Dataset, load
from rdpi_gym.measurement.binary import read_matlab
from rdpi_gym.measurement.checking import make_record
from rdpi_gym.measurement.matlab import MatlabReader
from rdpi_gym.measurement.record import Record
from rdpi_gym.plant import P10, PlantModel, Sensor, named_plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.signals import SIGNALS, Measured, Signal, make_signal, signal_from_dict
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import parse_json, read_json, read_utf8
from rdpi_gym.support.store import named_rows
from rdpi_gym.virtual_lab.truth import Truth
from tests.fuzz import mutations

T = 0.02 * np.arange(40)
COLUMNS = {"t": T, "u": np.sin(3 * T), "y": 8 * np.sin(3 * T - 0.1)}
ROWS = [{"key": f"none/{k}", "rmse_um": 0.1 * k, "verdict": "explained"} for k in range(6)]

Write = Callable[[Random, Path], None]
Read = Callable[[Path], Any]


class Case(Random):
    """The number of a case and the seed of all, and what is drawn of both."""

    def __new__(cls, name: str, seed: int, number: int) -> Case:
        return super().__new__(cls)

    def __init__(self, name: str, seed: int, number: int) -> None:
        super().__init__(f"{name}/{seed}/{number}")
        self.seed_of_all, self.number = seed, number


@dataclass(frozen=True)
class Subject:
    """A reader.

    Parameters
    ----------
    write
        Writes a damaged file into an empty folder.
    read
        Reads it; anything but a value or an InputError is a fault of the reader.
    whole
        How many of the first cases are whole files.
    count
        How many cases there are before two attacks are made at a time; 0: they are drawn.
    other
        Number of the process that reads, where it is another.
    """

    write: Write
    read: Read
    whole: int = 0
    count: int = 0
    other: Callable[[], int | None] = lambda: None


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


def write_csv(rng: Random, folder: Path) -> None:
    path = folder / rng.choice(("run.csv", "run.txt", "run.dat", "run.tsv"))
    path.write_bytes(mutations.text(rng, rng.choice(TEXTS), rng.choice((1, 3))))
    special(rng, path)


def write_toml(rng: Random, folder: Path) -> None:
    for name in ("run", "other"):
        (folder / f"{name}.csv").write_text(TEXTS[0])
    (folder / "dataset.toml").write_bytes(mutations.text(rng, TOML))
    special(rng, folder / "dataset.toml")


def special(rng: Random, path: Path) -> None:
    """Put something in a file's place, at times, that is no file."""
    if rng.random() > 0.01:
        return
    path.unlink()
    what = rng.randrange(5)
    if what == 0:
        os.mkfifo(path)
    elif what == 1:
        path.mkdir()
    else:
        path.symlink_to(("/dev/zero", "/dev/tty", "nowhere")[what - 2])


def read_folder(folder: Path) -> Dataset:
    """Read by names, or by positions where there are none."""
    try:
        return load(folder)
    except InputError as error:
        if "a number where a header was expected" not in str(error):
            raise
    return load(folder, DataOptions(columns={"t": 0, "u": 1, "y": 2}))


def add(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    """Add a member without the time of day, so that a case is always the same file."""
    archive.writestr(zipfile.ZipInfo(name), content, compress_type=archive.compression)


def npy(rng: Random, array: Any) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    content = stream.getvalue()
    if rng.random() < 0.75:
        return content
    what = rng.randrange(4)
    if what == 0:
        return mutations.binary(rng, content)
    swaps = (
        (
            b"(40,)",
            rng.choice((b"(41,)", b"(-40,)", b"(400000000,)", b"(2, 20)", b"()", b"(10**9,)")),
        ),
        (
            b"'<f8'",
            rng.choice((b"'|O'", b"'<c16'", b"'<U9'", b"'>f4'", b"'|V8'", b"[('a', '<f8')]")),
        ),
        (b"False", rng.choice((b"True", b"((((((", b"-" * 200 + b"1", b"None"))),
    )
    return content.replace(*swaps[what - 1])


def write_npz(rng: Random, folder: Path) -> None:
    methods = (zipfile.ZIP_DEFLATED,) * 30 + (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", rng.choice(methods)) as archive:
        for name, values in COLUMNS.items():
            kind = rng.choice(
                (np.float64,) * 8 + (np.float32, np.int64, np.complex128, object, "U3")
            )
            add(archive, f"{name}.npy", npy(rng, values.astype(kind)))
        add(archive, rng.choice(("notes", "extra.npy", "../up.npy", "\x1b.npy")), b"junk")
    raw = stream.getvalue()
    path = folder / "run.npz"
    path.write_bytes(mutations.binary(rng, raw, 2) if rng.random() < 0.5 else raw)
    special(rng, path)


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


def v73(change: Callable[[Any], None], **options: Any) -> bytes:
    stream = io.BytesIO()
    with h5py.File(stream, "w", **options) as file:
        for name, values in COLUMNS.items():
            file[name] = values
        change(file)
    return stream.getvalue()


def v73_files() -> list[bytes]:
    def replaced(name: str, make: Callable[[Any], None]) -> Callable[[Any], None]:
        def change(file: Any) -> None:
            del file[name]
            make(file)

        return change

    def grouped(file: Any) -> None:
        group = file.create_group("test")
        for name in COLUMNS:
            file.move(name, f"test/{name}")
        group["again"] = file["/"]

    def packed(name: str) -> Callable[[Any], None]:
        return lambda file: file.create_dataset(
            name, data=COLUMNS[name], chunks=(8,), compression=9
        )

    far = [("/etc/passwd", 0, h5py.h5f.UNLIMITED)]
    changes: list[Callable[[Any], None]] = [
        lambda file: None,
        grouped,
        replaced("u", packed("u")),
        replaced("y", lambda f: f.create_dataset("y", (2**32,), "f8", chunks=(2**16,))),
        replaced("y", lambda f: f.create_dataset("y", (40,), "f8", external=far)),
        replaced("y", lambda f: f.__setitem__("y", h5py.SoftLink("/u"))),
        replaced("y", lambda f: f.__setitem__("y", h5py.ExternalLink("other.h5", "/y"))),
        replaced("y", lambda f: f.__setitem__("y", ["a", "b"])),
        replaced("y", lambda f: f.create_dataset("y", (40,), "i1", chunks=(4,), maxshape=(None,))),
    ]
    return [v73(c) for c in changes] + [
        v73(changes[0], libver="latest"),
        v73(grouped, libver="latest"),
    ]


def damaged(files: list[bytes], name: str) -> Write:
    def write(rng: Random, folder: Path) -> None:
        raw = rng.choice(files)
        (folder / name).write_bytes(mutations.binary(rng, raw) if rng.random() < 0.97 else raw)
        special(rng, folder / name)

    return write


def read_mat(reader: MatlabReader) -> Read:
    def read(folder: Path) -> Record:
        return make_record(read_matlab(folder / "run.mat", {}, reader=reader), "run", units={})

    return read


def plants() -> list[dict[str, Any]]:
    effects = tuple(kind() for kind in CATALOGUE.values())
    full = PlantModel(
        P10.hysteresis, "full", (-80.0, 80.0), (0.0, 40.0), effects=effects,
        sensor=Sensor(0.01, 0.003), note="all effects", identification={"standard_errors": {"a0": 0.1}},
    )  # fmt: skip
    return [full.to_dict(), named_plant("picma").to_dict(), named_plant("P5-bench").to_dict()]


def truths() -> list[dict[str, Any]]:
    hidden = (CATALOGUE["creep"](), CATALOGUE["resonance"]())
    return [Truth(P10, hidden, noise_um=0.01, seed=3).to_dict()]


def read_truth(folder: Path) -> Truth:
    from rdpi_gym.plant.effects.base import effect_from_dict

    document = read_json(folder / "truth.json", "rdpi-truth", 1)
    plant = PlantModel.from_dict(document.get("plant"), "truth.json")  # type: ignore[arg-type]
    hidden = document.get("hidden")
    return Truth(
        plant,
        tuple(effect_from_dict(CATALOGUE, e, "truth.json") for e in hidden)
        if isinstance(hidden, list)
        else (),
        noise_um=0.0,
        seed=0,
    )


def signals() -> list[dict[str, Any]]:
    plain = [
        kind() for name, kind in SIGNALS.items() if name not in ("sum", "sequence", "measured")
    ]
    record = Measured(times_s=[0.0, 1.0, 2.0], values_um=[0.0, 3.0, 1.0])
    both = make_signal(
        "sum",
        parts=[
            plain[1],
            make_signal("sequence", parts=[*plain[:2], record], durations_s=[1.0] * 3),
        ],
    )
    return [each.to_dict() for each in (*plain, record, both, both)]


def read_signal(folder: Path) -> Signal:
    path = folder / "signal.json"
    signal = signal_from_dict(parse_json(read_utf8(path, 2**20), str(path)))
    signal.to_dict()
    return signal


def json_file(documents: list[dict[str, Any]], name: str) -> Write:
    def write(rng: Random, folder: Path) -> None:
        (folder / name).write_bytes(mutations.json_text(rng, rng.choice(documents)))
        special(rng, folder / name)

    return write


@cache
def stored() -> bytes:
    with tempfile.TemporaryDirectory() as name:
        named_rows(Path(name) / "rows.jsonl").append(ROWS)
        return (Path(name) / "rows.jsonl").read_bytes()


def write_store(rng: Random, folder: Path) -> None:
    raw = stored()
    if rng.random() < 0.2:  # rows that were written so: their check sums are right
        deep = mutations.nested(rng.choice((3, 400, 900)))
        named_rows(folder / "rows.jsonl").append([{**ROWS[0], "rmse_um": deep}])
        return
    changed = (
        mutations.text(rng, raw.decode()) if rng.random() < 0.5 else mutations.binary(rng, raw)
    )
    (folder / "rows.jsonl").write_bytes(changed)
    special(rng, folder / "rows.jsonl")


def read_store(folder: Path) -> dict[str, Any]:
    rows = named_rows(folder / "rows.jsonl").rows
    for row in rows.values():
        is_ours = row in ROWS or isinstance(row["rmse_um"], list)
        assert is_ours, f"a row was changed unnoticed: {row}"
    return rows


def policy_files() -> tuple[dict[str, Any], bytes]:
    """Make a policy: what describes it, and its weights."""
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


@contextmanager
def policies() -> Iterator[Subject]:
    """The reader of policies; torch is imported here."""
    described, weights = policy_files()
    with zipfile.ZipFile(io.BytesIO(weights)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}

    def packed(rng: Random) -> bytes:
        """The weights with a damaged member, in an archive that is whole."""
        stream, target = (
            io.BytesIO(),
            rng.choice([*members, *[m for m in members if ".pkl" in m] * 4]),
        )
        with zipfile.ZipFile(stream, "w", rng.choice((0, 0, 0, zipfile.ZIP_DEFLATED))) as archive:
            for name, content in members.items():
                changed = mutations.binary(rng, content) if name == target else content
                add(archive, name, changed)
        return stream.getvalue()

    def write(rng: Random, folder: Path) -> None:
        content, what = weights, rng.randrange(3)
        if what == 0:
            content = mutations.binary(rng, weights) if rng.random() < 0.5 else packed(rng)
        said = {**described, "weights_sha256": hashlib.sha256(content).hexdigest()}
        written = json.dumps(said).encode() if what == 0 else mutations.json_text(rng, said)
        (folder / "policy.json").write_bytes(written)
        (folder / "weights.pt").write_bytes(content)
        special(rng, folder / rng.choice(("policy.json", "weights.pt")))

    yield Subject(write, read_policy)


@contextmanager
def hyperparameters() -> Iterator[Subject]:
    """The reader of hyper-parameters, for an algorithm that is described by its arguments alone."""
    from baselines.learned import settings

    shipped = [path.read_text() for path in sorted(settings.SHIPPED.glob("*.yml"))]
    from stable_baselines3 import PPO, SAC

    def write(rng: Random, folder: Path) -> None:
        (folder / "ppo.yml").write_bytes(mutations.text(rng, rng.choice(shipped)))
        special(rng, folder / "ppo.yml")

    def read(folder: Path) -> Any:
        algorithm = SAC if "buffer_size" in shipped[0] else PPO
        return settings.read_settings(folder / "ppo.yml", algorithm)

    yield Subject(write, read)


@contextmanager
def results() -> Iterator[Subject]:
    """The reader of saved results."""
    import rdpi_gym as rg

    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "run.csv").write_text(TEXTS[0])
        data = rg.load(Path(name) / "run.csv")
        files = []
        for k, result in enumerate((data, rg.fit(data))):
            result.save(Path(name) / f"{k}.npz")
            files.append((Path(name) / f"{k}.npz").read_bytes())

    def described(rng: Random, raw: bytes) -> bytes:
        """A result with a damaged description, in an archive that is whole."""
        stream = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(raw)) as old, zipfile.ZipFile(stream, "w") as new:
            for member in old.namelist():
                content = old.read(member)
                if member == "document.npy":
                    said = json.loads(np.load(io.BytesIO(content)).tobytes())
                    changed = np.frombuffer(mutations.json_text(rng, said), dtype=np.uint8)
                    own = io.BytesIO()
                    np.save(own, changed)
                    content = own.getvalue()
                add(new, member, content)
        return stream.getvalue()

    def write(rng: Random, folder: Path) -> None:
        raw = rng.choice(files)
        changed = described(rng, raw) if rng.random() < 0.6 else mutations.binary(rng, raw)
        (folder / "result.npz").write_bytes(changed)
        special(rng, folder / "result.npz")

    yield Subject(write, lambda folder: rg.load_result(folder / "result.npz"))


@contextmanager
def matlab(name: str) -> Iterator[Subject]:
    """The reader of MATLAB files, one other process for all of them."""
    files = v5_files() if name == "matlab-v5" else v73_files()
    with MatlabReader() as reader:
        yield Subject(damaged(files, "run.mat"), read_mat(reader), other=pid_of(reader))


def pid_of(reader: MatlabReader) -> Callable[[], int | None]:
    return lambda: None if reader._process is None else reader._process.pid


SHARES = {
    "csv": 4_000,
    "dataset.toml": 2_500,
    "npz": 2_500,
    "matlab-v5": 1_500,
    "matlab-v7.3": 1_500,
    "plant": 2_000,
    "truth": 500,
    "signal": 1_500,
    "policy": 1_500,
    "hyperparameters": 500,
    "rows": 1_000,
    "result": 1_000,
}
"""How many of 20,000 damaged files each reader has."""
STRUCTURED = {
    "npz/structure": 3_000,
    "result/structure": 700,
    "plant/structure": 4_600,
    "truth/structure": 300,
    "signal/structure": 3_300,
    "dataset.toml/structure": 1_000,
    "matlab-v5/structure": 2_200,
    "matlab-v7.3/structure": 2_600,
    "policy/structure": 400,
    "student/structure": 150,
    "checkpoint/structure": 300,
    "hyperparameters/structure": 300,
    "tuning/structure": 200,
    "diagnosis/structure": 250,
    "journal/structure": 250,
    "session data/structure": 80,
    "tracking rows/structure": 30,
    "task rows/structure": 30,
    "candidates/structure": 100,
    "submission/structure": 80,
    "program/structure": 30,
    "folders/structure": 100,
}
"""How many of 20,000 attacks on the structure of documents each reader meets."""


@contextmanager
def subject(name: str) -> Iterator[Subject]:
    """Make a subject by its name, with what it needs open while it is used."""
    if name in STRUCTURED:
        from tests.fuzz.documents import MAKERS

        with MAKERS[name.partition("/")[0]]() as made:
            yield made
        return
    makers = {"policy": policies, "hyperparameters": hyperparameters, "result": results}
    if name in makers:
        with makers[name]() as made:
            yield made
    elif name.startswith("matlab"):
        with matlab(name) as made:
            yield made
    else:
        write, read = {
            "csv": (write_csv, read_folder),
            "dataset.toml": (write_toml, read_folder),
            "npz": (write_npz, read_folder),
            "plant": (
                json_file(plants(), "plant.json"),
                lambda f: PlantModel.load(f / "plant.json"),
            ),
            "truth": (json_file(truths(), "truth.json"), read_truth),
            "signal": (json_file(signals(), "signal.json"), read_signal),
            "rows": (write_store, read_store),
        }[name]
        yield Subject(write, read)
