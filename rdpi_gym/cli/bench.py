"""`rdpi bench`, `rdpi submit`, `rdpi score`, `rdpi reproduce`: scores of controllers, the paper beside ours."""

from __future__ import annotations

import sys
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import rdpi_gym as rg
from rdpi_gym.cli.options import JobsOption, OutOption, SeedOption, VerboseOption, words
from rdpi_gym.cli.tables import print_table
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import LEADING_ROWS
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.words import number, quoted

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import pandas as pd

_LEGEND = (
    "RMSE: geometric mean over all cases, in percent of the reference's peak to peak, with its 95 % "
    "interval over the drawn truths. Rank: one more than the number of controllers that are better "
    "in paired differences. Status: rows with each warning."
)

_TASK_LEGEND = (
    "RMSE in percent of the reference's peak to peak, a plant's mean over its references: 90th "
    "percentile (p90) and mean of the middle half of the plants (IQM), each with its 95 % interval. "
    "Failures decide first, then p90, then IQM; = marks a tie. Over noise: IQM in units of the "
    "sensor's noise."
)

_SEEDS, _FULL = 5, 100
_NAME = 36  # letters of a controller's name, in lines while a run goes on


def bench(
    suite: Annotated[
        str | None,
        typer.Argument(
            metavar="[diagnosis]",
            help="In place of controllers, diagnosers on plants with hidden effects.",
            show_default=False,
        ),
    ] = None,
    out: OutOption = Path("results/bench"),
    seeds: int = _SEEDS,
    seed: int = 0,
    jobs: JobsOption = -1,
    ray: str | None = None,
    controllers: str | None = None,
    plants: str | None = None,
    references: str | None = None,
    ts: str | None = None,
    controller: list[str] | None = None,
    plant: list[str] | None = None,
    belief: str | None = None,
    task: str | None = None,
    full: bool = False,
    draws: int | None = None,
    seed_file: Path | None = None,
    no_bound: bool = False,
    against: Path | None = None,
    among: Path | None = None,
    diagnoser: list[str] | None = None,
    verbose: VerboseOption = False,
) -> None:
    """Rank controllers by their tracking error; an interrupted run continues.

    A run of all controllers, plants, references and sampling times also scores plants with hidden
    effects, by what is believed of them. With --task or --full the registered tasks are scored
    instead: stages with their own plants, references and protocol. The word diagnosis ranks
    diagnosers: what is missing of a model, told from records.

    Parameters
    ----------
    seeds : 1 or more
        Number of seeds; seed 0 is the nominal plant.
    seed : 0 or more
        The first of them.
    ray : ADDRESS
        Score on the nodes of a Ray cluster, host:port, in place of --jobs.
    controllers : NAME,...
        Controllers that ship; all by default.
    plants : NAME,...
        Plants; by default P5, P10 and picma.
    references : NAME,...
        Reference signals; all by default.
    ts : SECONDS,...
        Sampling times; by default the plant's.
    controller : MODULE:ATTRIBUTE|NAME|learned:FOLDER
        A controller of your own, made by a callable (belief, layout), one that an installed package
        names, or a trained policy, guarded:FOLDER with a monitor; may be repeated.
    plant : FILE|MODULE:ATTRIBUTE
        A plant of your own: JSON file or PlantModel; may be repeated.
    belief : FILE|NAME
        What controllers are told of the one plant that is scored, of any kind of hysteresis; by
        default the plant itself.
    task : NAME,...
        In place of those: Short names or ids of tasks, for example Stage,Load; all: every one.
    full
        In place of those: every task, with 100 plants each.
    draws : 1 or more
        Test plants of each task, or of the diagnosis; 20 by default.
    seed_file : FILE
        A file with the seed of the test plants, one whole number; else the public seed. With it
        controllers run in processes of their own.
    no_bound
        Of tasks: without the entries that know more than a controller may.
    against : FILE
        Of tasks: task-rows.csv.gz of a table; says how many rows are as it states them.
    among : FOLDER
        Of tasks: a table; ranks with its other controllers, whose rows stay as they are.
    diagnoser : NAME|MODULE:ATTRIBUTE
        Of the diagnosis: one that ships, or one of your own, a callable (dataset); may be repeated,
        by default all that ship.
    """
    own = controller or []
    if suite is not None:
        if suite != "diagnosis":
            raise InputError(f"{quoted(suite)} is no suite; give diagnosis, or leave it out")
        others = {"--controllers": controllers, "--controller": controller, "--plants": plants,
                  "--references": references, "--ts": ts, "--plant": plant, "--belief": belief,
                  "--task": task, "--full": full or None, "--no-bound": no_bound or None,
                  "--against": against, "--among": among,
                  "--seeds": seeds if seeds != _SEEDS else None, "--seed": seed or None}  # fmt: skip
        _bench_diagnosis(diagnoser or [], draws, seed_file, out, jobs, ray, others)
        return
    if diagnoser:
        raise InputError("--diagnoser is of rdpi bench diagnosis; give that word")
    if task is not None or full:
        others = {"--plants": plants, "--references": references, "--ts": ts, "--plant": plant,
                  "--belief": belief, "--seeds": seeds if seeds != _SEEDS else None,
                  "--seed": seed or None}  # fmt: skip
        _bench_tasks(
            task, full, draws, seed_file, words(controllers), own, out, jobs, ray, others,
            not no_bound, against, among,
        )  # fmt: skip
        return
    if draws is not None or seed_file is not None or no_bound or against or among:
        raise InputError(
            "--draws, --seed-file, --no-bound, --against and --among are of registered tasks; give --task NAME or --full with them"
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
            told=partial(_tell, count() if verbose else iter(range(LEADING_ROWS))),
        )
        show("drawing", 0, 0)
        leaderboard = scores.write(out)
        page = scores.page(out / "report.html")
    print(scores.answer)
    tables = scores.leaders(own, most=len(scores.order) if verbose else LEADING_ROWS)
    for title, table in list(tables.items())[: None if verbose or own else 1]:
        print_table(table, title)
    print(_LEGEND)
    print(f"{scores.finished} rows, {scores.computed} of them computed now")
    for note in scores.run_notes:
        print(note)
    if verbose:
        for note in (
            *scores.notes,
            *([scores.measured.note] if scores.measured.table.empty else []),
        ):
            print(note)
    print(f"leaderboard: {leaderboard}")
    print(f"page: {page}")
    _refuse_errors(scores.table, own)


