"""Command line of the payoff: discover what is hidden, track with it, write tables and a picture."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import benchmarks.payoff
from benchmarks.payoff.beliefs import FOLDER, make_beliefs, stored_beliefs
from benchmarks.payoff.plants import HIDDEN_PLANTS, HiddenPlant
from benchmarks.payoff.scores import ROWS_FILE, payoff_table
from benchmarks.payoff.tables import payoff_summary, payoff_text
from rdpi_gym.plant import PlantModel
from rdpi_gym.report.payoff.picture import payoff_picture
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.parallel import run_cases
from rdpi_gym.support.progress import progress_bar

OUT = Path("studies/results/payoff")
"""Tables of a release; its beliefs lie beside the code, which scores them in `rdpi bench`."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute the payoff and write its files.

    Parameters
    ----------
    arguments
        Words after the command; those of the process by default.

    Returns
    -------
    int
        0, 2 on bad input (one line on standard error), 130 when interrupted.
    """
    parser = argparse.ArgumentParser(
        prog="payoff", description=benchmarks.payoff.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--out", type=Path, default=OUT, help="folder for tables and picture")
    parser.add_argument(
        "--beliefs", type=Path, default=FOLDER,
        help="folder of what was discovered; what other code discovered is discovered anew",
    )  # fmt: skip
    parser.add_argument("--stored", action="store_true", help="discover nothing anew")
    parser.add_argument("--seed", type=int, default=0, help="of records, noise and references")
    parser.add_argument("--jobs", type=int, default=-1, help="processes; -1: one a core")
    options = parser.parse_args(arguments)
    try:
        if options.seed < 0:
            raise InputError(f"--seed is {options.seed}; give 0 or more")
        if options.jobs == 0 or options.jobs < -1:
            raise InputError(f"--jobs is {options.jobs}; give the number of processes, or -1")
        for name in ("out", "beliefs"):
            folder = getattr(options, name)
            if folder.exists() and not folder.is_dir():
                raise InputError(f"{folder} is a file; give a folder for --{name}")
        make = stored_beliefs if options.stored else make_beliefs
        look = partial(_beliefs, make=make, folder=options.beliefs, seed=options.seed)
        _compute(look, options.out, options.seed, options.jobs)
    except InputError as error:
        print(f"payoff: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted; the same command goes on from the beliefs it has", file=sys.stderr)
        return 130
    return 0


Beliefs = dict[str, PlantModel]


def _compute(
    look: Callable[[HiddenPlant], tuple[HiddenPlant, Beliefs]], out: Path, seed: int, jobs: int
) -> None:
    with progress_bar() as show:
        found: dict[HiddenPlant, Beliefs] = {}
        for hidden, own in run_cases(look, HIDDEN_PLANTS, jobs):
            found[hidden] = own
            show("discovering", len(found), len(HIDDEN_PLANTS))
        beliefs = {hidden: found[hidden] for hidden in HIDDEN_PLANTS}
        table = payoff_table(
            beliefs,
            out,
            seed,
            jobs,
            show,
            note=lambda sentence: print(sentence, file=sys.stderr),
        )
    write_atomic(
        out / "payoff.csv", table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    )
    write_atomic(out / "payoff.png", payoff_picture(payoff_summary(table)))
    print(f"table: {write_atomic(out / 'payoff.md', payoff_text(table))}")
    (out / ROWS_FILE).unlink(missing_ok=True)  # the table holds them


def _beliefs(
    hidden: HiddenPlant, make: Callable[[HiddenPlant, Path, int], Beliefs], folder: Path, seed: int
) -> tuple[HiddenPlant, Beliefs]:
    return hidden, make(hidden, folder, seed)


if __name__ == "__main__":
    sys.exit(main())
