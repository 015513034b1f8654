"""Who finds hidden effects: data sets with a known secret, diagnosed and counted.

    python -m benchmarks.hidden_effects --study single,pairs,none,outside,invariance --jobs 2

An interrupted run continues from the rows that it has written. Rows of changed code are set aside.
With ``--tables`` nothing is run, and the tables are written from the rows that are there.
With ``--ray ADDRESS`` the nodes of a Ray cluster diagnose the cases; the rows are written here.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmarks.hidden_effects.case_row import Engine, discover_engine
from benchmarks.hidden_effects.cases import NUMBERS, make_cases
from benchmarks.hidden_effects.run import run_study, stored_rows
from benchmarks.hidden_effects.scoring import judgements
from benchmarks.hidden_effects.summary import as_markdown, by_subject, targets
from rdpi_gym.measurement.options import unknown_name
from rdpi_gym.support.command_line import Options
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.store import Row
from rdpi_gym.virtual_lab.draws import HIDEABLE

OUT = Path("studies/results/hidden")


def main(arguments: Sequence[str] | None = None, engine: Engine = discover_engine) -> int:
    """Run the study, print its targets, and write its tables."""
    return options().run(arguments, partial(_study, engine=engine))


def options() -> Options:
    """Return what the command can be asked for."""
    found = Options("hidden_effects", __doc__, out=OUT, seed=0, jobs=2, ray=True)
    found.add_argument("--study", default=",".join(NUMBERS), help="of single, pairs, none, ...")
    found.add_number("--plants", None, f"plants for each subject; by default {NUMBERS}")
    found.add_argument(
        "--tables", action="store_true", help="write the tables of the rows in --out; run nothing"
    )
    found.add_argument("--effects", default=",".join(HIDEABLE), help="effects to hide")
    return found


def _study(asked: Namespace, engine: Engine) -> None:
    rows = _rows(asked, engine)
    folder = _write(asked.out, rows)
    for target in targets(rows):
        word = "met" if target.is_met else "not met"
        print(
            f"{target.study}: {target.asks}: {target.percent:.1f} % ({target.reached} of {target.cases}), "
            f"asked {target.least_percent:g} %: {word}; effects falsely added: {target.falsely_added}"
        )
    print(f"tables: {folder / 'hidden_effects.md'}")


def _rows(asked: Namespace, engine: Engine) -> list[Row]:
    studies, effects = asked.study.split(","), asked.effects.split(",")
    for where, names, known in (
        ("--study", studies, tuple(NUMBERS)),
        ("--effects", effects, HIDEABLE),
    ):
        for name in names:
            if name not in known:
                raise unknown_name(where, name, known)
    cases = make_cases(studies, asked.plants, asked.seed, effects)
    if asked.tables:
        return stored_rows(cases, asked.out)
    with progress_bar() as show:
        return run_study(
            cases, asked.out, asked.jobs,
            show, engine,
            lambda sentence: print(sentence, file=sys.stderr), asked.ray,
        )  # fmt: skip


def _write(out: Path, rows: Sequence[Row]) -> Path:
    write_atomic(out / "hidden_effects.md", as_markdown(rows))
    write_atomic(out / "by_subject.csv", by_subject(rows).to_csv(index=False))
    write_atomic(out / "cases.csv", judgements(rows).to_csv(index=False))
    return out


if __name__ == "__main__":
    sys.exit(main())
