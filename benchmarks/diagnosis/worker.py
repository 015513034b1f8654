"""A diagnoser alone in its process: records in, probabilities and predictions out, nothing of the truth.

The judge starts ``python -I -m benchmarks.diagnosis.worker NAME`` in an empty folder that holds the
records and the diagnoser's code. Nothing is unpickled on either side.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.diagnosis.answers import Answer, checked_answer, checked_prediction
from benchmarks.diagnosis.entries import find_diagnoser
from benchmarks.diagnosis.scoring import blank
from benchmarks.stages.confinement import confine
from benchmarks.stages.isolation import environment_in
from benchmarks.stages.worker import keep_compiled, readable_places
from benchmarks.tracking.episode import one_line
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.npz import open_npz

PATIENCE_S = 3600.0
"""Time (s) after which a process without an answer is ended."""
_GIVEN, _ANSWER = "records.npz", "answer.npz"
_COLUMNS = ("t_s", "u_V", "y_um", "error_mask", "before_V")


class DiagnoserFailed(Exception):
    """The diagnoser raised an error, said in one line, or its process gave no answer."""


@dataclass(frozen=True)
class Told:
    """Answer of a diagnoser that ran in a process of its own."""

    answer: Answer  # whose predictions are those of the records that were asked about
    seconds: float  # of processor time


def diagnose_apart(
    name: str, code: Path | None, given: Dataset, asked: Sequence[Record]
) -> Told:  # fmt: skip
    """Run a diagnoser in a process that is told the records and no more."""
    with TemporaryDirectory(prefix="diagnoser-", ignore_cleanup_errors=True) as folder:
        here = Path(folder)
        if code is not None:
            shutil.copyfile(code, here / code.name, follow_symlinks=False)
        _write(here / _GIVEN, given, asked)
        try:
            subprocess.run(
                [sys.executable, "-I", "-m", "benchmarks.diagnosis.worker", name],
                cwd=here, env=environment_in(here), timeout=PATIENCE_S, check=True,
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
            with open_npz(here / _ANSWER) as archive:
                stated = json.loads(str(archive.read("answer")))
                predicted = {
                    r.name: np.asarray(archive.read(str(k)), np.float64) for k, r in enumerate(asked)
                } if not stated["failure"] else {}  # fmt: skip
        except (OSError, subprocess.SubprocessError, InputError, ValueError, KeyError) as error:
            raise DiagnoserFailed("its process ended without an answer") from error
    if stated["failure"]:
        raise DiagnoserFailed(one_line(str(stated["failure"])))
    answer = Answer(stated["effects"], stated["other"], lambda record: predicted[record.name])
    return Told(checked_answer(answer), float(stated["seconds"]))


def _write(path: Path, given: Dataset, asked: Sequence[Record]) -> None:
    records = (*given.records, *map(blank, asked))
    arrays = {f"{k} {c}": getattr(r, c) for k, r in enumerate(records) for c in _COLUMNS}
    heads = [{"name": r.name, "role": r.role, "ts_s": r.ts_s} for r in records]
    head = {"title": given.title, "given": len(given.records), "records": heads}
    np.savez(path, head=json.dumps(head), **arrays)


def _read(path: Path) -> tuple[Dataset, list[Record]]:
    with np.load(path, allow_pickle=False) as archive:
        head = json.loads(str(archive["head"]))
        records = [
            Record(**stated, **{c: archive[f"{k} {c}"] for c in _COLUMNS})
            for k, stated in enumerate(head["records"])
        ]
    return Dataset(head["title"], tuple(records[: head["given"]])), records[head["given"] :]


def main() -> None:
    """Diagnose the records of this folder, and leave the answer there."""
    here, name = Path.cwd(), sys.argv[1]
    given, asked = _read(here / _GIVEN)
    keep_compiled()
    confine(readable_places(), [here, Path(os.devnull)])
    sys.path.append(str(here))
    predicted: dict[str, np.ndarray] = {}
    stated = {"failure": "", "effects": {}, "other": 0.0, "seconds": 0.0}
    try:
        diagnoser, began = find_diagnoser(name), time.process_time()
        answer = checked_answer(diagnoser(given))
        stated["seconds"] = time.process_time() - began
        predicted = {str(k): checked_prediction(answer, r) for k, r in enumerate(asked)}
        effects = {str(effect): float(p) for effect, p in answer.effects.items()}
        stated |= {"effects": effects, "other": float(answer.other)}
    except Exception as error:  # a stranger's code may raise anything
        stated["failure"] = f"{type(error).__name__}: {error}"
    np.savez(here / _ANSWER, answer=json.dumps(stated), **predicted)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
