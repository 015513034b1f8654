"""Tensors from a file: no code, and no more memory than the file has bytes."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from baselines.learned.kept import check_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_bytes
from rdpi_gym.support.words import quoted

_LARGEST = 2**28  # bytes
_LARGEST_INDEX = 2**20  # of what says which bytes are which tensor


def read_tensors(
    path: Path, sha256: str | None = None, device: torch.device | str = "cpu"
) -> Mapping[str, Any]:
    """Read what `torch.save` wrote of a mapping of tensors, and of mappings of these."""
    content = read_bytes(path, _LARGEST)
    if sha256 is not None:
        check_whole(content, sha256, path.name)
    try:
        _check_archive(content)
        found = torch.load(io.BytesIO(content), map_location=device, weights_only=True)
    except Exception as error:  # a file of something else raises whatever its reader trips over
        raise InputError(f"{path.name} holds no weights alone ({type(error).__name__})") from error
    if not isinstance(found, Mapping):
        raise InputError(f"{path.name} holds a {type(found).__name__} and no weights")
    return found


def read_weights(path: Path, sha256: str, expected: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Read the weights of a network."""
    found = read_tensors(path, sha256)
    if list(found) != list(expected):
        raise InputError(
            f"{path.name} does not fit the network: it holds weights of other layers "
            f"({quoted(list(found))})"
        )
    for name, wanted in expected.items():
        tensor = found[name]
        is_plain = type(tensor) is Tensor and tensor.layout == torch.strided
        if not is_plain or tensor.dtype != wanted.dtype or tensor.shape != wanted.shape:
            shape = "x".join(map(str, wanted.shape))
            raise InputError(
                f"{path.name} does not fit the network: {name!r} is not {shape} numbers"
            )
        if not torch.isfinite(tensor).all():
            raise InputError(f"{path.name} holds a weight in {name!r} that is not finite")
    return dict(found)


def _check_archive(content: bytes) -> None:
    """Refuse archives that expand, or whose index alone is large."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = archive.infolist()
    indices = [member.file_size for member in members if member.filename.endswith(".pkl")]
    if (
        any(member.compress_type != zipfile.ZIP_STORED for member in members)
        or sum(member.file_size for member in members) > len(content)
        or max(indices, default=0) > _LARGEST_INDEX
    ):
        raise ValueError("it is larger inside than outside")
