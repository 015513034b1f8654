"""Interface of a hysteresis core, and its parameters as the kernels read them."""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np

from rdpi_gym.plant.parameters import DataScale, Parameter
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.plugins import Members
from rdpi_gym.support.words import quoted

CoreBlock: TypeAlias = Callable[[Array, Array, Array, Array, Array], None]
"""Kernel ``block(u, v, p, state, y)`` over ``float64[T, B]``: command (V), its rate (V/s), packed
parameters ``[P, B]``, state ``[S, B]``, displacement (µm), which it fills."""

FusedBlock: TypeAlias = Callable[[Array, Array, Array, float, Array], None]
"""Kernel ``fused(u, p, state, ts, y)``: the rate and :data:`CoreBlock` in one call."""


class Core(ABC):
    """Hysteresis between the command and the displacement: parameters and a compiled kernel.

    A subclass is a frozen dataclass whose fields are numbers, lists of numbers or None, as the
    plant's JSON holds them. Its kernel finds, for each lane, a column of ``p`` with
    :meth:`coefficients`, the pole of the rate's low-pass and the offset (µm), which it adds; and a
    column of the state with the last command, the last rate, which the chain keeps, and :attr:`n`
    rows of memory, which the kernel leaves where the block ended.

    Attributes
    ----------
    name
        As under ``core`` in the JSON of a plant.
    rate_bandwidth_hz
        Cut-off (Hz) of a first-order low-pass on the rate; None is the literal Eq. 5.
    block, fused
        The compiled kernels, as ``staticmethod``; the second only saves a call, and may be left out.
    lanes_block, together
        A kernel as `block` for one sample of many lanes, if it picks among many coefficients: those
        from number `together` on stand lane by lane in its ``p``, ``(B, K)`` in place of ``(K, B)``.
    title
        What people call it, in words that read within a sentence.
    equation, source, signature, experiment, hardware
        The equation, where it is from, what gives it away in data, what shows it best, where it is
        met; empty unless stated.
    linear, either_sign
        The fields that are :attr:`gains`, in their order; those of them that may be negative.
    shape
        The numbers that the displacement is not linear in and that a fit moves, as fields.
    clockwise
        Whether its loops turn clockwise in the plane of command and displacement, as those of a
        friction force do; None: either way, by its numbers.
    wipes_out
        Whether a loop within a loop closes and is forgotten, as every sum of plays, stops or relays
        has it.
    rated
        Whether it depends on how fast the command moves.
    keeps_first
        Whether its first gain, of the command itself, stays above zero.
    spaced
        Whether `thresholds_V` is one of its fields, increasing (V): their gaps are drawn where
        plants are randomised, with the gains and the shape.
    drawn_as_packed
        Whether :meth:`coefficients` are gains, thresholds and shape as they stand, and a factor
        above zero of any of them is allowed: many lanes are drawn without a core for each.
    cases
        Models that other kinds have among theirs too, under one name there and here, each with the
        numbers (of its shape or gains) at which this kind is it; none where it always is.
    loose
        Whether one large loop leaves its gains open, so that a fit prices their :meth:`roughness`.

    Examples
    --------
    >>> from rdpi_gym.plant import PAPER_III_B
    >>> PAPER_III_B.name, PAPER_III_B.n, len(PAPER_III_B.coefficients())
    ('rdpi', 5, 12)
    """

    name: ClassVar[str]
    block: ClassVar[CoreBlock]
    fused: ClassVar[FusedBlock | None] = None
    lanes_block: ClassVar[CoreBlock | None] = None
    together: ClassVar[int] = 0
    title: ClassVar[str] = ""
    equation: ClassVar[str] = ""
    source: ClassVar[str] = ""
    signature: ClassVar[str] = ""
    experiment: ClassVar[str] = ""
    hardware: ClassVar[str] = ""
    linear: ClassVar[tuple[str, ...]] = ()
    either_sign: ClassVar[tuple[str, ...]] = ()
    shape: ClassVar[tuple[Parameter, ...]] = ()
    clockwise: ClassVar[bool | None] = False
    wipes_out: ClassVar[bool] = True
    rated: ClassVar[bool] = False
    keeps_first: ClassVar[bool] = False
    spaced: ClassVar[bool] = False
    drawn_as_packed: ClassVar[bool] = False
    cases: ClassVar[Mapping[str, Mapping[str, float]]] = MappingProxyType({})
    loose: ClassVar[bool] = False
    rate_bandwidth_hz: float | None

    @property
    @abstractmethod
    def n(self) -> int:
        """Number of rows of memory."""

    @property
    @abstractmethod
    def a0(self) -> float:
        """Gain (µm/V) of a small command right after a turn."""

    @property
    @abstractmethod
    def A(self) -> float:
        """Largest gain (µm/V): no command moves the plant farther from rest than A times it."""

    def __post_init__(self) -> None:
        check_shape(self)
        check_rate_bandwidth(self.rate_bandwidth_hz)

    @property
    def gains(self) -> tuple[float, ...]:
        """The numbers that the displacement is linear in, as :meth:`responses` orders them."""
        return tuple(gain for name in self.linear for gain in self._listed(name))

    @property
    def signed(self) -> tuple[bool, ...]:
        """Which of the gains may be negative."""
        return tuple(name in self.either_sign for name in self.linear for _ in self._listed(name))

    def _listed(self, name: str) -> tuple[float, ...]:
        value = getattr(self, name)
        return value if isinstance(value, tuple) else (value,)

    @abstractmethod
    def with_gains(self, gains: Sequence[float]) -> Self:
        """Return the same core with other gains, those that may not be negative at least zero."""

    @abstractmethod
    def responses(self, u: Array, v: Array, memory: Array) -> Array:
        """Return the displacement over each of the gains: what a fit of them is linear in.

        Parameters
        ----------
        u, v : float64[T]
            Command (V) and rate (V/s), as the kernel sees them.
        memory : float64[n]
            Where the record begins; left as it is.

        Returns
        -------
        float64[T, K]
            With the gains it makes what ``block`` makes without offset.
        """

    def roughness(self) -> Array:
        """Return R, float64[K, K], of the roughness g'R g (µm²) that a fit prices uneven gains g by.

        Gains that records tell only together are then alike, and not whatever the noise makes of
        them. Zero, of gains that are few or have no neighbours: no price.
        """
        return np.zeros((len(self.gains),) * 2)

    @classmethod
    @abstractmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Return where a fit to data of a size begins, one for each optimum that it may fall into.

        A core of many fixed thresholds or levels spreads them over the data.
        """

    @classmethod
    def comb(cls, scale: DataScale) -> Self:
        """Return what a search for effects begins with: as many fixed thresholds as it needs.

        The first of :meth:`starts`, unless stated.
        """
        return cls.starts(scale)[0]

    def pruned(self) -> Self:
        """Return the core without the gains that a round of candidates can do without."""
        return self

    def on(self, whole: Self) -> Self:
        """Return the core with all the gains that `whole` has, one of :meth:`comb`, where it has more."""
        return self

    def slim(self) -> Self:
        """Return the core as it is saved, without the gains that are zero."""
        return self

    def static(self) -> Self:
        """Return the core as slow motion sees it: without what depends on the rate."""
        return self

    def rated_at(self, fastest_V_s: float) -> Self | None:
        """Return the core as it would show thresholds that grow with the rate, up to `fastest_V_s` (V/s).

        None, by default: no core of this kind has such thresholds.
        """
        return None

    @property
    def first_threshold_V(self) -> float:
        """Reach (V) of a small signal that the core follows without a loop; zero unless stated."""
        return 0.0

    def with_shape(self, values: Mapping[str, float]) -> Self:
        """Return the same core with other values of numbers of ``shape``, within their bounds."""
        changed: Any = dataclasses.replace(self, **self._within(values))  # type: ignore[type-var]
        return changed  # type: ignore[no-any-return]

    def _within(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of numbers of ``shape``, each moved to the nearest within its bounds."""
        limits = {p.name: (p.low, p.high) for p in self.shape}
        return {k: min(max(float(v), limits[k][0]), limits[k][1]) for k, v in values.items()}

    @property
    def rate_gain_um_s_V(self) -> float:
        """Displacement (µm) that a rate of the command adds while the core slides, per V/s.

        Negative where the displacement lags the more, the faster it goes; zero unless stated.
        """
        return 0.0

    @property
    def zero_rad_s(self) -> float:
        """Right-half-plane zero (rad/s) while it slides, A over what a rate takes; infinite without one."""
        lag = -self.rate_gain_um_s_V
        return self.A / lag if lag > 0 else math.inf

    @property
    def gaps_V(self) -> Array:
        """Gaps (V) between neighbouring thresholds, the first one from zero; empty without any."""
        thresholds: Any = getattr(self, "thresholds_V") if self.spaced else ()  # noqa: B009
        gaps: Array = np.diff(np.array(thresholds, dtype=np.float64), prepend=0.0)
        return gaps

    @property
    def factors(self) -> int:
        """Number of factors that :meth:`scaled` takes."""
        return len(self.gains) + len(self.gaps_V) + len(self.shape)

    def scaled(self, factors: Array) -> Self:
        """Return the core with each of its numbers times a factor: what a randomised plant is.

        Parameters
        ----------
        factors : float64[K]
            Above zero: of the gains, of the gaps between thresholds, of the shape. What would pass
            a bound is at that bound.

        Examples
        --------
        >>> from rdpi_gym.plant import CORES
        >>> stop = CORES["stop"]((2.0, 1.0), (1.0, 4.0), slope=0.5)
        >>> stop.scaled(np.array([1.0, 0.5, 1.0, 2.0, 1.0])).thresholds_V
        (2.0, 5.0)
        """
        gains, gaps = np.array(self.gains), self.gaps_V
        own, between, rest = np.split(factors, [len(gains), len(gains) + len(gaps)])
        core: Any = self.with_gains((gains * own).tolist())
        if self.spaced:
            core = dataclasses.replace(core, thresholds_V=tuple(np.cumsum(gaps * between).tolist()))
        if self.shape:
            pairs = zip(self.shape, rest.tolist(), strict=True)
            core = core.with_shape({p.name: getattr(self, p.name) * f for p, f in pairs})
        return core  # type: ignore[no-any-return]

    @abstractmethod
    def coefficients(self) -> list[float]:
        """Return what the kernel reads of the parameters."""

    def scaled_coefficients(self, factors: Array) -> Array:
        """Return the :meth:`coefficients` of m cores as :meth:`scaled` makes them, a column a core.

        One core after the other, unless a kind has a form for all of them.

        Parameters
        ----------
        factors : float64[m, K]
            As of :meth:`scaled`, a row a core.
        """
        return np.array([self.scaled(each).coefficients() for each in factors]).T

    @abstractmethod
    def settled(self, turns_V: Sequence[float]) -> Array:
        """Return the memory after a slow walk from rest through commands (V), ``float64[n]``."""

    @abstractmethod
    def resting(self, memory: Array, u0_V: Array) -> Array:
        """Return what a rest at commands (V) ``(B,)`` allows of memories ``(n, B)``."""

    def rises_at(self, ts_s: float) -> bool:
        """Whether the displacement rises with the newest command at sampling time `ts_s` (s).

        True, unless the rate of that command would take more than the command gives.
        """
        return True

    def rate_pole(self, ts_s: float) -> float:
        """Pole exp(-2π f_c Ts) of the rate's low-pass at sampling time `ts_s` (s); 0 if literal."""
        if self.rate_bandwidth_hz is None:
            return 0.0
        return math.exp(-2.0 * math.pi * self.rate_bandwidth_hz * ts_s)

    def band_limited(self, rate_bandwidth_hz: float | None) -> Self:
        """Return the same core with its rate low-passed at `rate_bandwidth_hz` (Hz), or literal (None)."""
        changed: Any = dataclasses.replace(self, rate_bandwidth_hz=rate_bandwidth_hz)  # type: ignore[type-var]
        return changed  # type: ignore[no-any-return]


