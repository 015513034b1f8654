"""The command `rdpi`: parses and calls; every result is computed elsewhere."""

from __future__ import annotations

import sys
from importlib import import_module

import typer

from rdpi_gym.support.errors import InputError

COMMANDS = (
    "bench",
    "reproduce",
    "fit",
    "compare",
    "diagnose",
    "add",
    "discover",
    "simulate",
    "effects",
    "train",
    "export",
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
    app.command(name=_name)(getattr(import_module(f"rdpi_gym.cli.{_name}"), _name))


def main(arguments: list[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments
        Words after the command's name; those of the process by default.

    Returns
    -------
    int
        0 on success, 2 on bad input (one line on standard error), 130 when interrupted.
    """
    try:
        result = app(args=arguments, prog_name="rdpi", standalone_mode=False)
    except InputError as error:
        return _refuse(str(error))
    except KeyboardInterrupt:
        print("rdpi: interrupted; what was computed is kept", file=sys.stderr)
        return 130
    except Exception as error:
        # Typer's usage errors carry their own sentence and exit status.
        format_message = getattr(error, "format_message", None)
        if format_message is None:
            raise
        return _refuse(format_message())
    return result if isinstance(result, int) else 0


def _refuse(message: str) -> int:
    print(f"rdpi: {' '.join(message.split())}", file=sys.stderr)
    return 2
