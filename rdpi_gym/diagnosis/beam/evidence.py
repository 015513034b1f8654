"""The records of a search as it reads them, and the floor beneath which nothing counts."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Literal

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from rdpi_gym.diagnosis.beam.constants import LEVEL, READ_SAMPLES
from rdpi_gym.diagnosis.features.noise import (
    MeasuredNoise,
    floor_from,
    floor_spread,
    measured_noise,
    quiet_noise,
    rough_parts,
    slowness,
)
from rdpi_gym.diagnosis.notices import Statement
from rdpi_gym.diagnosis.preprocessing import (
    Finding,
    exchanged_roles,
    inspect,
    stretches,
    unknown_past,
)
from rdpi_gym.diagnosis.suitability import falls, thinned, turned
from rdpi_gym.identification.joint import kept_samples
from rdpi_gym.identification.least_squares import BoolArray
from rdpi_gym.identification.plausibility import check_motion, check_scale, orientation
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.measurement.record import Role
from rdpi_gym.plant import CORES
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.plant.effects.base import DataScale
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

_SURE = NormalDist().inv_cdf(1.0 - LEVEL)
"""Standard errors above the noise floor up to which it may be."""

ClockKind = Literal["delay", "skew", "step"]


@dataclass(frozen=True)
class Clock:
    """Fault of a record's clock, or of all records where none is named."""

    kind: ClockKind
    record: str
    # By how much y is late (s), by how much more in each second (1), logarithm of the factor to the
    # time step (1)
    value: float = 0.0

    @property
    def name(self) -> str:
        """Name of the fault, without its size."""
        return f"clock {self.kind} of {self.record or 'all records'}"

    def fits(self, record: Record) -> bool:
        """Whether a record is as long as its fault asks: no delay lasts longer, no time turns back."""
        lasts_s = float(record.t_s[-1] - record.t_s[0])
        most = {"delay": lasts_s, "skew": 1.0, "step": math.log(record.t_s.size)}[self.kind]
        return self.record not in ("", record.name) or abs(self.value) < most

    def mended(self, record: Record) -> Record:
        """Return a record with the command at the times at which its displacement was taken."""
        if self.record not in ("", record.name) or self.value == 0.0:
            return record
        if self.kind == "step":
            ts_s = record.ts_s * math.exp(self.value)
            times = record.t_s[0] + ts_s * np.arange(record.t_s.size)
            return replace(record, ts_s=ts_s, t_s=times)
        past = record.t_s - record.t_s[0]
        late = self.value if self.kind == "delay" else self.value * past
        taken = np.clip(past - late, past[0], past[-1])
        # local, and without the overshoot of splines where a command steps
        return replace(record, u_V=Akima1DInterpolator(past, record.u_V)(taken))


