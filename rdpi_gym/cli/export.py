"""`rdpi export`: writes a trained policy as an ONNX file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.support.command_line import check_folder


def export(
    policy: Annotated[
        str, typer.Argument(metavar="POLICY", show_default=False, help="Folder, or shipped name.")
    ],
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE.onnx", help="File that is written.")
    ] = Path("policy.onnx"),
) -> None:
    """Write a trained policy as an ONNX file: stacked observation in, action out."""
    check_folder(out.parent)
    print(f"policy: {rg.export(policy, out)}")
