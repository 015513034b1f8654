"""Learners as a training runs them, and their checkpoints: tensors and arrays, no code."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import shutil
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from baselines.learned.policy import read_tensors
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import (
    open_regular,
    read_json,
    replaced_folder,
    write_atomic,
    write_json,
)
from rdpi_gym.support.npz import open_npz
from rdpi_gym.support.temporaries import clear_abandoned
from rdpi_gym.support.words import quoted


@dataclass(frozen=True)
class CheckpointContent:
    """Content of a checkpoint."""

    timesteps: int
    updates: int  # that had been made; steps count all lanes together
    tensors: Mapping[str, Any]  # of :meth:`Checkpointable.tensors`
    # Reader of one of :meth:`Checkpointable.arrays` by its name; None: they were left out.
    read: Callable[[str], NDArray[np.generic]] | None


class TrainingHooks(Protocol):
    """Callbacks of a training between two stretches: evaluation and checkpoint."""

    def before_rollout(self) -> Mapping[str, float]:
        """Handle the begin of a rollout; return an evaluation, if one was made."""

    def rewarded(self, reward: float) -> None:
        """Record the mean reward of a step of all lanes."""

    def end(self) -> Mapping[str, float]:
        """Handle the end of the training; return the last evaluation."""


class Checkpointable(Protocol):
    """State that a checkpoint saves and restores."""

    @property
    def kind(self) -> str:
        """Name of the algorithm in a checkpoint."""

    @property
    def timesteps(self) -> int:
        """Steps of all lanes together so far."""

    @property
    def updates(self) -> int:
        """Updates made so far."""

    def tensors(self) -> Mapping[str, Any]:
        """Return tensors, and mappings of these, from which it goes on."""

    def arrays(self) -> Mapping[str, Any]:
        """Return what is large and not needed once a training is finished: a replay buffer."""

    def restore(self, kept: CheckpointContent) -> None:
        """Go on from what a checkpoint holds."""


class Learner(Checkpointable, Protocol):
    """Networks that learn in an environment of their own."""

    @property
    def layout(self) -> ObservationLayout:
        """Observation layout of the environment."""

    def actor(self) -> list[nn.Module]:
        """Return the deterministic actor: linear layers, activations, and what keeps actions within [-1, 1]."""

    def begin(self, seed: int) -> None:
        """Seed every generator, and begin an episode in all lanes."""

    def learn(self, timesteps: int, between: TrainingHooks) -> None:
        """Take so many steps more."""


FORMAT, VERSION = "rdpi-checkpoint", 1
_DESCRIPTION, _MODEL, _REPLAY = "checkpoint.json", "model.pt", "replay.npz"
_LARGEST = {_MODEL: 2**28, _REPLAY: 2**34}  # bytes; what is larger is not even hashed


def save_checkpoint(
    folder: Path, learner: Checkpointable, progress: dict[str, Any], finished: bool = False
) -> None:
    """Keep a learner as it is now, instead of what was kept before."""
    newest = folder / f"{learner.timesteps:012d}"
    with replaced_folder(newest) as fresh:
        networks = io.BytesIO()
        torch.save(learner.tensors(), networks)
        write_atomic(fresh / _MODEL, networks.getvalue())
        arrays = {} if finished else learner.arrays()
        if arrays:
            np.savez(fresh / _REPLAY, **arrays)
        document = {
            "format": FORMAT,
            "version": VERSION,
            "algorithm": learner.kind,
            "timesteps": learner.timesteps,
            "updates": learner.updates,
            "finished": finished,
            "progress": progress,
            "files": {path.name: _sha256(path.read_bytes()) for path in sorted(fresh.iterdir())},
        }
        document["sha256"] = _seal(document)
        write_json(fresh / _DESCRIPTION, document)
    for other in _checkpoints(folder):
        if other != newest:
            shutil.rmtree(other, ignore_errors=True)
    clear_abandoned(folder)


def load_checkpoint(folder: Path, learner: Checkpointable) -> dict[str, Any] | None:
    """Restore a learner from the newest checkpoint."""
    kept = _checkpoints(folder)
    if not kept:
        return None
    newest = kept[-1]
    document = read_json(newest / _DESCRIPTION, FORMAT, VERSION)
    if document.get("algorithm") != learner.kind:
        raise InputError(
            f"{newest} is a checkpoint of {document.get('algorithm')} and not of {learner.kind}"
        )
    try:
        _check(newest, document)
        with ExitStack() as stack:
            read = None
            if _REPLAY in document["files"]:
                read = stack.enter_context(open_npz(newest / _REPLAY)).read
            tensors = read_tensors(newest / _MODEL)
            learner.restore(
                CheckpointContent(
                    int(document["timesteps"]), int(document["updates"]), tensors, read
                )
            )
        progress: dict[str, Any] = dict(document["progress"])
    except Exception as error:  # a damaged archive raises whatever its reader trips over
        reason = " ".join(str(error).split())[:200]
        raise InputError(
            f"{newest} cannot be gone on from, perhaps a file in it was cut off ({reason}); "
            "delete it to begin anew, or give another folder"
        ) from error
    return progress


def _check(folder: Path, document: dict[str, Any]) -> None:
    """Check that no file has changed since it was written."""
    if document["sha256"] != _seal(document):
        raise ValueError(f"{_DESCRIPTION} is not what was written")
    for name, sha256 in document["files"].items():
        if name not in _LARGEST:
            raise ValueError(f"{quoted(name)} is no file of a checkpoint")
        with open_regular(folder / name) as stream:
            if os.fstat(stream.fileno()).st_size > _LARGEST[name]:
                raise ValueError(f"{name} is larger than any that is written")
            if hashlib.file_digest(stream, "sha256").hexdigest() != sha256:
                raise ValueError(f"{name} is not what was written")


def _seal(document: dict[str, Any]) -> str:
    rest = {name: value for name, value in document.items() if name != "sha256"}
    return _sha256(json.dumps(rest, sort_keys=True).encode())


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _checkpoints(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if re.fullmatch(r"\d{12}", path.name))
