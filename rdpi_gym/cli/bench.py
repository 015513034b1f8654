"""`rdpi bench` and `rdpi reproduce`: scores of controllers, and the paper beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import OutOption, SeedOption, words
from rdpi_gym.cli.tables import print_table
from rdpi_gym.cli.tasks import (
    TASKS_HELP,
    DrawsOption,
    SeedFileOption,
    print_scores,
    refuse_failures,
)
from rdpi_gym.support.command_line import check_jobs
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import progress_bar

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import pandas as pd

_LEGEND = (
    "RMSE: geometric mean over all cases, in percent of the reference's peak to peak, with its 95 % "
    "interval over the drawn truths. = marks a tie: the 95 % interval of the paired difference "
    "includes zero. Status: rows with each warning."
)

_SEEDS, _FULL = 5, 100


def bench(
    out: OutOption = Path("results/bench"),
    seeds: Annotated[
        int, typer.Option("--seeds", min=1, help="Number of seeds; seed 0 is the nominal plant.")
    ] = _SEEDS,
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
            "package names, or a trained policy, guarded:FOLDER with a monitor; may be repeated.",
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
    belief: Annotated[
        str | None,
        typer.Option(
            "--belief",
            metavar="FILE|NAME",
            help="What controllers are told of the one plant that is scored, of any kind of hysteresis; "
            "by default the plant itself.",
        ),
    ] = None,
    task: Annotated[
        str | None,
        typer.Option("--task", metavar="NAME,...", help=f"In place of those: {TASKS_HELP}"),
    ] = None,
    full: Annotated[
        bool,
        typer.Option("--full", help="In place of those: every task, with 100 plants each."),
    ] = False,
    draws: DrawsOption = None,
    seed_file: SeedFileOption = None,
) -> None:
    """Rank controllers by their tracking error; an interrupted run continues.

    A run of all controllers, plants, references and sampling times also scores plants with hidden
    effects, by what is believed of them. With --task or --full the registered tasks are scored
    instead: stages with their own plants, references and protocol.
    """
    own = controller or []
    if task is not None or full:
        others = {"--plants": plants, "--references": references, "--ts": ts, "--plant": plant,
                  "--belief": belief, "--seeds": seeds if seeds != _SEEDS else None,
                  "--seed": seed or None}  # fmt: skip
        _bench_tasks(task, full, draws, seed_file, words(controllers), own, out, jobs, ray, others)
        return
    if draws is not None or seed_file is not None:
        raise InputError(
            "--draws and --seed-file are of registered tasks; give --task NAME or --full with them"
        )
    with progress_bar() as show:
        scores = rg.benchmark(
            words(controllers),
            words(plants),
            words(references),
            None if ts is None else [_seconds(word) for word in ts.split(",")],
            range(seed, seed + seeds),
            own_controllers=own,
            own_plants=plant or (),
            belief=belief,
            out=out,
            jobs=jobs,
            ray=ray,
            progress=show,
        )
        show("drawing", 0, 0)
        leaderboard = scores.write(out)
        page = scores.page(out / "report.html")
    print(scores.answer)
    for title, table in scores.leaders(own).items():
        print_table(table, title)
    print(_LEGEND)
    print(f"{scores.finished} rows, {scores.computed} of them computed now")
    for note in (*scores.run_notes, *scores.notes):
        print(note)
    if scores.measured.table.empty:
        print(scores.measured.note)
    print(f"leaderboard: {leaderboard}")
    print(f"page: {page}")
    _refuse_errors(scores.table, own)


def _bench_tasks(
    task: str | None,
    full: bool,
    draws: int | None,
    seed_file: Path | None,
    controllers: list[str] | None,
    own: list[str],
    out: Path,
    jobs: int,
    ray: str | None,
    others: Mapping[str, object],
) -> None:
    """Score the registered tasks."""
    given = [name for name, value in others.items() if value is not None]
    if given:
        raise InputError(
            f"{given[0]} is not for registered tasks, which have plants and references of their own; leave it out"
        )
    if full and task is not None:
        raise InputError("--full is every task; leave --task out")
    if draws is None and full:
        draws = _FULL
    with progress_bar() as show:
        scores = rg.score_tasks(
            controllers,
            ["all"] if full else words(task) or (),
            **({} if draws is None else {"plants": draws}),
            own_controllers=own,
            seed_file=seed_file,
            out=out,
            jobs=jobs,
            ray=ray,
            progress=show,
        )
    print_scores(scores, own, out)
    refuse_failures(scores, own)


def _refuse_errors(table: pd.DataFrame, own: Sequence[str]) -> None:
    """End with an error where a controller that the user gave did, now that all else is written."""
    for name in own:
        rows = table.loc[table["controller"] == name]
        failed = rows.loc[rows["rmse_um"].isna(), "status"]  # no numbers: an error
        if not failed.empty:
            raise InputError(
                f"{name} has no score in {len(failed)} of {len(rows)} rows; the first says {failed.iloc[0]!r}"
            )


def _seconds(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f"--ts {word!r} is no number; give seconds, for example 2e-4") from None


def reproduce(
    out: OutOption = Path("results/paper"),
    seed: SeedOption = 0,
    realisations: Annotated[
        int,
        typer.Option(
            min=2, help="Realisations of each compensator whose own rate may make it chatter."
        ),
    ] = 16,
) -> None:
    """Recompute the paper's figures and numbers, ours beside the paper's.

    Writes paper.md with its figures, paper.csv, sweep.csv and implementation.csv.
    """
    with progress_bar() as show:
        results = rg.reproduce(seed=seed, realisations=realisations, progress=show)
        show("figures", 0, 0)
        page = results.write(out)
    print(results)
    rows = len(results.to_dataframe())
    print(f"{page}: the paper's figures and numbers beside ours; {rows} rows in paper.csv")
