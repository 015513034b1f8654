"""What the benchmark's page and picture are made of, whoever scored it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import pandas as pd

from rdpi_gym.support.arrays import Array


class MeasuredScores(Protocol):
    """Feedforwards on measured records."""

    @property
    def table(self) -> pd.DataFrame:
        """A row for each controller and record; without rows where there are no records."""

    @property
    def traces(self) -> Mapping[str, Mapping[str, Array]]:
        """By record: ``t_s`` (s), ``applied`` (V) and the command (V) of each controller."""


class BenchmarkResults(Protocol):
    """Scores of controllers, from single rows to the ranking.

    A ranking has the columns ``controller, rmse_percent, rmse_percent_low, rmse_percent_high,
    seed_0_rmse_percent, optimality_gap`` at least; whatever else it has is shown in its table.
    """

    @property
    def rows(self) -> Sequence[Mapping[str, Any]]:
        """Every score; those with a ``trace`` can be drawn."""

    @property
    def ranking(self) -> pd.DataFrame:
        """The controllers, best first."""

    @property
    def where_trained(self) -> Mapping[float, pd.DataFrame]:
        """Rankings over the cases of one sampling time (s) each."""

    @property
    def by_case(self) -> pd.DataFrame:
        """``controller, plant, reference, frequency_hz, ts_s, rmse_percent`` with its interval."""

    @property
    def by_sampling_time(self) -> pd.DataFrame:
        """``controller, plant, ts_s, rmse_percent, command_total_variation``."""

    @property
    def measured(self) -> MeasuredScores:
        """Scores on measured records."""

    @property
    def notes(self) -> Sequence[str]:
        """What was left out, one sentence each."""

    @property
    def order(self) -> Sequence[str]:
        """Controllers, best first."""

    @property
    def first_seed(self) -> int:
        """The seed whose traces are drawn."""

    @property
    def shown_setting(self) -> tuple[str, float]:
        """Plant and sampling time (s) that stand for all in the picture."""