def _tell(lines: Iterator[int], controller: str, errors: Mapping[str, float]) -> None:
    """Print what a controller reached on each plant as soon as it is known, while there are lines."""
    if next(lines, None) is not None:
        reached = "".join(f"  {plant} {number(error)} %" for plant, error in errors.items())
        print(f"{controller:<{_NAME}}{reached}", file=sys.stderr, flush=True)


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
    bound: bool,
    against: Path | None,
    among: Path | None,
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
            bound=bound,
            against=against,
            among=among,
        )
    _print_scores(scores, own, out)
    _refuse_failures(scores, own)


def _bench_diagnosis(
    diagnosers: list[str],
    draws: int | None,
    seed_file: Path | None,
    out: Path,
    jobs: int,
    ray: str | None,
    others: Mapping[str, object],
) -> None:
    """Score diagnosers on plants with hidden effects."""
    given = [name for name, value in others.items() if value is not None]
    if given:
        raise InputError(f"{given[0]} is not for rdpi bench diagnosis; leave it out")
    drawn = {} if draws is None else {"plants": draws}
    with progress_bar() as show:
        scores = rg.score_diagnosers(
            diagnosers, **drawn, seed_file=seed_file, out=out, jobs=jobs, progress=show, ray=ray
        )
    page = scores.write(out)
    print(scores.answer)
    print_table(scores.ranking(), f"diagnosis: {scores.seen}")
    print(scores.legend)
    print(f"{len(scores.rows)} rows, {scores.computed} of them computed now")
    for note in scores.notes:
        print(note)
    print(f"tables: {page}")
    for name in diagnosers:
        reason = scores.refusal(name)
        if reason is not None:
            raise InputError(f"{name} has no score on any plant; the first row says {reason!r}")


