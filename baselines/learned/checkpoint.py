"""What an interrupted training goes on from: networks, optimisers, replay buffer; no code in it."""

from __future__ import annotations

import hashlib
import io
import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from baselines.learned.weights import read_tensors
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import open_regular, read_json, write_atomic, write_json
from rdpi_gym.support.folders import replaced_folder
from rdpi_gym.support.npz import open_npz
from rdpi_gym.support.temporaries import clear_abandoned
from rdpi_gym.support.words import quoted

FORMAT, VERSION = "rdpi-checkpoint", 1
_DESCRIPTION, _MODEL, _REPLAY = "checkpoint.json", "model.pt", "replay.npz"
_REPLAYED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save_checkpoint(
    folder: Path, model: BaseAlgorithm, progress: dict[str, Any], finished: bool = False
) -> None:
    """Keep a model as it is now, instead of what was kept before.

    Parameters
    ----------
    folder
        Holds one folder a checkpoint, named by its step.
    model
        The model; what it draws next is not kept, see :mod:`baselines.learned.course`.
    progress
        Whatever else is needed to go on, as JSON.
    finished
        Nothing goes on from it: the replay buffer is left out.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    newest = folder / f"{model.num_timesteps:012d}"
    with replaced_folder(newest) as fresh:
        variables = {name: getattr(model, name).data for name in _variables(model)}
        networks = io.BytesIO()
        torch.save({"parameters": model.get_parameters(), "variables": variables}, networks)
        write_atomic(fresh / _MODEL, networks.getvalue())
        if isinstance(model, OffPolicyAlgorithm) and not finished:
            np.savez(fresh / _REPLAY, **_replayed(model))
        document = {
            "format": FORMAT,
            "version": VERSION,
            "algorithm": type(model).__name__,
            "timesteps": model.num_timesteps,
            "updates": model._n_updates,
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


def load_checkpoint(folder: Path, model: BaseAlgorithm) -> dict[str, Any] | None:
    """Bring a model to where the newest checkpoint left it.

    Returns
    -------
    dict or None
        What was given as `progress`; None where there is no checkpoint.

    Raises
    ------
    InputError
        The checkpoint was cut off, is of another version, or of another model.
    """
    kept = _checkpoints(folder)
    if not kept:
        return None
    newest = kept[-1]
    document = read_json(newest / _DESCRIPTION, FORMAT, VERSION)
    if document.get("algorithm") != type(model).__name__:
        raise InputError(
            f"{newest} is a checkpoint of {document.get('algorithm')} and not of {type(model).__name__}"
        )
    try:
        _check(newest, document)
        saved = read_tensors(newest / _MODEL, device=model.device)
        model.set_parameters(saved["parameters"], exact_match=True, device=model.device)
        for name in _variables(model):
            getattr(model, name).data = saved["variables"][name]
        if isinstance(model, OffPolicyAlgorithm) and not document["finished"]:
            _replay(model, newest / _REPLAY)
        model.num_timesteps = int(document["timesteps"])
        model._n_updates = int(document["updates"])
        progress: dict[str, Any] = dict(document["progress"])
    except Exception as error:  # a damaged archive raises whatever its reader trips over
        reason = " ".join(str(error).split())[:200]
        raise InputError(
            f"{newest} cannot be gone on from, perhaps a file in it was cut off ({reason}); "
            "delete it to begin anew, or give another folder"
        ) from error
    return progress


def _check(folder: Path, document: dict[str, Any]) -> None:
    """See that nothing has changed since it was written."""
    if document["sha256"] != _seal(document):
        raise ValueError(f"{_DESCRIPTION} is not what was written")
    for name, sha256 in document["files"].items():
        if name not in (_MODEL, _REPLAY):
            raise ValueError(f"{quoted(name)} is no file of a checkpoint")
        with open_regular(folder / name) as stream:
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


def _variables(model: BaseAlgorithm) -> list[str]:
    """Name the parameters that belong to no network: SAC's entropy coefficient."""
    return [name for name in ("log_ent_coef",) if getattr(model, name, None) is not None]


def _replayed(model: OffPolicyAlgorithm) -> dict[str, Any]:
    buffer = model.replay_buffer
    assert buffer is not None
    filled = buffer.buffer_size if buffer.full else buffer.pos
    arrays = {name: getattr(buffer, name)[:filled] for name in _REPLAYED}
    return arrays | {"position": buffer.pos, "full": buffer.full}


def _replay(model: OffPolicyAlgorithm, path: Path) -> None:
    buffer = model.replay_buffer
    assert buffer is not None
    with open_npz(path) as saved:
        for name in _REPLAYED:
            kept = saved.read(name)
            getattr(buffer, name)[: len(kept)] = kept
        buffer.pos, buffer.full = int(saved.read("position")), bool(saved.read("full"))
