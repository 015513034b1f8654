"""What `rdpi diagnose`, `rdpi add` and `rdpi discover` share: options, progress, printed tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from rdpi_gym.errors import InputError

if TYPE_CHECKING:
    from rdpi_gym.diagnosis.results import Diagnosis, Discovery, Errors, Finding
    from rdpi_gym.plant.effects import Effect

CHECKPOINT = "candidates.jsonl"
"""File in the folder of results that keeps finished candidates: an interrupted run goes on."""

EffectOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="MODULE:CLASS",
        help="An effect of your own, tried beside the catalogue; may be repeated.",
    ),
]
JobsOption: TypeAlias = Annotated[
    int, typer.Option("--jobs", help="Processes that refit candidates; -1: one for each core.")
]

Show: TypeAlias = Callable[[str, int, int], None]


def check_jobs(jobs: int) -> int:
    """Return the number of processes, or refuse it.

    Raises
    ------
    InputError
        0, or below -1.

    Examples
    --------
    >>> check_jobs(2)
    2
    """
    if jobs == 0 or jobs < -1:
        raise InputError(f"--jobs is {jobs}; give the number of processes, or -1 for all cores")
    return jobs


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


@contextmanager
def progress_bar() -> Iterator[Show]:
    """Show stages as they finish, on a terminal only; give ``show(stage, done, total)``."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("reading", total=None)

        def show(stage: str, done: int, total: int) -> None:
            bar.update(task, description=stage, completed=done, total=total or None)

        yield show


def print_ranking(candidates: Sequence[Finding], before: Errors) -> None:
    """Print the candidates of a round, best first."""
    from rdpi_gym.report.discovery_words import micrometres

    rows = [
        (
            finding.effect,
            micrometres(finding.errors.validation_rmse_um),
            _percent(finding.share),
            _percent(finding.confidence),
            ", ".join(finding.indistinguishable),
            "; ".join(finding.remarks),
        )
        for finding in candidates
    ]
    _print(
        f"Candidates, refitted; without one {micrometres(before.validation_rmse_um)}",
        ("candidate", "validation", "share", "confidence", "not to be told from", "remarks"),
        rows,
    )


def print_staircase(result: Diagnosis | Discovery) -> None:
    """Print the error from model to model, training and validation."""
    from rdpi_gym.report.discovery_words import micrometres, staircase

    floor = result.noise_floor_um
    rows = [
        (
            name,
            micrometres(errors.train_rmse_um),
            micrometres(errors.validation_rmse_um),
            f"{errors.validation_nrmse_percent:.3g} %",
            f"{errors.validation_rmse_um / floor:.2f}" if floor > 0 else "",
        )
        for name, errors in staircase(result)
    ]
    _print(
        "Error, step by step",
        ("model", "training", "validation", "of the stroke", "times the noise floor"),
        rows,
    )


def print_verdict(result: Diagnosis | Discovery) -> None:
    """Print the verdict, what speaks for each effect, what is left and what to measure next."""
    from rdpi_gym.report.discovery_words import (
        closed,
        confounded_sentence,
        finding_sentence,
        found,
        verdict_sentence,
    )

    print(verdict_sentence(result))
    for finding in found(result):
        print(f"- {finding_sentence(finding)}")
    for sentence in filter(None, [result.remainder, confounded_sentence(result)]):
        print(closed(sentence))
    if result.next_experiment:
        print(f"Next experiment: {result.next_experiment}")


def _percent(share: float) -> str:
    from math import isfinite

    return f"{round(100 * share)} %" if isfinite(share) else ""


def _print(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(title), title_justify="left", box=SIMPLE)
    for i, head in enumerate(heads):
        table.add_column(head, no_wrap=i < len(heads) - 2)
    for row in rows:
        table.add_row(*map(escape, row))
    # without a terminal there is no width to keep to
    Console(width=None if Console().is_terminal else 140, highlight=False).print(table)
