"""The command `rdpi`: parses, calls what ``import rdpi_gym as rg`` gives, prints and writes."""

from __future__ import annotations

from functools import partial
from importlib import import_module

import typer

from rdpi_gym.cli.export import export
from rdpi_gym.cli.options import expanded
from rdpi_gym.support.command import run_command

COMMANDS = (
    "bench",
    "submit",
    "score",
    "reproduce",
    "fit",
    "compare",
    "diagnose",
    "add",
    "discover",
    "lab",
    "simulate",
    "effects",
    "collect",
    "train",
    "tune",
    "verify",
)

app = typer.Typer(
    name="rdpi",
    help="Piezo positioning under hysteresis: plants, compensators, identification, benchmark.",
    no_args_is_help=False,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback()
def rdpi() -> None:
    """Piezo positioning under hysteresis: plants, compensators, identification, benchmark."""


for _name in COMMANDS:
    app.command(name=_name)(expanded(getattr(import_module(f"rdpi_gym.cli.{_name}"), _name)))
app.add_typer(export, name="export")


def main(arguments: list[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments
        Words after the command's name; those of the process by default.

    Returns
    -------
    int
        0 on success, else as :func:`~rdpi_gym.support.command.run_command` says.
    """
    return run_command("rdpi", partial(_call, arguments))


def _call(arguments: list[str] | None) -> int:
    result = app(args=arguments, prog_name="rdpi", standalone_mode=False)
    return result if isinstance(result, int) else 0
