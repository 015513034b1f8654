"""`rdpi reproduce`: the paper's figures and numbers, ours beside the paper's."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rdpi_gym.cli.options import OutOption, SeedOption
from rdpi_gym.support.progress import progress_bar


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
    from benchmarks.paper import (
        implementation_rows,
        paper_markdown,
        paper_rows,
        reproduce_paper,
        sweep_rows,
        to_csv,
    )
    from benchmarks.paper.cases import SWEEP_LABEL, TABLE_TS_S
    from rdpi_gym.report.paper.figures import write_paper_figures
    from rdpi_gym.support.files import write_atomic

    with progress_bar() as show:
        results = reproduce_paper(seed, realisations, progress=show)
        show("figures", 0, 0)
        write_paper_figures(out, results)
    rows = paper_rows(results)
    write_atomic(out / "paper.csv", to_csv(rows))
    write_atomic(out / "sweep.csv", to_csv(sweep_rows(results)))
    write_atomic(out / "implementation.csv", to_csv(implementation_rows(results)))
    page = write_atomic(out / "paper.md", paper_markdown(results))
    for row in rows:
        if row.case == SWEEP_LABEL and row.ts_s == min(TABLE_TS_S) and row.reading != "none":
            print(f"{row.reading}: {row.verdict}")
    print(f"{page}: the paper's figures and numbers beside ours; {len(rows)} rows in paper.csv")
