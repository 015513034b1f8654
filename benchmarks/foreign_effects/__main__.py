"""Who finds effects elsewhere: foreign plants, forms and protocols, diagnosed and counted.

    python -m benchmarks.foreign_effects --seed 2026 --studies single,double --jobs 16

Seed 0 is for tuning; what is published has another. An interrupted run continues from the rows
that it has written; rows of changed code are set aside. With ``--part 1/2`` every second case is
run. With ``--tables`` nothing is run, and the tables are written from the rows that are there.
"""

from __future__ import annotations

import re
import sys
from argparse import Namespace
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmarks.foreign_effects.case_row import run_case
from benchmarks.foreign_effects.cases import NUMBERS, Case, make_cases
from benchmarks.foreign_effects.scoring import judgements
from benchmarks.foreign_effects.summary import as_markdown, shares, targets
from benchmarks.hidden_effects.case_row import Engine, discover_engine, study_fingerprint
from benchmarks.hidden_effects.run import run_rows, stored_rows
from rdpi_gym.measurement.options import unknown_name
from rdpi_gym.support.command_line import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.store import Row
from rdpi_gym.support.words import quoted

OUT = Path("studies/results/foreign")


def main(arguments: Sequence[str] | None = None, engine: Engine = discover_engine) -> int:
    """Run the study, print its targets, and write its tables."""
    return options().run(arguments, partial(_study, engine=engine))


def options() -> Options:
    """Return what the command can be asked for."""
    found = Options("foreign_effects", __doc__, out=OUT, seed=0, jobs=2, ray=True)
    found.add_argument("--studies", default=",".join(NUMBERS), help="of single, double, none, ...")
    found.add_number("--per", None, f"plants of each study; by default {NUMBERS}")
    found.add_argument("--part", default="1/1", help="run one part of the cases, such as 1/2")
    found.add_argument(
        "--tables", action="store_true", help="write the tables of the rows in --out; run nothing"
    )
    return found


def part_of(cases: Sequence[Case], part: str) -> list[Case]:
    """Return every n-th case, from the k-th on, of ``k/n``."""
    stated = re.fullmatch(r"(\d{1,6})/(\d{1,6})", part)
    if stated is None or not 1 <= int(stated[1]) <= int(stated[2]):
        raise InputError(f"--part is {quoted(part)}; give which part of how many, for example 1/2")
    return list(cases[int(stated[1]) - 1 :: int(stated[2])])


def _study(asked: Namespace, engine: Engine) -> None:
    rows = _rows(asked, engine)
    _write(asked.out, rows)
    for target in targets(rows):
        print(
            f"{target.study}: {target.asks}: {target.reached_percent:.1f} % "
            f"({target.reached} of {target.cases}, {target.by_class} by class), asked {target.asked}: "
            f"{'met' if target.is_met else 'not met'}"
        )
    print(f"tables: {asked.out / 'foreign_effects.md'}")


def _rows(asked: Namespace, engine: Engine) -> list[Row]:
    studies = str(asked.studies).split(",")
    for name in studies:
        if name not in NUMBERS:
            raise unknown_name("--studies", name, tuple(NUMBERS))
    cases = part_of(make_cases(studies, asked.per, asked.seed), asked.part)
    if asked.tables:
        return stored_rows(cases, asked.out)
    with progress_bar() as show:
        return run_rows(
            cases, asked.out, partial(run_case, engine=engine), study_fingerprint("foreign_effects"), asked.jobs, show,
            lambda sentence: print(sentence, file=sys.stderr), asked.ray,
        )  # fmt: skip


def _write(out: Path, rows: Sequence[Row]) -> None:
    found = judgements(rows)
    write_atomic(out / "foreign_effects.md", as_markdown(rows))
    write_atomic(out / "by_subject.csv", shares(found, ["study", "subject"]).to_csv(index=False))
    write_atomic(out / "cases.csv", found.to_csv(index=False))


if __name__ == "__main__":
    sys.exit(main())
