"""Description in the metadata of an exported ONNX file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

METADATA = "rdpi-gym"
"""Key of the file's metadata under which its description stands, as JSON."""


def described(path: Path) -> dict[str, Any]:
    """Return what a file that was exported says of itself."""
    import onnx

    model = onnx.load(path, load_external_data=False)
    said = {each.key: each.value for each in model.metadata_props}
    found: dict[str, Any] = json.loads(said[METADATA])
    return found


def told(path: Path) -> str:
    """Return in a line what was exported, and in a second one what to beware of."""
    about = described(path)
    holds = f", {about['holds']}" if "holds" in about else ""
    return "\n".join([f"policy: {path}{holds}", *filter(None, [about.get("warning")])])
