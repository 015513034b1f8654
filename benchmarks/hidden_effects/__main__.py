"""Who finds hidden effects: data sets with a known secret, diagnosed and counted.

    python -m benchmarks.hidden_effects --study single,pairs,none,outside,invariance --jobs 2

An interrupted run continues from the rows that it has written. Rows of changed code are set aside.
With ``--ray ADDRESS`` the nodes of a Ray cluster diagnose the cases; the rows are written here.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.hidden_effects.case_row import Engine, discover_engine
from benchmarks.hidden_effects.cases import NUMBERS, make_cases
from benchmarks.hidden_effects.run import run_study
from benchmarks.hidden_effects.scoring import judgements
from benchmarks.hidden_effects.summary import as_markdown, by_subject, targets
from rdpi_gym.measurement.options import unknown_name
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.store import Row
from rdpi_gym.virtual_lab.draws import HIDEABLE

OUT = Path("studies/results/hidden")


def main(arguments: Sequence[str] | None = None, engine: Engine = discover_engine) -> int:
    """Run the study, print its targets, and write its tables.

    Parameters
    ----------
    arguments
        Words after the command; those of the process by default.
    engine
        What is put to the test.

    Returns
    -------
    int
        0, 2 on bad input (one line on standard error), 130 when interrupted.
    """
    options = _parse(arguments)
    try:
        rows = _run(options, engine)
        folder = _write(options.out, rows)
    except InputError as error:
        print(f"hidden_effects: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted; the same command continues from the rows it has", file=sys.stderr)
        return 130
    for target in targets(rows):
        word = "met" if target.is_met else "not met"
        print(
            f"{target.study}: {target.asks}: {target.percent:.1f} % ({target.reached} of {target.cases}), "
            f"asked {target.least_percent:g} %: {word}"
        )
    print(f"tables: {folder / 'hidden_effects.md'}")
    return 0


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="hidden_effects", description=__doc__)
    parser.add_argument("--study", default=",".join(NUMBERS), help="of single, pairs, none, ...")
    parser.add_argument("--plants", type=int, help=f"plants for each subject; by default {NUMBERS}")
    parser.add_argument("--effects", default=",".join(HIDEABLE), help="effects to hide")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2, help="processes; -1: one a core")
    parser.add_argument("--ray", metavar="ADDRESS", help="a Ray cluster, in place of --jobs")
    parser.add_argument("--out", type=Path, default=OUT)
    return parser.parse_args(arguments)


def _run(options: argparse.Namespace, engine: Engine) -> list[Row]:
    studies, effects = options.study.split(","), options.effects.split(",")
    for where, names, known in (
        ("--study", studies, tuple(NUMBERS)),
        ("--effects", effects, HIDEABLE),
    ):
        for name in names:
            if name not in known:
                raise unknown_name(where, name, known)
    if options.plants is not None and options.plants < 1:
        raise InputError(f"--plants is {options.plants}; give 1 or more plants for each subject")
    if options.jobs == 0 or options.jobs < -1:
        raise InputError(f"--jobs is {options.jobs}; give the number of processes, or -1")
    if options.seed < 0:
        raise InputError(f"--seed is {options.seed}; give 0 or more")
    if options.out.exists() and not options.out.is_dir():
        raise InputError(f"{options.out} is a file; give a folder for --out")
    cases = make_cases(studies, options.plants, options.seed, effects)
    with progress_bar() as show:
        return run_study(
            cases, options.out, options.jobs,
            show, engine,
            lambda sentence: print(sentence, file=sys.stderr), options.ray,
        )  # fmt: skip


def _write(out: Path, rows: Sequence[Row]) -> Path:
    write_atomic(out / "hidden_effects.md", as_markdown(rows))
    write_atomic(out / "by_subject.csv", by_subject(rows).to_csv(index=False))
    write_atomic(out / "cases.csv", judgements(rows).to_csv(index=False))
    return out


if __name__ == "__main__":
    sys.exit(main())
