"""Options that several subcommands share, and how a command takes a whole group of them."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, is_dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias, get_args, get_origin, get_type_hints

import typer

from rdpi_gym.face.options import EXAMPLES, example_folder
from rdpi_gym.support.command import check_folder, check_jobs
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.options import Option, entries, option_fields
from rdpi_gym.support.words import quoted


def words(text: str | None) -> list[str] | None:
    """Return the words of a list as a command line has it, blank ones left out."""
    if text is None:
        return None
    return [word.strip() for word in text.split(",") if word.strip()]


def data_path(text: str) -> Path:
    """Return the path that the word DATA is; an empty one is not the current folder."""
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
        help="A data file (.csv, .txt, .dat, .tsv, also .gz; .mat, .npz), or a folder of them.",
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
VerboseOption: TypeAlias = Annotated[
    bool, typer.Option("--verbose", help="Print every finding, row, note and file.")
]
SeedOption: TypeAlias = Annotated[
    int, typer.Option("--seed", min=0, help="Seed of every random draw.")
]
JobsOption: TypeAlias = Annotated[
    int,
    typer.Option("--jobs", help="Worker processes; -1: one for each core.", callback=check_jobs),
]


@contextmanager
def as_typed(flags: Mapping[str, str]) -> Iterator[None]:
    """Name the option that was typed where an error begins with the keyword of a function."""
    try:
        yield
    except InputError as error:
        said = str(error)
        for name, flag in flags.items():
            if said.startswith((f"{name} ", f"{name}:")):
                raise InputError(flag + said.removeprefix(name)) from None
        raise


_RANGE = re.compile(r"(?P<metavar>.*?),?\s*(?:(?P<min>\d+) (?:or more|to (?P<max>\d+)))?")


def _stated(parameter: inspect.Parameter, hint: Any, told: Mapping[str, tuple[str, str]]) -> Any:
    """Annotation of a command's parameter: its own, or an argument or option as the docstring says.

    A parameter without default is an argument, any other an option; the docstring states its metavar,
    the range of a number and its meaning.
    """
    if get_origin(hint) is Annotated:
        return hint
    form, meaning = told[parameter.name]
    found = _RANGE.fullmatch(form)
    assert found is not None  # every text matches
    further: dict[str, Any] = {
        key: int(found[key]) for key in ("min", "max") if found[key] is not None
    }
    further |= {"metavar": found["metavar"] or None, "help": meaning or None}
    if parameter.default is inspect.Parameter.empty:
        return Annotated[hint, typer.Argument(show_default=False, **further)]
    flags = [f"--{parameter.name.replace('_', '-')}"] if parameter.default is not True else []
    return Annotated[hint, typer.Option(*flags, **further)]


_EXAMPLE = inspect.Parameter(
    "example",
    inspect.Parameter.KEYWORD_ONLY,
    default=None,
    annotation=Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=f"In place of DATA, a measurement that ships: {', '.join(EXAMPLES)}.",
        ),
    ],
)


def _is_data(hint: Any) -> bool:
    return any(getattr(each, "parser", None) is data_path for each in get_args(hint))


def _chosen_data(data: Any, example: str | None, parameter: inspect.Parameter) -> Any:
    """Return the paths of the data, or of the example in their place."""
    if example is not None and data:
        raise InputError(f"--example {quoted(example)} stands in place of DATA; give one of them")
    many = parameter.default is None
    if example is not None:
        folder = example_folder(example)
        return [folder] if many else folder
    if data is None and not many:
        raise InputError(
            f"DATA is missing; give a data file, a folder of data files, or --example {EXAMPLES[0]}"
        )
    return data


def expanded(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command its options: those its docstring states, the fields of groups, examples of data.

    A parameter whose type is a dataclass of options, such as ``reading: DataOptions``, becomes the
    options that its fields state; see :mod:`rdpi_gym.support.options`. With an argument DATA comes
    ``--example``, which stands in its place.
    """
    data: inspect.Parameter | None = None
    hints, told = get_type_hints(command, include_extras=True), entries(command.__doc__)
    own: list[inspect.Parameter] = []
    further: list[inspect.Parameter] = []
    groups: dict[str, tuple[type, dict[str, tuple[str, Option]]]] = {}
    for parameter in inspect.signature(command).parameters.values():
        hint = hints[parameter.name]
        if not (isinstance(hint, type) and is_dataclass(hint)):
            stated = _stated(parameter, hint, told)
            own.append(parameter.replace(annotation=stated, kind=parameter.KEYWORD_ONLY))
            if _is_data(stated):
                data = parameter
                own[-1:] = own[-1].replace(default=None), _EXAMPLE
            continue
        names = {}
        for field, option, meaning in option_fields(hint):
            name = f"{parameter.name}_{field.name}"  # a command may have an argument of its name
            names[name] = (field.name, option)
            default = None if field.default in (MISSING, ()) else field.default
            kind: Any = option.type if default is not None else option.type | None
            flag = typer.Option(option.flag, metavar=option.metavar, help=meaning)
            annotation = Annotated[kind, flag]
            further.append(
                inspect.Parameter(
                    name, parameter.KEYWORD_ONLY, default=default, annotation=annotation
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
        if data is not None:
            given[data.name] = _chosen_data(given[data.name], given.pop(_EXAMPLE.name), data)
        command(**given)

    signature = inspect.Signature([*own, *further])
    call.__doc__ = inspect.cleandoc(command.__doc__ or "").partition("\n\nParameters\n")[0]
    call.__signature__ = signature  # type: ignore[attr-defined]
    call.__annotations__ = {p.name: p.annotation for p in signature.parameters.values()}
    return call
