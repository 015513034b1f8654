"""An ONNX file, and what it says of itself."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.onnx_metadata import METADATA


def check_file(out: Path, packages: Sequence[str]) -> None:
    """Refuse what no file can be written to, and an installation that cannot write it."""
    if out.suffix != ".onnx" or out.is_dir():
        raise InputError(f"{out} is no file to export to; give one that ends in .onnx")
    for name in packages:
        try:
            import_module(name)
        except ImportError as error:
            raise InputError(
                f"an export needs {name}, which cannot be imported; run pip install rdpi-gym[onnx]"
            ) from error


def content(model: Any, description: Mapping[str, Any]) -> bytes:
    """Return what a file holds: a model with its description, and nothing of how it was made."""
    import onnx

    for part in (model.graph, *model.graph.node, *model.graph.value_info):
        del part.metadata_props[:]
    onnx.helper.set_model_props(model, {METADATA: json.dumps(description, allow_nan=False)})
    onnx.checker.check_model(model)
    found: bytes = model.SerializeToString()
    return found
