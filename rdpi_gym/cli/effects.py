"""`rdpi effects`: the catalogue of physical effects."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rdpi_gym.cli.options import check_folder
from rdpi_gym.support.terminal import console

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from rdpi_gym.plant.effects import Effect


def effects(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="One effect in full; module:Class is one of your own.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder for effects.json and effects.md; nothing is written without it.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """List the physical effects that a plant can have: equations, parameters, signatures."""
    from rdpi_gym.plant.effects import CATALOGUE, load_effect
    from rdpi_gym.plant.effects.description import describe, pages
    from rdpi_gym.support.files import write_atomic, write_json

    if out is not None:
        check_folder(out)
    screen = console(width=80)
    if name is None:
        kinds = list(CATALOGUE.values())
        screen.print(_catalogue(kinds))
    else:
        kinds = [load_effect(name)]
        _print_in_full(screen, kinds[0])
    if out is not None:
        document = {
            "format": "rdpi-effects",
            "version": 1,
            "effects": [describe(kind) for kind in kinds],
        }
        for path in (
            write_json(out / "effects.json", document),
            write_atomic(out / "effects.md", pages(kinds)),
        ):
            print(path)


def _catalogue(kinds: list[type[Effect]]) -> Table:
    from rich.table import Table

    from rdpi_gym.plant.effects.description import typical

    table = Table(show_lines=True)
    table.add_column("effect", no_wrap=True)
    table.add_column("equation, and what it leaves in a residual", ratio=3)
    table.add_column("parameters, typical values", ratio=2)
    for kind in kinds:
        parameters = "\n".join(f"{p.name}: {typical(p)}" for p in kind.parameters)
        table.add_row(kind.name, f"{kind.equation}\n{kind.signature}", parameters)
    return table


def _print_in_full(screen: Console, kind: type[Effect]) -> None:
    from rich.table import Table
    from rich.text import Text

    from rdpi_gym.plant.effects.description import PLACES, paragraphs, summary, typical

    screen.print(Text.assemble((kind.name, "bold"), f": {summary(kind)}"))
    screen.print(f"It acts {PLACES[kind.slot]}.\n\n    {kind.equation}\n")
    table = Table()
    for heading in ("parameter", "meaning", "default", "typical", "bounds"):
        table.add_column(heading)
    for p in kind.parameters:
        bounds = "chosen, not fitted" if p.fixed else f"{p.low:.6g} to {p.high:.6g}"
        cells = (p.name, p.meaning, f"{kind().values[p.name]:.6g}", typical(p), bounds)
        table.add_row(*cells)
    screen.print(table)
    for heading, text in paragraphs(kind).items():
        screen.print(Text.assemble((f"{heading}:", "bold"), f" {text}"))