CORES: Mapping[str, type[Core]] = Members("rdpi_gym.plant.cores", Core)  # type: ignore[type-abstract]
"""Every core by its name: a file of this folder that defines one is found."""


def check_rate_bandwidth(rate_bandwidth_hz: float | None) -> None:
    """Refuse a cut-off (Hz) of the rate's low-pass that is neither above zero nor None."""
    if rate_bandwidth_hz is not None and not (
        is_finite(rate_bandwidth_hz) and rate_bandwidth_hz > 0
    ):
        raise InputError(
            f"rate_bandwidth_hz is {quoted(rate_bandwidth_hz)}; give a frequency above 0 Hz, or None for the literal rate"
        )


def check_shape(core: Core) -> None:
    """Refuse a number of a core's shape that is not finite or beyond its bounds."""
    for number in core.shape:
        value = getattr(core, number.name)
        if not (is_finite(value) and number.low <= value <= number.high):
            unit = "" if number.unit == "1" else f" {number.unit}"
            raise InputError(
                f"{number.name} is {quoted(value)}; give a number from {number.low:g} to {number.high:g}{unit}"
            )


def check_ts(ts_s: float) -> float:
    """Return `ts_s` (s) as a float, or refuse one that is not finite and above zero.

    Raises
    ------
    InputError
        With the value found.

    Examples
    --------
    >>> check_ts(5e-5)
    5e-05
    """
    if not (is_finite(ts_s) and ts_s > 0):
        raise InputError(
            f"ts_s is {quoted(ts_s)}; give a sampling time above 0 s, for example 5e-5"
        )
    return float(ts_s)


