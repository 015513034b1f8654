"""What `rdpi diagnose`, `rdpi add` and `rdpi discover` print: the answer, then its tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rdpi_gym.support.terminal import console

if TYPE_CHECKING:
    from rdpi_gym.diagnosis.results import Candidate, Errors, SearchResult


def print_result(result: SearchResult) -> None:
    """Print the answer, how sure it is and what is left, then the table that it stands on."""
    from rdpi_gym.report.discovery.sentences import lines

    print(*lines(result), sep="\n")
    if result.kind == "diagnosis":
        _print_ranking(result.candidates, result.base)
    else:
        _print_staircase(result)
    print(*result.notes, sep="\n")


def _print_ranking(candidates: Sequence[Candidate], before: Errors) -> None:
    """Print the candidates of a round, best first."""
    from rdpi_gym.support.words import micrometres

    rows = [
        (
            candidate.effect,
            micrometres(candidate.errors.validation_rmse_um),
            _percent(candidate.share),
            _percent(candidate.confidence),
            ", ".join(candidate.indistinguishable),
            "; ".join(candidate.remarks),
        )
        for candidate in candidates
    ]
    _print_table(
        f"Candidates, refitted; without one {micrometres(before.validation_rmse_um)}",
        ("candidate", "validation", "share", "confidence", "indistinguishable from", "remarks"),
        rows,
    )


def _print_staircase(result: SearchResult) -> None:
    """Print the error from model to model, training and validation."""
    from rdpi_gym.report.discovery.sentences import staircase
    from rdpi_gym.support.words import micrometres

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
    _print_table(
        "Error, step by step",
        ("model", "training", "validation", "of the stroke", "times the noise floor"),
        rows,
    )


def _percent(share: float) -> str:
    return f"{round(100 * share)} %" if math.isfinite(share) else ""


def _print_table(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    from rich.box import SIMPLE
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(title), title_justify="left", box=SIMPLE)
    for i, head in enumerate(heads):
        table.add_column(head, no_wrap=i < len(heads) - 2)
    for row in rows:
        table.add_row(*map(escape, row))
    # without a terminal there is no width to keep to
    console().print(table)
