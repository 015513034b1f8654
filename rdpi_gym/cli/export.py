"""`rdpi export`: writes a trained policy as an ONNX file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rdpi_gym.cli.options import check_folder
from rdpi_gym.support.errors import InputError


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
    try:
        from baselines.learned.onnx_export import export_onnx
        from baselines.learned.policy import find_policy
    except ImportError as error:
        raise InputError(f"an export needs {error.name}; run pip install rdpi-gym[rl]") from error
    print(f"policy: {export_onnx(find_policy(policy), out)}")
