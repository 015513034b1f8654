"""`rdpi bench`: scores controllers on reference signals and on measured records."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rdpi_gym.cli.options import OutOption, words
from rdpi_gym.support.command_line import check_jobs
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress, progress_bar
from rdpi_gym.support.terminal import console

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

    from rdpi_gym.report.page import Section

_TOP = 8
_SHOWN = ("rank", "controller", "RMSE (%)", "RMSE (µm)", "status")
_LEGEND = (
    "RMSE: geometric mean over all cases, in percent of the reference's peak to peak, with its 95 % "
    "interval over the drawn truths. = marks a tie: the 95 % interval of the paired difference "
    "includes zero. Status: rows with each warning."
)


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
        typer.Option(
            "--controllers", metavar="NAME,...", help="Controllers that ship; all by default."
        ),
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
            metavar="MODULE:ATTRIBUTE|NAME|learned:FOLDER",
            help="A controller of your own, made by a callable (belief, layout), one that an installed "
            "package names, or a trained policy; may be repeated.",
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
    """Rank controllers by their tracking error; an interrupted run continues.

    A run of all controllers, plants, references and sampling times also scores plants with hidden
    effects, by what is believed of them.
    """
    from benchmarks.tracking.evaluation import evaluate
    from benchmarks.tracking.markdown import (
        METHOD,
        WHERE_TRAINED,
        answer,
        measured_text,
    )
    from benchmarks.tracking.results import write_tables
    from benchmarks.tracking.run import benchmark
    from benchmarks.tracking.selection import select
    from rdpi_gym.report.benchmark.page import write_benchmark_page
    from rdpi_gym.report.benchmark.picture import leaderboard_picture
    from rdpi_gym.support.files import write_atomic
    from rdpi_gym.support.markdown import plain

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
    own = controller or []
    print(answer(results))
    for at_s, ranked in ((None, results.ranking), *results.where_trained.items()):
        if not ranked.empty:
            _print_top(ranked, own, "" if at_s is None else f" at Ts = {at_s:g} s")
    print(_LEGEND)
    print(f"{len(outcome.rows)} rows, {outcome.computed} of them computed now")
    for note in (*outcome.notes, *results.notes):
        print(note)
    if results.measured.table.empty:
        print(results.measured.note)
    print(f"leaderboard: {leaderboard}")
    print(f"page: {page}")
    _refuse_errors(results.table, own)


def _refuse_errors(table: pd.DataFrame, own: Sequence[str]) -> None:
    """End with an error where a controller that the user gave did, now that all else is written."""
    for name in own:
        rows = table.loc[table["controller"] == name, "status"]
        failed = rows[rows.str.startswith("error")]
        if not failed.empty:
            raise InputError(
                f"{name} has no score in {len(failed)} of {len(rows)} rows; the first says {failed.iloc[0]!r}"
            )


def _payoff(out: Path, jobs: int, ray: str | None, show: Progress) -> pd.DataFrame:
    """Score the plants with hidden effects, with the beliefs of this release."""
    from benchmarks.payoff.beliefs import stored_beliefs
    from benchmarks.payoff.plants import HIDDEN_PLANTS
    from benchmarks.payoff.scores import payoff_table

    beliefs = {hidden: stored_beliefs(hidden) for hidden in HIDDEN_PLANTS}
    return payoff_table(beliefs, out, jobs=jobs, progress=show, ray_address=ray, note=print)


def _payoff_section(payoff: pd.DataFrame) -> Section:
    from benchmarks.payoff.tables import METHOD, payoff_summary, summary_view
    from rdpi_gym.report.payoff.figures import payoff_section
    from rdpi_gym.support.markdown import plain

    summary = payoff_summary(payoff)
    return payoff_section(summary, summary_view(summary), plain(METHOD))


def _seconds(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f"--ts {word!r} is no number; give seconds, for example 2e-4") from None


def _print_top(ranked: pd.DataFrame, own: Sequence[str], where: str = "") -> None:
    """Print the first of a ranking, its bound, and the user's own wherever they stand."""
    from rich.box import SIMPLE
    from rich.table import Table
    from rich.text import Text

    from benchmarks.tracking.markdown import ranking_view
    from rdpi_gym.support.words import number

    bound = ranked["rank"] == "bound"
    first = (~bound).cumsum() <= _TOP
    printed = (first & ~bound) | bound | ranked["controller"].isin(own)
    title, rivals = "Ranking", int((~bound).sum())
    if rivals > _TOP:
        yours = ", and yours" if (printed & ~bound).sum() > _TOP else ""
        title = f"The first {_TOP} of {rivals} controllers{yours}"
    table = Table(title=title + where, title_justify="left", box=SIMPLE)
    for name in _SHOWN:
        table.add_column(name, no_wrap=name != "status", overflow="fold")
    for row in ranking_view(ranked).loc[printed, list(_SHOWN)].itertuples(index=False):
        table.add_row(*(Text(number(x) if isinstance(x, float) else str(x)) for x in row))
    console().print(table)
