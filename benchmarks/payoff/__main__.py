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
from rdpi_gym.support.command import Options
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
    look = partial(make, folder=options.beliefs, seed=options.seed)
    with progress_bar() as show:
        found: dict[HiddenPlant, dict[str, PlantModel]] = {}
        for hidden, own in run_cases(partial(_named, look=look), HIDDEN_PLANTS, options.jobs):
            found[hidden] = own
            show("discovering", len(found), len(HIDDEN_PLANTS))
        beliefs = {hidden: found[hidden] for hidden in HIDDEN_PLANTS}
        table = payoff_table(beliefs, options.out, options.seed, options.jobs, show)
    write_csv(options.out / "payoff.csv", table)
    write_atomic(options.out / "payoff.png", payoff_picture(payoff_summary(table)))
    print(f"table: {write_atomic(options.out / 'payoff.md', payoff_text(table))}")
    (options.out / ROWS_FILE).unlink(missing_ok=True)  # the table holds them


def _named(
    hidden: HiddenPlant, look: Callable[[HiddenPlant], dict[str, PlantModel]]
) -> tuple[HiddenPlant, dict[str, PlantModel]]:
    return hidden, look(hidden)


if __name__ == "__main__":
    sys.exit(main())
