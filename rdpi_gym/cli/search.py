"""`rdpi diagnose`, `rdpi add` and `rdpi discover`: searches for missing effects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import DataArgument, OutOption, VerboseOption
from rdpi_gym.cli.tables import print_result
from rdpi_gym.face.options import CandidateOptions, DataOptions, SearchOptions
from rdpi_gym.support.progress import progress_bar

FINISHED = "candidates.jsonl"
"""File in the folder of results that keeps finished candidates: an interrupted run goes on."""


def carry_out(
    search: Callable[..., rg.SearchResult],
    data: Path,
    reading: DataOptions,
    options: SearchOptions,
    out: Path,
    file_name: str,
    verbose: bool,
) -> None:
    """Read the data, search, write what is found, print it with the page's path.

    A model that was found is saved as ``model.json`` beside the JSON file of `file_name`.
    """
    written: list[Path] = []
    with progress_bar() as show:
        show("reading", 0, 0)
        records = rg.load(data, **vars(reading))
        asked = replace(options, resume=out / FINISHED, progress=show)
        found = search(records, **vars(asked))
        if found.kind != "diagnosis":
            written.append(found.plant.save(out / "model.json"))
        written.append(found.to_json(out / file_name))
        show("drawing", 0, 0)
        written.append(found.page(out / "report.html"))
    print_result(found, records, written, verbose, found.overview_title)


def diagnose(
    data: DataArgument,
    search: CandidateOptions,
    reading: DataOptions,
    out: OutOption = Path("results/diagnose"),
    verbose: VerboseOption = False,
) -> None:
    """Rank the effects that a model may miss, each refitted with it, by the error on validation records.

    Writes diagnosis.json and the page report.html; an interrupted run continues.
    """
    carry_out(rg.diagnose, data, reading, search, out, "diagnosis.json", verbose)


def add(
    effect: Annotated[
        str,
        typer.Argument(
            metavar="EFFECT",
            help="Name of an effect, see `rdpi effects`; unknown is a free block that the records "
            "teach, and module:Class an effect of your own.",
            show_default=False,
        ),
    ],
    data: DataArgument,
    search: SearchOptions,
    reading: DataOptions,
    out: OutOption = Path("results/add"),
    verbose: VerboseOption = False,
) -> None:
    """Add an effect to a model, refit everything, and show the error before and after.

    Writes model.json, add.json and the page report.html.
    """
    carry_out(partial(rg.add, effect), data, reading, search, out, "add.json", verbose)


def discover(
    data: DataArgument,
    search: CandidateOptions,
    reading: DataOptions,
    out: OutOption = Path("results/discover"),
    verbose: VerboseOption = False,
) -> None:
    """Search for the set of effects that is missing, each set refitted whole.

    Writes model.json, discovery.json and the page report.html; an interrupted run continues.
    """
    carry_out(rg.discover, data, reading, search, out, "discovery.json", verbose)
