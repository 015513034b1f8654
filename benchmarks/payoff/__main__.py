"""Command line of the payoff: discover what is hidden, track with it, write tables and a picture."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import benchmarks.payoff
from benchmarks.payoff.report import payoff_picture, payoff_summary, payoff_text
from benchmarks.payoff.scores import (
    FOLDER,
    HIDDEN_PLANTS,
    ROWS_FILE,
    HiddenPlant,
    make_beliefs,
    payoff_table,
    stored_beliefs,
)
from benchmarks.rows import write_csv
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.command_line import Options
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.parallel import run_cases
from rdpi_gym.support.progress import progress_bar

OUT = Path("studies/results/payoff")
"""Tables of a release; its beliefs lie beside the code, which scores them in `rdpi bench`."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute the payoff and write its files."""
    options = Options("payoff", benchmarks.payoff.__doc__, out=OUT, seed=0, jobs=-1)
    options.add_folder(
        "--beliefs", FOLDER,
        "folder of what was discovered; what other code discovered is discovered anew",
    )  # fmt: skip
    options.add_argument("--stored", action="store_true", help="discover nothing anew")
    return options.run(arguments, _run)


def _run(options: Namespace) -> None:
    make = stored_beliefs if options.stored else make_beliefs
    look = partial(_beliefs, make=make, folder=options.beliefs, seed=options.seed)
    _compute(look, options.out, options.seed, options.jobs)


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
        table = payoff_table(beliefs, out, seed, jobs, show)
    write_csv(out / "payoff.csv", table)
    write_atomic(out / "payoff.png", payoff_picture(payoff_summary(table)))
    print(f"table: {write_atomic(out / 'payoff.md', payoff_text(table))}")
    (out / ROWS_FILE).unlink(missing_ok=True)  # the table holds them


def _beliefs(
    hidden: HiddenPlant, make: Callable[[HiddenPlant, Path, int], Beliefs], folder: Path, seed: int
) -> tuple[HiddenPlant, Beliefs]:
    return hidden, make(hidden, folder, seed)


if __name__ == "__main__":
    sys.exit(main())
