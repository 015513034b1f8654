"""What `rdpi diagnose`, `rdpi add` and `rdpi discover` share: candidates, the work, its files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import progress_bar

if TYPE_CHECKING:
    from pathlib import Path

    from rdpi_gym.diagnosis.results import SearchResult
    from rdpi_gym.measurement import DataOptions
    from rdpi_gym.plant.effects import Effect

CHECKPOINT = "candidates.jsonl"
"""File in the folder of results that keeps finished candidates: an interrupted run goes on."""


@dataclass(frozen=True)
class Work:
    """What a command of the laboratory is asked for.

    Parameters
    ----------
    data, options
        The measurement, and how it is read.
    model
        Plant file or plant's name to start from; None: the bare model is fitted.
    out
        Folder of the results.
    jobs, seed
        Processes that refit candidates; seed of the bootstrap.
    catalogue
        Effects by name.
    """

    data: Path
    options: DataOptions
    model: str | None
    out: Path
    jobs: int
    seed: int
    catalogue: Mapping[str, type[Effect]]

    def carry_out(
        self,
        search: Callable[..., SearchResult],
        file_name: str,
        heading: str,
    ) -> None:
        """Read data and model, search, write what is found, print it with the paths written.

        Parameters
        ----------
        search
            Called as ``search(dataset, given, jobs=, seed=, progress=, checkpoint=)``.
        file_name
            Of the JSON file; a model that was found is saved as ``model.json`` beside it.
        heading
            Of the page ``report.html``; the title of the data follows it.

        Raises
        ------
        InputError
            Data or model cannot be read, or the search refuses them.
        """
        from rdpi_gym.cli.laboratory_tables import print_result
        from rdpi_gym.measurement import load
        from rdpi_gym.plant import find_plant
        from rdpi_gym.report.discovery.page import write_discovery_page

        given = None if self.model is None else find_plant(self.model)
        dataset = load(self.data, self.options)
        written: list[Path] = []
        with progress_bar() as show:
            result = search(
                dataset,
                given,
                jobs=self.jobs,
                seed=self.seed,
                progress=show,
                checkpoint=self.out / CHECKPOINT,
            )
            if result.kind != "diagnosis":
                written.append(result.plant.save(self.out / "model.json"))
            written.append(result.save(self.out / file_name))
            show("drawing", 0, 0)
            title = f"{heading}: {dataset.title}"
            page = self.out / "report.html"
            written.append(write_discovery_page(page, title, result, self.catalogue))
        print_result(result)
        print("", dataset.describe(), sep="\n")
        print("", *written, sep="\n")


def candidates(effects: Sequence[str] | None) -> Mapping[str, type[Effect]]:
    """Return the catalogue with a user's own effects.

    Parameters
    ----------
    effects
        Each as ``module:Class``.

    Raises
    ------
    InputError
        What is named is no effect, or has the name of another.

    Examples
    --------
    >>> "creep" in candidates(None)
    True
    """
    from rdpi_gym.plant.effects import CATALOGUE, load_effect

    known = dict(CATALOGUE)
    for name in effects or ():
        kind = load_effect(name)
        if known.setdefault(kind.name, kind) is not kind:
            raise InputError(
                f"--effect {name} is named {kind.name!r}, as another effect is; rename it"
            )
    return known
