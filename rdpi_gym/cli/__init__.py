"""The command `rdpi`: parses, calls what ``import rdpi_gym as rg`` gives, prints and writes."""

from __future__ import annotations

import sys
from functools import partial
from importlib import import_module

import typer

from rdpi_gym.cli.options import expanded
from rdpi_gym.support.command import run_command
from rdpi_gym.support.errors import InputError

COMMANDS = {
    "bench": "bench",
    "submit": "bench",
    "score": "bench",
    "reproduce": "bench",
    "fit": "models",
    "compare": "models",
    "diagnose": "search",
    "add": "search",
    "discover": "search",
    "lab": "lab",
    "simulate": "models",
    "effects": "models",
    "warm": "models",
    "collect": "training",
    "train": "training",
    "tune": "training",
    "verify": "export",
    "export": "export",
}
"""Commands in the order of the help, each with the module of this package that has it."""

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


for _name, _module in COMMANDS.items():
    _command = getattr(import_module(f"rdpi_gym.cli.{_module}"), _name)
    if isinstance(_command, typer.Typer):
        app.add_typer(_command, name=_name)
    else:
        app.command(name=_name)(expanded(_command))


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
    if not (sys.argv[1:] if arguments is None else arguments):
        raise InputError("no command; give one, as in fit --example picma (rdpi --help lists all)")
    result = app(args=arguments, prog_name="rdpi", standalone_mode=False)
    return result if isinstance(result, int) else 0