def _print_scores(scores: rg.TaskScores, own: Sequence[str], out: Path) -> None:
    """Print the first of each task, write all tables, and say where they are."""
    page = scores.write(out)
    print(scores.answer)
    for task in scores.tasks:
        print_table(scores.leaders(task, own), f"{task}: {scores.seen}")
    print(_TASK_LEGEND)
    print(f"{len(scores.rows)} rows, {scores.computed} of them computed now")
    for note in scores.notes:
        print(note)
    print(f"tables: {page}")


def _refuse_failures(scores: rg.TaskScores, own: Sequence[str]) -> None:
    """End with an error where a controller that the user gave raised one on every plant."""
    for name in own:
        said = [str(row["failure"]) for row in scores.rows if row["controller"] == name]
        if said and all(reason.startswith(("error", "too slow")) for reason in said):
            raise InputError(f"{name} has no score on any plant; the first row says {said[0]!r}")


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


def score(
    folder: Path,
    out: OutOption = Path("results/score"),
    seed_file: Path | None = None,
    draws: int | None = None,
    no_bound: bool = False,
    jobs: JobsOption = -1,
) -> None:
    """Score a submission in a process of its own; with --seed-file on plants that nobody has seen.

    Parameters
    ----------
    folder : FOLDER
        As rdpi submit leaves it; its code is run.
    seed_file : FILE
        A file with the seed of the test plants, one whole number; else the public seed.
    draws : 1 or more
        Test plants of each task, as many as were submitted by default and at most.
    no_bound
        Without the entries that know more than a controller may.
    """
    with progress_bar() as show:
        scores = rg.score_submission(
            folder, seed_file=seed_file, out=out, jobs=jobs, progress=show, plants=draws,
            bound=not no_bound,
        )  # fmt: skip
    _print_scores(scores, [], out)


def submit(
    controller: str,
    out: OutOption = Path("results/submission"),
    task: str = "Stage",
    draws: int | None = None,
    jobs: JobsOption = -1,
) -> None:
    """Score a controller on public plants, and put what a leaderboard needs into a folder.

    Parameters
    ----------
    controller : NAME|MODULE:ATTRIBUTE|learned:FOLDER
        A controller: one that ships, one of your own in a single file, or a trained policy.
    task : NAME,...
        Short names or ids of tasks, for example Stage,Load; all: every one.
    draws : 1 or more
        Test plants of each task; 20 by default.
    """
    given = {} if draws is None else {"plants": draws}
    with progress_bar() as show:
        scores = rg.submit(controller, out, words(task) or (), **given, jobs=jobs, progress=show)
    _print_scores(scores, [controller], out)
    print(f"submission: {out / 'submission.json'}")
    _refuse_failures(scores, [controller])


def reproduce(
    out: OutOption = Path("results/paper"),
    seed: SeedOption = 0,
    realisations: int = 16,
) -> None:
    """Recompute the paper's figures and numbers, ours beside the paper's.

    Writes paper.md with its figures, paper.csv, sweep.csv and implementation.csv.

    Parameters
    ----------
    realisations : 2 or more
        Realisations of each compensator whose own rate may make it chatter.
    """
    with progress_bar() as show:
        results = rg.reproduce(seed=seed, realisations=realisations, progress=show)
        show("figures", 0, 0)
        page = results.write(out)
    print(results)
    rows = len(results.to_dataframe())
    print(f"{page}: the paper's figures and numbers beside ours; {rows} rows in paper.csv")
