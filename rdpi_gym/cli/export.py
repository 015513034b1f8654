"""`rdpi export` and `rdpi verify`: a policy as ONNX; a plant or a controller as C or as an FMU."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import typer
from typer.core import TyperGroup

import rdpi_gym as rg
from rdpi_gym.cli.options import SeedOption, as_typed, expanded
from rdpi_gym.support.command import check_folder
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.onnx_metadata import told
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.words import quoted

_TYPED = {"ts_s": "--ts", "preview": "--preview", "belief": "--belief", "prefix": "--prefix"}


class _Kinds(TyperGroup):
    """Says what there is where something else was typed, such as the policy alone."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and args[0] not in self.commands:
            raise InputError(
                f"export {quoted(args[0])}: say what is written, onnx, c or fmu, as in "
                "rdpi export onnx POLICY, or rdpi export c MODEL"
            )
        return super().resolve_command(ctx, args)


export = typer.Typer(cls=_Kinds, no_args_is_help=False, rich_markup_mode=None, add_completion=False)


@export.callback()
def _export() -> None:
    """Write a trained policy as ONNX, or a plant or a controller as C or as an FMU."""


def export_onnx(policy: str, belief: str | None = None, out: Path = Path("policy.onnx")) -> None:
    """Write a trained policy as an ONNX file: a network, or a student's whole controller as a step.

    Parameters
    ----------
    policy : POLICY
        Folder, or shipped name.
    belief : NAME|FILE
        Of a student: what its controller knows of the plant; else what it was taught with.
    out : FILE.onnx
        File that is written.
    """
    check_folder(out.parent)
    with as_typed(_TYPED):
        written = rg.export(policy, out, belief=belief)
    print(told(written))


def export_c(
    model: str,
    controller: str | None = None,
    ts: float = 5e-5,
    preview: int | None = None,
    prefix: str | None = None,
    out: Path = Path("firmware"),
) -> None:
    """Write a controller or a plant as C99, with vectors that test it, examples and a page to read.

    Parameters
    ----------
    model : MODEL
        A plant file, or a plant's name.
    controller : NAME|learned:FOLDER
        A controller that believes in the plant; by default the plant itself is exported.
    ts : SECONDS
        Sampling time (s).
    preview : N
        Samples of the reference that a step is shown ahead; by default as many as are used.
    prefix : NAME
        Of files and identifiers, by default rdpi_controller or rdpi_plant: exports with prefixes of their own link into one program.
    out : DIR
        Folder that is written; an earlier export is replaced.
    """
    check_folder(out)
    with as_typed(_TYPED):
        done = rg.export_c(
            model, out, controller=controller, ts_s=ts, preview=preview, prefix=prefix
        )
    print(done)


def export_fmu(
    model: str,
    controller: str | None = None,
    ts: float = 5e-5,
    preview: int | None = None,
    fmi: Literal["2", "3"] = "3",
    out: Path = Path("stage.fmu"),
) -> None:
    """Write a plant or a controller as an FMU for co-simulation, with no Python inside.

    Parameters
    ----------
    model : MODEL
        A plant file, or a plant's name.
    controller : NAME|learned:FOLDER
        A controller that believes in the plant; by default the plant itself is exported.
    ts : SECONDS
        Sampling time (s).
    preview : N
        Samples of the reference that a step is shown ahead; by default as many as are used.
    fmi
        Version of the standard.
    out : FILE.fmu
        File that is written.
    """
    check_folder(out.parent)
    with as_typed(_TYPED):
        done = rg.export_fmu(model, out, controller=controller, ts_s=ts, preview=preview, fmi=fmi)
    print(done)


export.command(name="onnx")(expanded(export_onnx))
export.command(name="c")(expanded(export_c))
export.command(name="fmu")(expanded(export_fmu))


def verify(folder: Path, records: int = 1000, samples: int = 1000, seed: SeedOption = 0) -> None:
    """Compile an exported folder, run its vectors and random records, and compare with Python.

    Parameters
    ----------
    folder : FOLDER
        What rdpi export c wrote. Its code is run.
    records : 1 or more
        Random records.
    samples : 1 or more
        Samples of each.
    """
    with progress_bar() as show:
        found = rg.verify(folder, records=records, samples=samples, seed=seed, progress=show)
    print(found)
    if not found.passed:
        failed = next(row for row in found.rows if not row.passed)
        raise InputError(
            f"{folder} is not what Python is: {failed.what} in {failed.precision} differ by "
            f"{failed.largest:.2g}, {failed.allowed:.2g} are allowed; export it anew"
        )
