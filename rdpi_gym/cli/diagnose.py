"""`rdpi diagnose`: which effect a model misses."""

from __future__ import annotations

from pathlib import Path

import rdpi_gym as rg
from rdpi_gym.cli.laboratory import carry_out
from rdpi_gym.cli.options import DataArgument, OutOption
from rdpi_gym.face.options import CandidateOptions, DataOptions


def diagnose(
    data: DataArgument,
    search: CandidateOptions,
    reading: DataOptions,
    out: OutOption = Path("results/diagnose"),
) -> None:
    """Rank the effects that a model may miss, each refitted with it, by the error on validation records.

    Writes diagnosis.json and the page report.html; an interrupted run continues.
    """
    carry_out(rg.diagnose, data, reading, search, out, "diagnosis.json")
