"""Description in the metadata of an exported ONNX file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

METADATA = "rdpi-gym"
"""Key of the file's metadata under which its description stands, as JSON."""


def described(path: Path) -> dict[str, Any]:
    """Return the description that an exported file carries."""
    import onnx

    model = onnx.load(path, load_external_data=False)
    entries = {each.key: each.value for each in model.metadata_props}
    found: dict[str, Any] = json.loads(entries[METADATA])
    return found


def told(path: Path) -> str:
    """Return a line on the contents of the file, and a second one with its warning, if any."""
    about = described(path)
    holds = f", {about['holds']}" if "holds" in about else ""
    return "\n".join([f"policy: {path}{holds}", *filter(None, [about.get("warning")])])