def pack(models: Sequence[Core], ts_s: float, offsets_um: Sequence[float]) -> Array:
    """Pack the parameters of hysteresis cores for their kernel.

    Parameters
    ----------
    models
        One core a lane, all of one kind with the same n.
    ts_s
        Sampling time (s); it sets the pole of a band-limited rate.
    offsets_um
        Added to each lane's displacement (µm).

    Returns
    -------
    float64[P + 2, B]
        What the core packs, the pole of the rate's low-pass, the offset (µm).

    Raises
    ------
    InputError
        The models differ in kind or in n, or Ts is not above zero.

    Examples
    --------
    >>> from rdpi_gym.plant import RDPI
    >>> pack([RDPI.from_law([1.0, 0.5], 2.0, 0.0)], 1e-4, [0.0]).ravel().tolist()
    [1.0, 0.5, 2.0, 0.0, 0.0, 0.0]
    """
    check_ts(ts_s)
    if len({model.name for model in models}) != 1:
        names = sorted({model.name for model in models})
        raise InputError(
            f"lanes with the cores {' and '.join(names)}; all lanes of one plant need the same one"
        )
    if len({model.n for model in models}) != 1:
        counts = sorted({model.n for model in models})
        raise InputError(
            f"lanes with {counts} play operators; all lanes of one plant need the same n"
        )
    columns = [
        [*m.coefficients(), m.rate_pole(ts_s), float(offset)]
        for m, offset in zip(models, offsets_um, strict=True)
    ]
    if len({len(column) for column in columns}) != 1:
        counts = sorted({len(model.gains) for model in models})
        raise InputError(
            f"lanes with {counts} gains; all lanes of one plant need as many of the core {models[0].name}"
        )
    return np.ascontiguousarray(np.array(columns, dtype=np.float64).T)


def empty_state(n: int, lanes: int) -> Array:
    """State of `lanes` plants with `n` rows of memory that have never been moved: float64[n + 2, lanes].

    Examples
    --------
    >>> empty_state(5, 3).shape
    (7, 3)
    """
    return np.zeros((n + 2, lanes))
