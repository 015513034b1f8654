"""The command `rdpi`: parses, calls what ``import rdpi_gym as rg`` gives, prints and writes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import typer

from rdpi_gym.cli import bench, export, lab, models, search, tasks, training
from rdpi_gym.cli.options import expanded
from rdpi_gym.support.command import run_command

COMMANDS: dict[str, Callable[..., None]] = {
    "bench": bench.bench,
    "submit": tasks.submit,
    "score": tasks.score,
    "reproduce": bench.reproduce,
    "fit": models.fit,
    "compare": models.compare,
    "diagnose": search.diagnose,
    "add": search.add,
    "discover": search.discover,
    "lab": lab.lab,
    "simulate": models.simulate,
    "effects": models.effects,
    "collect": training.collect,
    "train": training.train,
    "tune": training.tune,
    "verify": export.verify,
}
"""In the order of the help."""

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


for _name, _command in COMMANDS.items():
    app.command(name=_name)(expanded(_command))
app.add_typer(export.export, name="export")


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
