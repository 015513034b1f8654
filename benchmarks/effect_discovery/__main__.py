"""Discovery of hidden effects: data sets with known truth, diagnosed and counted.

    python -m benchmarks.effect_discovery --truth independent --studies single,pairs --jobs 2
    python -m benchmarks.effect_discovery --truth foreign --seed 2026 --jobs 16

The independent truth is the virtual lab's: effects of the catalogue on plants like P10. The foreign
truth has other plants, forms and protocols; its seed 0 is for tuning, what is published has another.

An interrupted run continues from the rows that it has written. Rows of changed code are set aside.
With ``--part 1/2`` every second case is run. With ``--tables`` nothing is run, and the tables are
written from the rows that are there. With ``--ray ADDRESS`` the nodes of a Ray cluster diagnose the
cases; the rows are written here. ``python -m benchmarks.hidden_effects`` and ``python -m
benchmarks.foreign_effects`` are this command with one truth or the other.
"""

from __future__ import annotations

import re
import sys
from argparse import SUPPRESS, Namespace
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.effect_discovery.cases import (
    Engine,
    Source,
    discover_engine,
    run_case,
    study_fingerprint,
)
from benchmarks.effect_discovery.foreign import FOREIGN
from benchmarks.effect_discovery.independent import INDEPENDENT
from benchmarks.effect_discovery.report import REPORTS
from benchmarks.rows import run_rows, stored_rows
from rdpi_gym.support.checks import unknown_name
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.store import Row
from rdpi_gym.support.words import quoted

C = TypeVar("C")
SOURCES = {source.module: source for source in (INDEPENDENT, FOREIGN)}


def main(
    arguments: Sequence[str] | None = None,
    source: Source | None = None,
    engine: Engine = discover_engine,
) -> int:
    """Run the study, print its targets, and write its tables."""
    return options(source).run(arguments, partial(_study, source=source, engine=engine))


def options(source: Source | None = None) -> Options:
    """Return the options of the command, or of its alias with one source of truth."""
    name = "effect_discovery" if source is None else source.command
    found = Options(name, __doc__, seed=0, jobs=2, ray=True)
    if source is None:
        found.add_argument("--truth", choices=list(SOURCES), default=INDEPENDENT.module)
    found.add_folder(
        "--out", None if source is None else source.out, "folder that results are written to"
    )
    found.add_argument("--studies", metavar="NAMES", help="of single, none, ...")
    found.add_argument("--study", metavar="NAMES", help="another name of --studies")
    found.add_number("--plants", None, "for each subject, or of each study")
    found.add_number("--per", None, SUPPRESS)  # another name of --plants
    found.add_argument("--effects", metavar="NAMES", help="effects to hide")
    found.add_argument("--part", default="1/1", help="run one part of the cases, such as 1/2")
    found.add_argument(
        "--tables", action="store_true", help="write the tables of the rows in --out; run nothing"
    )
    return found


def part_of(cases: Sequence[C], part: str) -> list[C]:
    """Return every n-th case, from the k-th on, of ``k/n``."""
    stated = re.fullmatch(r"(\d{1,6})/(\d{1,6})", part)
    if stated is None or not 1 <= int(stated[1]) <= int(stated[2]):
        raise InputError(f"--part is {quoted(part)}; give which part of how many, for example 1/2")
    return list(cases[int(stated[1]) - 1 :: int(stated[2])])


def _study(asked: Namespace, source: Source | None, engine: Engine) -> None:
    source = SOURCES[asked.truth] if source is None else source
    out = source.out if asked.out is None else asked.out
    rows, report = _rows(asked, source, out, engine), REPORTS[source.module]
    for target in report.targets(rows):
        print(target.line())
    page = write_atomic(out / f"{source.command}.md", report.page(rows, source.command))
    write_atomic(out / "by_subject.csv", report.by_subject(rows).to_csv(index=False))
    write_atomic(out / "cases.csv", report.case_table(rows).to_csv(index=False))
    print(f"tables: {page}")


def _rows(asked: Namespace, source: Source, out: Path, engine: Engine) -> list[Row]:
    option, given = _either(asked, "--studies", "--study")
    studies = _names(given, option, tuple(source.numbers))
    effects = _names(asked.effects, "--effects", source.effects)
    _, plants = _either(asked, "--plants", "--per")
    cases = part_of(source.cases(studies, plants, asked.seed, effects), asked.part)
    if asked.tables:
        return stored_rows(cases, out)
    code = study_fingerprint(source.module)
    run = partial(run_case, source=source, engine=engine)
    with progress_bar() as show:
        return run_rows(cases, out, run, code, asked.jobs, show, ray_address=asked.ray)


def _either(asked: Namespace, *options: str) -> tuple[str, Any]:
    """Return which of the names of one option was given, and its value."""
    given = [(each, getattr(asked, each.lstrip("-"))) for each in options]
    given = [(each, value) for each, value in given if value is not None]
    if len(given) > 1:
        raise InputError(f"{' and '.join(options)} are names of one option; give one of them")
    return given[0] if given else (options[0], None)


def _names(given: str | None, option: str, known: Sequence[str]) -> list[str]:
    names = list(known) if given is None else given.split(",")
    for name in names:
        if name not in known:
            raise unknown_name(option, name, known)
    return names


if __name__ == "__main__":
    sys.exit(main())
