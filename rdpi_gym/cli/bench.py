"""`rdpi bench`: scores controllers on reference signals and on measured records."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rdpi_gym.cli.options import OutOption, check_jobs, words
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress, progress_bar
from rdpi_gym.support.terminal import console

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

    from rdpi_gym.report.page import Section

_TOP = 8


def bench(
    out: OutOption = Path("results/bench"),
    seeds: Annotated[
        int, typer.Option("--seeds", min=1, help="Number of seeds; seed 0 is the nominal plant.")
    ] = 5,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The first of them.")] = 0,
    jobs: Annotated[
        int,
        typer.Option(
            "--jobs", help="Worker processes; -1: one for each core.", callback=check_jobs
        ),
    ] = -1,
    ray: Annotated[
        str | None,
        typer.Option(
            "--ray",
            metavar="ADDRESS",
            help="Score on the nodes of a Ray cluster, host:port, in place of --jobs.",
        ),
    ] = None,
    controllers: Annotated[
        str | None,
        typer.Option("--controllers", metavar="NAME,...", help="Baselines; all by default."),
    ] = None,
    plants: Annotated[
        str | None,
        typer.Option("--plants", metavar="NAME,...", help="Plants; by default P5, P10 and picma."),
    ] = None,
    references: Annotated[
        str | None,
        typer.Option("--references", metavar="NAME,...", help="Reference signals; all by default."),
    ] = None,
    ts: Annotated[
        str | None,
        typer.Option("--ts", metavar="SECONDS,...", help="Sampling times; by default the plant's."),
    ] = None,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            "--controller",
            metavar="MODULE:ATTRIBUTE|learned:FOLDER",
            help="A controller of your own, made by a callable (belief, layout), or a trained policy; "
            "may be repeated.",
        ),
    ] = None,
    plant: Annotated[
        list[str] | None,
        typer.Option(
            "--plant",
            metavar="FILE|MODULE:ATTRIBUTE",
            help="A plant of your own: JSON file or PlantModel; may be repeated.",
        ),
    ] = None,
) -> None:
    """Score every baseline on every reference signal; an interrupted run continues.

    A run of all controllers, plants, references and sampling times also scores plants with hidden
    effects, by what is believed of them.
    """
    from benchmarks.tracking.evaluation import evaluate
    from benchmarks.tracking.markdown import (
        METHOD,
        WHERE_TRAINED,
        measured_text,
        plain,
        ranking_view,
    )
    from benchmarks.tracking.results import write_tables
    from benchmarks.tracking.run import benchmark
    from benchmarks.tracking.selection import select
    from rdpi_gym.report.benchmark.page import write_benchmark_page
    from rdpi_gym.report.benchmark.picture import leaderboard_picture
    from rdpi_gym.support.files import write_atomic

    selection = select(
        words(controllers),
        words(plants),
        words(references),
        None if ts is None else [_seconds(word) for word in ts.split(",")],
        range(seed, seed + seeds),
        own_controllers=controller or (),
        own_plants=plant or (),
    )
    everything = controllers is plants is references is ts is None
    with progress_bar() as show:
        outcome = benchmark(selection, out, jobs, show, ray)
        payoff = _payoff(out, jobs, ray, show) if everything else None
    results = evaluate(selection, outcome)
    leaderboard = write_tables(out, results, payoff)
    write_atomic(out / "leaderboard.png", leaderboard_picture(results))
    page = write_benchmark_page(
        out / "report.html",
        results,
        plain(METHOD),
        plain(measured_text(results.measured)),
        WHERE_TRAINED,
        None if payoff is None else _payoff_section(payoff),
    )
    print(f"{len(outcome.rows)} rows, {outcome.computed} of them computed now")
    for note in (*outcome.notes, *results.notes):
        print(note)
    if results.measured.table.empty:
        print(results.measured.note)
    own = controller or []
    _print_top(ranking_view(results.ranking), own)
    for at_s, ranked in results.where_trained.items():
        _print_top(ranking_view(ranked), own, f" at Ts = {at_s:g} s")
    print(f"leaderboard: {leaderboard}")
    print(f"page: {page}")


def _payoff(out: Path, jobs: int, ray: str | None, show: Progress) -> pd.DataFrame:
    """Score the plants with hidden effects, with the beliefs of this release."""
    from benchmarks.payoff.beliefs import stored_beliefs
    from benchmarks.payoff.plants import HIDDEN_PLANTS
    from benchmarks.payoff.scores import payoff_table

    beliefs = {hidden: stored_beliefs(hidden) for hidden in HIDDEN_PLANTS}
    return payoff_table(beliefs, out, jobs=jobs, progress=show, ray_address=ray, note=print)


def _payoff_section(payoff: pd.DataFrame) -> Section:
    from benchmarks.payoff.tables import METHOD, payoff_summary, summary_view
    from benchmarks.tracking.markdown import plain
    from rdpi_gym.report.payoff.figures import payoff_section

    summary = payoff_summary(payoff)
    return payoff_section(summary, summary_view(summary), plain(METHOD))


def _seconds(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f"--ts {word!r} is no number; give seconds, for example 2e-4") from None


def _print_top(ranking: pd.DataFrame, own: Sequence[str], where: str = "") -> None:
    """Print the first of a ranking, and the user's own wherever they stand."""
    from rich.box import SIMPLE
    from rich.table import Table

    from benchmarks.tracking.markdown import number

    shown = ["controller", "RMSE (%)", "RMSE, seed 0 (%)", "mean rank", "command variation"]
    printed = (ranking.index < _TOP) | ranking["controller"].isin(own)
    title = "Ranking"
    if len(ranking) > _TOP:
        yours = ", and yours" if printed.sum() > _TOP else ""
        title = f"The first {_TOP} of {len(ranking)} controllers{yours}"
    title += where
    table = Table(title=title, title_justify="left", box=SIMPLE)
    for name in shown:
        table.add_column(name, no_wrap=True)
    for row in ranking.loc[printed, shown].itertuples(index=False):
        table.add_row(*(number(cell) if isinstance(cell, float) else str(cell) for cell in row))
    console().print(table)
