"""Command line of the study of trained agents, stage by stage."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

import studies.agents
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic, write_json
from rdpi_gym.support.progress import progress_bar
from studies.agents.page import FILE, page_texts, take_walk, walk_template
from studies.agents.scores import GAP, GROUPS, Run, World, contestants, score_all, with_literal
from studies.agents.tables import (
    PICTURE,
    agents_text,
    curves_text,
    gap_summary,
    gap_text,
    learning_bands,
    learning_curves,
    learning_picture,
    summarise,
)
from studies.agents.training import BASELINE, FULL, QUICK, Study, Training, all_trainings, train_all
from studies.chromium import small_png

_ROOT = Path(__file__).parents[2]
OUT, DOCS = _ROOT / "studies" / "results" / "agents", _ROOT / "docs"
POLICIES = _ROOT / "baselines" / "learned" / "policies"
RUNS, QUICK_RUNS = Path("results/agents"), Path("results/agents-quick")
STAGES = ("train", "score", "gap", "curves")
BY_NAME = ("ship", "teach", "walk", "page")


def main(arguments: Sequence[str] | None = None) -> int:
    """Do one stage of the study, or all."""
    options = Options("agents", studies.agents.__doc__, jobs=-1, ray=True)
    options.add_folder("--out", None, "folder for tables")
    options.add_argument("--stage", choices=(*STAGES, "all", *BY_NAME), default="all")
    options.add_folder(
        "--runs", None,
        "folder of the trainings and finished rows; with --ray, one that every node sees",
    )  # fmt: skip
    options.add_argument("--quick", action="store_true", help="every step, tiny; learns nothing")
    return options.run(arguments, _run)


def _run(options: Namespace) -> None:
    study = QUICK if options.quick else FULL
    # a quick run must not take the place of published tables, policies and pages
    options.out = options.out or (QUICK_RUNS / "tables" if options.quick else OUT)
    options.runs = options.runs or (QUICK_RUNS if options.quick else RUNS)
    for stage in STAGES if options.stage == "all" else (options.stage,):
        _STAGES[stage](study, options)


def _train(study: Study, options: Namespace) -> None:
    with progress_bar() as show:
        fresh = train_all(study, options.runs, options.jobs, show, options.ray)
    print(f"{fresh} trained now, {len(all_trainings(study, options.runs))} in all: {options.runs}")


def _score(study: Study, options: Namespace) -> None:
    trained, table = _scores(study, GROUPS, options)
    summary = summarise(table, study.resamples)
    _write(options.out / "scores.csv", table)
    _write(options.out / "summary.csv", summary)
    _write(options.out / "trainings.csv", trained)
    print(f"table: {write_atomic(options.out / 'agents.md', agents_text(study, summary, trained))}")


def _gap(study: Study, options: Namespace) -> None:
    worlds = [world for name in study.domains for world in with_literal(GAP[name])]
    trained, table = _scores(study, worlds, options)
    summary = gap_summary(table, study.resamples)
    _write(options.out / "gap-scores.csv", table)
    _write(options.out / "gap.csv", summary)
    print(f"table: {write_atomic(options.out / 'gap.md', gap_text(study, summary, trained))}")


def _curves(study: Study, options: Namespace) -> None:
    curves = learning_curves(_finished(study, options.runs))
    level = float(curves["compensator_rmse_um"].median())
    picture = learning_picture(learning_bands(curves), BASELINE, level)
    _write(options.out / "curves.csv", curves)
    write_atomic(options.out / PICTURE, small_png(picture))
    print(f"curves: {write_atomic(options.out / 'curves.md', curves_text(curves))}")


def _ship(study: Study, options: Namespace) -> None:
    try:
        from studies.agents.shipping import ship
    except ImportError as error:
        raise InputError(f"shipping needs {error.name}; install rdpi-gym[rl]") from error
    scores = options.out / "scores.csv"
    if not scores.exists():
        raise InputError(f"{scores} is missing; run --stage score")
    target = options.runs / "policies" if study is QUICK else POLICIES
    shipped = ship(pd.read_csv(scores), _finished(study, options.runs), target)
    _write(options.out / "shipped.csv", shipped)
    for one in shipped[shipped["ships"]].itertuples():
        print(
            f"{target / str(one.agent)}: seed {one.seed}, the median of {one.trainings} trainings"
        )


def _teach(study: Study, options: Namespace) -> None:
    from studies.agents.shipping import teach  # torch, only where needed

    policies = options.runs / "policies" if study is QUICK else POLICIES
    for each in study.taught:
        with progress_bar() as show:
            print(f"policy: {teach(each, options.runs, policies, show)}")


def _walk(study: Study, options: Namespace) -> None:
    walk = take_walk(walk_template(study))
    print(f"{walk['seconds']:.0f} s: {write_json(options.out / FILE, walk)}")


def _page(study: Study, options: Namespace) -> None:
    folder = options.out / "docs" if study is QUICK else DOCS
    for name, text in page_texts(study, options.out).items():
        print(f"page: {write_atomic(folder / f'{name}.md', text)}")


_STAGES: dict[str, Callable[[Study, Namespace], None]] = {
    "train": _train,
    "score": _score,
    "gap": _gap,
    "curves": _curves,
    "ship": _ship,
    "teach": _teach,
    "walk": _walk,
    "page": _page,
}


def _scores(
    study: Study, worlds: Sequence[World], options: Namespace
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Score the compensators and the trainings that are finished."""
    finished = _finished(study, options.runs)
    rows = [each.row() for each in finished]
    runs = [
        Run(one, world, study.plants, study.references)
        for one in contestants(study.rivals, finished)
        for world in worlds
    ]
    with progress_bar() as show:
        table = score_all(runs, options.runs, options.jobs, show, options.ray, _note)
    table["training_seed"] = table["training_seed"].astype("Int64")
    return pd.DataFrame(rows).astype({"seconds": float}), table


def _note(sentence: str) -> None:
    print(sentence, file=sys.stderr)


def _finished(study: Study, runs: Path) -> list[Training]:
    found = [each for each in all_trainings(study, runs.absolute()) if each.is_finished()]
    if not found:
        raise InputError(
            f"{runs} holds no finished training; run --stage train, or give its folder as --runs"
        )
    return found


def _write(path: Path, table: pd.DataFrame) -> None:
    write_atomic(path, table.to_csv(index=False, float_format="%.6g", lineterminator="\n"))


if __name__ == "__main__":
    sys.exit(main())
