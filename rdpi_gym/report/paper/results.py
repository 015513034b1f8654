"""What the figures of the paper's page are drawn from, whoever computed it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from rdpi_gym.support.arrays import Array


class Named(Protocol):
    """A way to read the paper's compensators."""

    @property
    def name(self) -> str:
        """What tables and legends call it."""


class Reference(Protocol):
    """A sine."""

    @property
    def frequency_hz(self) -> float:
        """Frequency (Hz)."""

    @property
    def ts_s(self) -> float:
        """Sampling time (s)."""


class LastPeriod(Protocol):
    """Samples of a period, ``(M,)`` each."""

    @property
    def t(self) -> Array:
        """Time (s)."""

    @property
    def y_r(self) -> Array:
        """Reference (µm)."""

    @property
    def u(self) -> Array:
        """Command (V)."""

    @property
    def y(self) -> Array:
        """Displacement (µm)."""

    @property
    def error(self) -> Array:
        """Reference minus displacement (µm)."""


class Run(Protocol):
    """How one reading tracked one sine."""

    @property
    def reading(self) -> Named:
        """What compensated."""

    @property
    def sine(self) -> Reference:
        """What was tracked."""

    @property
    def max_error_um(self) -> Array:
        """Largest error (µm), one a realisation."""

    @property
    def rms_error_um(self) -> Array:
        """RMS error (µm), one a realisation."""

    @property
    def percent(self) -> float:
        """Median of the largest error in percent of the reference's amplitude."""

    @property
    def reproducible(self) -> bool:
        """Whether the realisations agree."""

    @property
    def trace(self) -> LastPeriod | None:
        """Samples of the first realisation, where they were kept."""


class Case(Protocol):
    """One panel of a figure for one reading."""

    @property
    def label(self) -> str:
        """Figure and panel."""

    @property
    def reading(self) -> Named:
        """What compensated."""

    @property
    def paper_value(self) -> float | None:
        """What the paper prints."""


class Loop(Protocol):
    """What becomes of a small disturbance at one sampling time (s)."""

    @property
    def ts_s(self) -> float:
        """Sampling time (s)."""

    @property
    def growth(self) -> float:
        """Factor from sample to sample."""


class Limit(Protocol):
    """The sampling time (s) at which a disturbance neither grows nor decays."""

    @property
    def found_s(self) -> float:
        """The limit (s) by simulation."""

    @property
    def loops(self) -> Sequence[Loop]:
        """As simulated."""

    @property
    def predicted_loops(self) -> Sequence[Loop]:
        """By the loop's polynomial."""


class Parting(Protocol):
    """Two runs whose references differ in the last bits."""

    @property
    def reading(self) -> Named:
        """What compensated."""

    @property
    def t_s(self) -> Array:
        """Time (s), ``(K,)``."""

    @property
    def command_V(self) -> Array:
        """Difference of the commands (V), ``(K,)``."""


class PaperResults(Protocol):
    """Every run behind the figures."""

    @property
    def cases(self) -> Sequence[Case]:
        """Every panel, in the order of the paper."""

    @property
    def runs(self) -> Sequence[Run]:
        """The run of each case."""

    @property
    def sweep(self) -> Sequence[Run]:
        """Runs over the sampling time, of every reading."""

    @property
    def divergences(self) -> Sequence[Parting]:
        """Runs that part, by reading."""

    def swept(self, reading: str) -> Sequence[Run]:
        """Return the runs of one reading over the sampling time, Ts falling."""

    def limit(self, plant: str, reading: str) -> Limit:
        """Return the stability limit of one reading on one plant."""
