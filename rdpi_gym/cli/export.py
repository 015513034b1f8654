"""`rdpi export` and `rdpi verify`: a policy as ONNX; a plant or a controller as C or as an FMU."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import typer
from typer.core import TyperGroup

import rdpi_gym as rg
from rdpi_gym.cli.options import SeedOption, as_typed
from rdpi_gym.support.command_line import check_folder
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.onnx_metadata import told
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.words import quoted

ModelArgument: TypeAlias = Annotated[
    str,
    typer.Argument(metavar="MODEL", show_default=False, help="A plant file, or a plant's name."),
]
ControllerOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--controller",
        metavar="NAME|learned:FOLDER",
        help="A controller that believes in the plant; by default the plant itself is exported.",
    ),
]
TsOption: TypeAlias = Annotated[
    float, typer.Option("--ts", metavar="SECONDS", help="Sampling time (s).")
]
PreviewOption: TypeAlias = Annotated[
    int | None,
    typer.Option(
        "--preview",
        metavar="N",
        help="Samples of the reference that a step is shown ahead; by default as many as are used.",
    ),
]
_TYPED = {"ts_s": "--ts", "preview": "--preview", "belief": "--belief"}


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


@export.command(name="onnx")
def export_onnx(
    policy: Annotated[
        str, typer.Argument(metavar="POLICY", show_default=False, help="Folder, or shipped name.")
    ],
    belief: Annotated[
        str | None,
        typer.Option(
            "--belief",
            metavar="NAME|FILE",
            help="Of a student: what its controller knows of the plant; else what it was taught with.",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE.onnx", help="File that is written.")
    ] = Path("policy.onnx"),
) -> None:
    """Write a trained policy as an ONNX file: a network, or a student's whole controller as a step."""
    check_folder(out.parent)
    with as_typed(_TYPED):
        written = rg.export(policy, out, belief=belief)
    print(told(written))


@export.command(name="c")
def export_c(
    model: ModelArgument,
    controller: ControllerOption = None,
    ts: TsOption = 5e-5,
    preview: PreviewOption = None,
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="DIR", help="Folder that is written; an earlier export is replaced."
        ),
    ] = Path("firmware"),
) -> None:
    """Write a controller or a plant as C99, with vectors that test it, examples and a page to read."""
    check_folder(out)
    with as_typed(_TYPED):
        done = rg.export_c(model, out, controller=controller, ts_s=ts, preview=preview)
    print(done)


@export.command(name="fmu")
def export_fmu(
    model: ModelArgument,
    controller: ControllerOption = None,
    ts: TsOption = 5e-5,
    preview: PreviewOption = None,
    fmi: Annotated[Literal["2", "3"], typer.Option("--fmi", help="Version of the standard.")] = "3",
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE.fmu", help="File that is written.")
    ] = Path("stage.fmu"),
) -> None:
    """Write a plant or a controller as an FMU for co-simulation, with no Python inside."""
    check_folder(out.parent)
    with as_typed(_TYPED):
        done = rg.export_fmu(model, out, controller=controller, ts_s=ts, preview=preview, fmi=fmi)
    print(done)


def verify(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER", show_default=False, help="What rdpi export c wrote. Its code is run."
        ),
    ],
    records: Annotated[int, typer.Option("--records", min=1, help="Random records.")] = 1000,
    samples: Annotated[int, typer.Option("--samples", min=1, help="Samples of each.")] = 1000,
    seed: SeedOption = 0,
) -> None:
    """Compile an exported folder, run its vectors and random records, and compare with Python."""
    with progress_bar() as show:
        found = rg.verify(folder, records=records, samples=samples, seed=seed, progress=show)
    print(found)
    if not found.passed:
        failed = next(row for row in found.rows if not row.passed)
        raise InputError(
            f"{folder} is not what Python is: {failed.what} in {failed.precision} differ by "
            f"{failed.largest:.2g}, {failed.allowed:.2g} are allowed; export it anew"
        )
