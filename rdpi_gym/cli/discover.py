"""`rdpi discover`: from measured records to a model that explains them, or a plain no."""

from __future__ import annotations

from pathlib import Path

import rdpi_gym as rg
from rdpi_gym.cli.laboratory import carry_out
from rdpi_gym.cli.options import DataArgument, OutOption
from rdpi_gym.face.options import CandidateOptions, DataOptions


def discover(
    data: DataArgument,
    search: CandidateOptions,
    reading: DataOptions,
    out: OutOption = Path("results/discover"),
) -> None:
    """Fit, then find and add missing effects until nothing more improves the held-out error.

    Writes model.json, discovery.json and the page report.html; an interrupted run continues.
    """
    carry_out(rg.discover, data, reading, search, out, "discovery.json")