@dataclass(frozen=True)
class Offer:
    """Effects and kinds of core that moves may bring, and effects that they keep."""

    effects: Mapping[str, type[Effect]] = field(default_factory=lambda: CATALOGUE)
    # Kinds of core; the search begins with the one that is asked for, or with all where that is wanted
    cores: tuple[type[Core], ...] = field(default_factory=lambda: tuple(CORES.values()))
    core: type[Core] | None = None
    begins_with_all: bool = False
    kept: tuple[Effect, ...] = ()  # Effects of a model that is given: refitted, and never dropped

    def is_kept(self, name: str) -> bool:
        """Whether no move drops or exchanges an effect."""
        return any(effect.name == name for effect in self.kept)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Records that were looked through, to fit and to judge by."""

    train: tuple[Record, ...]
    validation: tuple[Record, ...]
    scale: DataScale
    noise: MeasuredNoise  # What quiet records and repetitions show without a model
    findings: tuple[Finding, ...]
    clockwise: bool | None  # How the loops turn, where they enclose an area
    sign: float  # -1 where the displacement falls as the voltage rises: it is turned
    dataset: Dataset  # All records as inspection left them, in full
    read: Dataset  # The same with the samples that a search reads
    offer: Offer
    # By record, the samples at its beginning whose past nobody recorded: of those read, and in full
    openings: Mapping[str, tuple[BoolArray, BoolArray]]
    reads_fewer: str | None = None  # Which samples a search reads, where it does not read all
    # What the simulation leaves open at each sample, by record, those to fit first (µm²)
    numerical_um2: tuple[Array, ...] = ()
    is_exchanged: bool = False  # Whether the records to judge by are those that were given to fit

    @classmethod
    def of(cls, dataset: Dataset, offer: Offer | None = None) -> Evidence:
        """Look through a data set, for a search with the moves that are offered.

        Raises
        ------
        InputError
            No record to fit or to judge by in which the input moves.
        """
        if not dataset.train or not dataset.validation:
            raise InputError(
                f"a diagnosis needs records to fit and to validate on; {dataset.title} has "
                f"{len(dataset.train)} and {len(dataset.validation)} in which the "
                f"{dataset.quantities.input.name} moves"
            )
        check_motion(dataset.train)
        check_scale(dataset.train, dataset.quantities)
        sign = -1.0 if falls((*dataset.train, *dataset.validation)) else 1.0
        looked = inspect(dataset if sign > 0.0 else turned(dataset))
        few = thinned(looked.dataset, looked.openings, READ_SAMPLES)
        found = looked.dataset if few is None else few.dataset
        openings = looked.openings if few is None else few.openings
        train, validation = found.train, found.validation
        every = {r.name: r for r in (*train, *validation)}
        return cls(
            train, validation, data_scale((*train, *validation)),
            measured_noise(quiet_noise(found.quiet), tuple(every.values())),
            looked.findings, orientation(train), sign, looked.dataset, found, offer or Offer(),
            {name: (openings[name], whole) for name, whole in looked.openings.items()},
            None if few is None else few.sentence,
        )  # fmt: skip

    @property
    def in_full(self) -> Evidence:
        """The records in full, with their noise."""
        train, validation = self.dataset.train, self.dataset.validation
        whole = {r.name: r for r in (*train, *validation)}
        noise = measured_noise(quiet_noise(self.dataset.quiet), tuple(whole.values()))
        return replace(self, train=train, validation=validation, noise=noise, read=self.dataset)

    def spared(self, at_end: bool = False) -> Evidence:
        """Return the records in the stretches of which memory is known, each with its own offset.

        Or in as many stretches of as many samples, the other way round in time.
        """
        read, whole = (
            _in_stretches(each, self.openings, at_end) for each in (self.read, self.dataset)
        )
        counts = {r.name: r.error_mask for r in joined(whole).records}
        records = [r for r in self.dataset.records if r.name in self.openings]
        left = {r.name: r.error_mask & ~counts[r.name] for r in records}
        return replace(
            self,
            train=read.train,
            validation=read.validation,
            read=read,
            dataset=whole,
            openings={},
            findings=(*self.findings, unknown_past(left)),
        )

    @property
    def exchanged(self) -> Evidence:
        """The records with those to judge by fitted, and those to fit to judge by."""
        read = _exchanged(self.read)
        return replace(
            self,
            train=read.train,
            validation=read.validation,
            read=read,
            dataset=_exchanged(self.dataset),
            findings=(*self.findings, exchanged_roles(read.train, read.validation)),
            clockwise=orientation(read.train),
            numerical_um2=(),
            is_exchanged=True,
        )

    def only_judges(self, clock: Clock) -> bool:
        """Whether a fault is of a record that nothing is fitted to."""
        return bool(clock.record) and all(r.name != clock.record for r in self.train)

    def mended(self, clocks: Sequence[Clock]) -> Evidence:
        """Return the records with their clocks set right."""
        if not clocks:
            return self
        train, validation = list(self.train), list(self.validation)
        for clock in clocks:
            train, validation = ([clock.mended(r) for r in part] for part in (train, validation))
        return replace(self, train=tuple(train), validation=tuple(validation))

    def floor_um(self, lefts: Sequence[Array]) -> float:
        """Return the noise floor (µm rms), by measurement or by what changes from sample to sample."""
        return self.floor(lefts)[0]

    def floor(self, lefts: Sequence[Array]) -> tuple[float, Statement]:
        """Return the noise floor (µm rms) and where the figure comes from."""
        return floor_from(self.noise, rough_parts(lefts), slowness(lefts))

    def floors_um(self, lefts: Sequence[Array], samples: int) -> list[Array]:
        """Return the floor at each sample that so many in all keep (µm), by record.

        The noise at most, and what the simulation leaves open there.
        """
        shown = rough_parts(lefts), slowness(lefts)
        floor_um, _ = floor_from(self.noise, *shown)
        most_um = (1.0 + _SURE * floor_spread(self.noise, *shown)) * floor_um
        if not self.numerical_um2:
            return [np.full(left.size, most_um) for left in lefts]
        kept = [*kept_samples(self.train, samples), *kept_samples(self.validation, samples)]
        pairs = zip(self.numerical_um2, kept, strict=True)
        return [np.sqrt(most_um**2 + opened[index]) for opened, index in pairs]


def _exchanged(dataset: Dataset) -> Dataset:
    """Return records of which those to fit and those to judge by have changed places."""
    roles: Mapping[Role, Role] = {"train": "validation", "validation": "train"}
    turned = [replace(r, role=roles.get(r.role, r.role)) for r in dataset.records]
    return replace(dataset, records=tuple(turned))


def joined(dataset: Dataset) -> Dataset:
    """Return each record once, with all stretches of it that count."""
    found: dict[str, Record] = {}
    for record in dataset.records:
        mask = record.error_mask
        if record.name in found:
            mask = mask | found[record.name].error_mask
        found[record.name] = replace(record, error_mask=mask)
    return replace(dataset, records=tuple(found.values()))


def _in_stretches(dataset: Dataset, names: Collection[str], at_end: bool) -> Dataset:
    """Return some records once for each stretch of known memory, the only one that counts in it."""
    found = list[Record]()
    for record in dataset.records:
        masks = stretches(record) if record.name in names else []
        turn = -1 if at_end else 1
        found += [
            replace(record, error_mask=mask[::turn], past_unknown=True) for mask in masks
        ] or [record]
    return replace(dataset, records=tuple(found))
