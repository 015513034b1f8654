"""Options that several subcommands share, and how a command takes a whole group of them."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, is_dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias, get_type_hints

import typer

from rdpi_gym.support.command_line import check_folder
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.options import Option, option_fields


def words(text: str | None) -> list[str] | None:
    """Return the words of a list as a command line has it, blank ones left out.

    Examples
    --------
    >>> words("sine, triangle,"), words(None)
    (['sine', 'triangle'], None)
    """
    if text is None:
        return None
    return [word.strip() for word in text.split(",") if word.strip()]


def data_path(text: str) -> Path:
    """Return the path that the word DATA is; an empty one is not the current folder.

    Raises
    ------
    InputError
        The word is empty, as a variable of the shell is that was never set.

    Examples
    --------
    >>> data_path("run.csv").suffix
    '.csv'
    """
    if not text:
        raise InputError("DATA is empty; give a data file or a folder of data files")
    return Path(text)


def _folder(out: Path) -> Path:
    return check_folder(out)


DataArgument: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="DATA",
        parser=data_path,
        help="A data file (.csv, .txt, .dat, .tsv, .mat, .npz), or a folder of them.",
        show_default=False,
    ),
]
OutOption: TypeAlias = Annotated[
    Path,
    typer.Option(
        "--out",
        metavar="DIR",
        help="Folder that the results are written to.",
        callback=_folder,
    ),
]
SeedOption: TypeAlias = Annotated[
    int, typer.Option("--seed", min=0, help="Seed of every random draw.")
]


@contextmanager
def as_typed(flags: Mapping[str, str]) -> Iterator[None]:
    """Name the option that was typed where an error begins with the keyword of a function.

    Parameters
    ----------
    flags
        Options by keyword.

    Examples
    --------
    >>> with as_typed({"hide": "--hide"}):
    ...     raise InputError("hide: 'crep' is unknown")
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: --hide: 'crep' is unknown
    """
    try:
        yield
    except InputError as error:
        said = str(error)
        for name, flag in flags.items():
            if said.startswith((f"{name} ", f"{name}:")):
                raise InputError(flag + said.removeprefix(name)) from None
        raise


def expanded(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command one option for each field of the options that it takes whole.

    Parameters
    ----------
    command
        Parameters whose type is a dataclass of options, such as ``reading: DataOptions``, become the
        options that its fields state; see :mod:`rdpi_gym.support.options`.

    Returns
    -------
    callable
        What Typer is given: its signature has the single options.

    Raises
    ------
    InputError
        When it is called: a value that the dataclass refuses.
    """
    hints = get_type_hints(command, include_extras=True)
    own: list[inspect.Parameter] = []
    further: list[inspect.Parameter] = []
    groups: dict[str, tuple[type, dict[str, tuple[str, Option]]]] = {}
    for parameter in inspect.signature(command).parameters.values():
        hint = hints[parameter.name]
        if not (isinstance(hint, type) and is_dataclass(hint)):
            own.append(parameter.replace(annotation=hint, kind=parameter.KEYWORD_ONLY))
            continue
        names = {}
        for field, option, told in option_fields(hint):
            name = f"{parameter.name}_{field.name}"  # a command may have an argument of its name
            names[name] = (field.name, option)
            default = None if field.default in (MISSING, ()) else field.default
            kind = option.type if default is not None else option.type | None
            stated = typer.Option(option.flag, metavar=option.metavar, help=told)
            further.append(
                inspect.Parameter(
                    name,
                    inspect.Parameter.KEYWORD_ONLY,
                    default=default,
                    annotation=Annotated[kind, stated],
                )
            )
        groups[parameter.name] = (hint, names)

    @functools.wraps(command)
    def call(**given: Any) -> None:
        for group, (kind, names) in groups.items():
            read = {
                field: value if option.read is None else option.read(value)
                for name, (field, option) in names.items()
                if (value := given.pop(name)) is not None
            }
            with as_typed({field: option.flag for field, option in names.values()}):
                given[group] = kind(**read)
        command(**given)

    signature = inspect.Signature([*own, *further])
    call.__signature__ = signature  # type: ignore[attr-defined]
    call.__annotations__ = {p.name: p.annotation for p in signature.parameters.values()}
    return call
