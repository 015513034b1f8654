"""What `rdpi diagnose`, `rdpi add` and `rdpi discover` share: the work, its files, what is printed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import rdpi_gym as rg
from rdpi_gym.cli.tables import print_table
from rdpi_gym.face.options import DataOptions, SearchOptions
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
) -> None:
    """Read the data, search, write what is found, print it with the paths written.

    Parameters
    ----------
    search
        Called with the data set and the options as keywords.
    data, reading
        The measurement, and how it is read.
    options
        Of the search.
    out
        Folder of the results.
    file_name
        Of the JSON file; a model that was found is saved as ``model.json`` beside it.

    Raises
    ------
    InputError
        Data or model cannot be read, or the search refuses them.
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
    print(found)
    print_table(found.overview(), found.overview_title)
    print(records.describe())
    print("", *written, sep="\n")
