"""Measurements: the record of one experiment, and a data set of records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.measurement.quantities import Quantities
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

BoolArray = NDArray[np.bool_]
Role = Literal["train", "validation", "test"]
ROLES: tuple[Role, ...] = get_args(Role)
_COLUMNS = ("t_s", "u_V", "y_um", "reference_um", "temperature_C", "period", "error_mask")
LARGEST = 1e30
"""Largest size of a value of a record, in any unit; so many seconds pass at most from sample to sample.

Nothing that was measured is larger. Fourth powers of a rate, the largest value over the smallest
sampling time, are formed by some models: beyond this they are no floats any more.
"""
SHORTEST_S = 1.0 / LARGEST
"""Shortest sampling time of a record (s), for the same reason."""
_CONSTANT_U_V = 1e-9  # below this a voltage is constant: no amplifier moves by a nanovolt

_SHORT_GAP = 8  # samples


def _empty_mask() -> BoolArray:
    return np.ones(0, dtype=np.bool_)


@dataclass(frozen=True, eq=False)
class Record:
    """One measured record, uniformly sampled; `t_s` is the clock of the experiment.

    Parameters
    ----------
    name
        Name of the record: its file name without the ending.
    t_s, u_V, y_um
        Time (s), voltage (V) and displacement (µm), each of shape (N,).
    ts_s
        Sampling time (s).
    reference_um, temperature_C, period
        Reference (µm), temperature (°C), index of the repetition; each (N,) or None.
    role
        ``train``, ``validation`` or ``test``.
    error_mask
        (N,) bool; False where a sample is simulated but left out of the error. By default all
        samples count.
    note
        What the experimenter wrote about the record.
    source
        The file it was read from.
    remarks
        What was left out, resampled, how much the sampling jitters: one sentence each.
    others
        Further inputs by name, each (N,) in the unit of the file: what a model with one input does
        not see.
    jitter_s
        By how much the time stamps of the file are off an even clock (s rms), beyond what writing
        them with few digits does; 0 for even ones.
    before_V
        Voltage (V) of the M samples before the first one, (M,): simulated for the memory that it
        leaves, never compared. None by default.
    past_unknown
        Whether slow elements of a model may begin out of equilibrium: nobody recorded what came before.

    Raises
    ------
    InputError
        Arrays of different lengths, a value that is no finite number or beyond 1e30, a
        sampling time that is not above 0, an unknown role.

    Examples
    --------
    >>> t = np.arange(100) * 1e-3
    >>> record = Record("sine", t, np.sin(60 * t), 8 * np.sin(60 * t), ts_s=1e-3)
    >>> record.is_quiet, int(record.error_mask.sum())
    (False, 100)
    """

    name: str
    t_s: Array
    u_V: Array
    y_um: Array
    ts_s: float
    reference_um: Array | None = None
    temperature_C: Array | None = None
    period: NDArray[np.int64] | None = None
    role: Role = "train"
    error_mask: BoolArray = field(default_factory=_empty_mask)
    note: str = ""
    source: str = ""
    remarks: tuple[str, ...] = ()
    others: Mapping[str, Array] = field(default_factory=dict)
    before_V: Array = field(default_factory=lambda: np.zeros(0))
    jitter_s: float = 0.0
    past_unknown: bool = False

    def __post_init__(self) -> None:
        samples = self.t_s.size
        if self.error_mask.size == 0:
            object.__setattr__(self, "error_mask", np.ones(samples, dtype=np.bool_))
        columns = {key: getattr(self, key) for key in _COLUMNS} | dict(self.others)
        for key, column in columns.items():
            if column is not None and column.shape != (samples,):
                raise InputError(
                    f"record {self.name}: {key} has shape {column.shape}; "
                    f"give one value for each of the {samples} times"
                )
        for key, column in {**columns, "before_V": self.before_V}.items():
            # NaN is within no bounds
            if column is not None and not (
                -LARGEST <= np.min(column, initial=0.0) <= np.max(column, initial=0.0) <= LARGEST
            ):
                row = int(np.argmin(np.abs(column) <= LARGEST))
                raise InputError(
                    f"record {self.name}: {key}[{row}] is {column[row]:g}, {out_of_range(column[row])}; "
                    "mend it or remove this sample"
                )
        if not SHORTEST_S <= self.ts_s <= LARGEST:
            raise InputError(
                f"record {self.name}: ts_s is {self.ts_s}; give a sampling time above 0 s, from "
                f"{SHORTEST_S:g} to {LARGEST:g} s"
            )
        if self.role not in ROLES:
            raise InputError(
                f"record {self.name}: role {self.role!r} is unknown; give {', '.join(ROLES)}"
            )

    def cut(self, part: slice) -> Record:
        """Return a stretch of the record, every column of it.

        Examples
        --------
        >>> t = np.arange(50) * 0.1
        >>> Record("run", t, t, t, ts_s=0.1, others={"u2": 2 * t}).cut(slice(10, 30)).others["u2"].size
        20
        """
        columns = {key: getattr(self, key) for key in _COLUMNS}
        return replace(
            self,
            **{key: values[part] for key, values in columns.items() if values is not None},
            others={name: values[part] for name, values in self.others.items()},
            before_V=np.concatenate([self.before_V, self.u_V[: part.indices(self.u_V.size)[0]]]),
        )

    @property
    def with_history(self) -> Record:
        """The record with the voltage before it; those samples do not count, and repeat `y_um[0]`.

        Examples
        --------
        >>> t = np.arange(50) * 0.1
        >>> late = Record("late", t, t, t, ts_s=0.1, before_V=np.array([-0.2, -0.1]))
        >>> late.with_history.u_V[:3].tolist(), late.with_history.error_mask[:3].tolist()
        ([-0.2, -0.1, 0.0], [False, False, True])
        """
        early = self.before_V.size
        if not early:
            return self
        return Record(
            self.name,
            np.concatenate([self.t_s[0] + self.ts_s * np.arange(-early, 0), self.t_s]),
            np.concatenate([self.before_V, self.u_V]),
            np.concatenate([np.full(early, self.y_um[0]), self.y_um]),
            ts_s=self.ts_s,
            role=self.role,
            error_mask=np.concatenate([np.zeros(early, dtype=np.bool_), self.error_mask]),
        )

    @property
    def is_quiet(self) -> bool:
        """Whether the voltage never changes: such a record tells noise floor and drift.

        Examples
        --------
        >>> t = np.arange(50) * 0.1
        >>> Record("rest", t, np.full(50, 2.0), np.zeros(50), ts_s=0.1).is_quiet
        True
        """
        largest = float(np.max(np.abs(self.u_V), initial=1.0))
        return bool(np.ptp(self.u_V) <= _CONSTANT_U_V * largest)

    @property
    def y_range_um(self) -> tuple[float, float]:
        """Smallest and largest displacement (µm) of the samples that count, or of all."""
        y = self.y_um[self.error_mask] if self.error_mask.any() else self.y_um
        return float(np.min(y)), float(np.max(y))


def out_of_range(value: float) -> str:
    """Say what is wrong with a value that no record may have."""
    return "too large for a measurement" if np.isfinite(value) else "no finite number"


def longest_counted(record: Record) -> Record | None:
    """Return the longest stretch of a record that counts; None where no sample does.

    Single samples and short runs that do not count, as outliers are, do not end a stretch: the
    displacement is carried across them in a straight line.

    Examples
    --------
    >>> t = np.arange(100) * 1e-3
    >>> mask = np.arange(100) >= 10
    >>> mask[50] = False
    >>> counted = longest_counted(Record("run", t, t, t, ts_s=1e-3, error_mask=mask))
    >>> counted.t_s.size, bool(counted.error_mask.all())
    (90, True)
    """
    mask = record.error_mask
    if mask.all():
        return record
    if not mask.any():
        return None
    known = np.flatnonzero(mask)
    breaks = np.flatnonzero(np.diff(known) > _SHORT_GAP + 1)
    starts = np.concatenate([[known[0]], known[breaks + 1]])
    ends = np.concatenate([known[breaks], [known[-1]]]) + 1
    longest = int(np.argmax(ends - starts))
    kept = record.cut(slice(int(starts[longest]), int(ends[longest])))
    k, here = np.arange(kept.t_s.size), kept.error_mask
    y = kept.y_um.copy()
    y[~here] = np.interp(k[~here], k[here], kept.y_um[here])
    return replace(kept, y_um=y, error_mask=np.ones_like(here))


def hold_out_blocks(record: Record, blocks: int = 16, every: int = 4) -> tuple[Record, Record]:
    """Split one record into blocks of time, a quarter held out, each part still simulated whole.

    Both results hold the arrays of `record` in full, so that a simulation carries its memory
    through; only `error_mask` (and `role`) differ. What changes slowly over a record, as a drift
    does, is then judged within what was fitted and not beyond it; the last block is held out too.

    Parameters
    ----------
    record
        The record.
    blocks, every
        Blocks of samples that count, and how many to one that is held out.

    Returns
    -------
    tuple of Record
        The training part and the validation part.

    Examples
    --------
    >>> t = np.arange(160) * 1e-3
    >>> train, validation = hold_out_blocks(Record("sine", t, np.sin(t), np.sin(t), ts_s=1e-3))
    >>> np.flatnonzero(validation.error_mask)[:11].tolist()
    [30, 31, 32, 33, 34, 35, 36, 37, 38, 39, 70]
    """
    counted = np.flatnonzero(record.error_mask)
    held_out = np.concatenate(np.array_split(counted, blocks)[every - 1 :: every])
    return _parted(record, held_out)


def _parted(record: Record, held_out: NDArray[np.intp]) -> tuple[Record, Record]:
    validation = np.zeros_like(record.error_mask)
    validation[held_out] = True
    return (
        replace(record, role="train", error_mask=record.error_mask & ~validation),
        replace(record, role="validation", error_mask=validation),
    )


@dataclass(frozen=True, eq=False)
class Dataset:
    """Records that were measured on one plant.

    `records` holds every record as it was read. What a fit works with are `train` and
    `validation`: simulate each of their records whole and count the error where its `error_mask`
    is True. Where no record has the role ``validation``, both hold the same records, a quarter of
    each, in blocks, counting only in `validation`. Quiet records (constant voltage) are in neither.

    Parameters
    ----------
    title
        What the data set is.
    records
        The records.
    remarks
        What else was left out or decided, one sentence each.
    quantities
        Name, symbol and unit of input and output, as they are printed: the numbers of `u_V` and
        `y_um` are in these units.
    assumed
        Columns whose unit neither header nor settings state: V and µm for ``u`` and ``y``; ``t``, in
        s, where that makes a record of a thousand samples at 20 Hz or slower.

    Examples
    --------
    >>> t = np.arange(100) * 1e-3
    >>> sine = Record("sine", t, np.sin(60 * t), 8 * np.sin(60 * t), ts_s=1e-3)
    >>> rest = Record("rest", t, np.zeros(100), np.zeros(100), ts_s=1e-3)
    >>> data = Dataset("an example", (sine, rest))
    >>> [r.name for r in data.train], [r.name for r in data.quiet]
    (['sine'], ['rest'])
    >>> print(data.describe())
    an example
      sine (train): 100 samples, 0.001 s apart, t = 0 to 0.099 s
      rest (quiet): 100 samples, 0.001 s apart, t = 0 to 0.099 s
      no validation record: a quarter of each record, in blocks, is held out for validation
    """

    title: str
    records: tuple[Record, ...]
    remarks: tuple[str, ...] = ()
    quantities: Quantities = field(default_factory=Quantities)
    assumed: tuple[str, ...] = ()

    @property
    def units_assumed(self) -> str:
        """Line that asks for the units that nothing states; empty where all are stated.

        Examples
        --------
        >>> Dataset("run.csv", (), assumed=("u", "y")).units_assumed
        'no unit is given for u, y: taken as V, µm; --units u=UNIT,y=UNIT gives others'
        """
        if not self.assumed:
            return ""
        units = {"t": "s", **self.quantities.by_column}
        taken = ", ".join(units[column] for column in self.assumed)
        option = ",".join(f"{column}=UNIT" for column in self.assumed)
        return f"no unit is given for {', '.join(self.assumed)}: taken as {taken}; --units {option} gives others"

    def _moving(self, role: Role) -> tuple[Record, ...]:
        return tuple(r for r in self.records if r.role == role and not r.is_quiet)

    @property
    def holds_out_quarters(self) -> bool:
        """Whether train and validation are parts of the same records (none is for validation)."""
        return not self._moving("validation")

    @property
    def train(self) -> tuple[Record, ...]:
        """Records to fit, `error_mask` True where their error counts."""
        records = self._moving("train")
        if self.holds_out_quarters:
            return tuple(hold_out_blocks(r)[0] for r in records)
        return records

    @property
    def validation(self) -> tuple[Record, ...]:
        """Records to check a fit on, `error_mask` True where their error counts."""
        if self.holds_out_quarters:
            return tuple(hold_out_blocks(r)[1] for r in self._moving("train"))
        return self._moving("validation")

    @property
    def test(self) -> tuple[Record, ...]:
        """Records with the role ``test``: in neither `train` nor `validation`."""
        return self._moving("test")

    @property
    def quiet(self) -> tuple[Record, ...]:
        """Records of constant voltage."""
        return tuple(r for r in self.records if r.is_quiet)

    def describe(self) -> str:
        """Say what was read and what was left out, one line a fact."""
        lines = [self.title]
        if not self.quantities.are_standard:
            lines.append(f"  {self.quantities.words}")
        for r in self.records:
            kind = "quiet" if r.is_quiet else r.role
            lines.append(
                f"  {r.name} ({kind}): {r.t_s.size} samples, {r.ts_s:.6g} s apart, "
                f"t = {r.t_s[0]:.6g} to {r.t_s[-1]:.6g} s"
            )
            lines += [f"    {remark}" for remark in r.remarks]
            if r.note:
                lines.append(f"    note: {r.note}")
        if self.train and self.holds_out_quarters:
            lines.append(
                "  no validation record: a quarter of each record, in blocks, is held out for "
                "validation"
            )
        lines += [f"  {remark}" for remark in (*self.remarks, self.units_assumed) if remark]
        return "\n".join(lines)
