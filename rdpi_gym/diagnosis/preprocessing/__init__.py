"""Inspection of records before a fit: faults of samples, clocks and channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from rdpi_gym.diagnosis.features.cycles import (
    BoolArray,
    bridged,
    half_cycles,
    steady_periods,
    widened,
)
from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.diagnosis.notices import Code, Notice, Statement, statement
from rdpi_gym.diagnosis.preprocessing.command import lag, late_by, leads_by, moved, rebuilt_command
from rdpi_gym.diagnosis.preprocessing.faults import (
    MARGIN,
    at_rail,
    clipped_command,
    output_rails,
    silent,
    spikes,
)
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.measurement import MIN_SAMPLES, Dataset, Quantities, Record
from rdpi_gym.support.documents import PLAIN, stored

Silence = Literal["dropout", "frozen"]

_FEWEST = 64  # samples of a record that can be judged
_MOST = 0.9  # of the samples that count: a record that loses more is left as it is


@dataclass(frozen=True, eq=False)
class Inspected:
    """A data set that was looked through.

    Its samples count in every error that is stated, of a fit, a comparison, a search and in the
    laboratory; what a search leaves out of its fits beyond that counts too.
    """

    # The same records. Where a sample is no measurement `error_mask` is False, and spikes, dropouts
    # and frozen stretches are bridged in straight lines, so that what looks at a whole record is
    # not misled by them. A command that was clipped is rebuilt from the displacement, for the
    # memory that it leaves
    dataset: Dataset
    findings: tuple[Finding, ...] = ()  # what was found, record by record
    # By record, the samples (``bool[N]``) at its beginning whose history nobody recorded. They
    # still count: whether they are worse than the rest, a fit has to say
    openings: Mapping[str, BoolArray] = field(default_factory=dict)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Sentences on the samples that do not count; beginnings of unknown history do."""
        return tuple(f.sentence for f in self.findings if f.kind != "in motion")


def unknown_past(openings: Mapping[str, BoolArray]) -> Finding:
    """Say which openings were left out, and why."""
    samples = sum(int(mask.sum()) for mask in openings.values())
    whole = sum(mask.size for mask in openings.values())
    names = list(openings)
    text = statement("unknown past", samples=samples, whole=whole, records=joined_records(names))
    name = names[0] if len(names) == 1 else ""
    return Finding("in motion", name, samples, text, Notice(Code.BEGIN_AFTER_CYCLE))


def exchanged_roles(fitted: Sequence[Record], judged: Sequence[Record]) -> Finding:
    """Say which records are fitted in the place of others, and why."""
    names, others = (joined_records([r.name for r in part]) for part in (fitted, judged))
    text = statement("exchanged", fitted=names, judged=others)
    samples = sum(r.t_s.size for r in fitted)
    name = names if len(fitted) == 1 else ""
    return Finding("exchanged", name, samples, text, Notice(Code.FIT_THESE, (names,)))


def inspect(dataset: Dataset) -> Inspected:
    """Look for what is no measurement: spikes, dropouts, clipping, clocks that part."""
    looked = {r.name: r for r in dataset.records if r.role != "test" and r.t_s.size >= _FEWEST}
    bad = {name: ~r.error_mask for name, r in looked.items()}
    findings: list[Finding] = []
    records = dict(looked)
    for name, record in looked.items():
        outliers, farthest = spikes(record)
        outliers &= record.error_mask
        if outliers.any() and _may_lose(record, outliers):
            findings.append(_spikes(record, outliers, farthest))
            bad[name] = bad[name] | outliers
            records[name] = replace(record, y_um=bridged(record.y_um, outliers))
    moving = [r for r in records.values() if not r.is_quiet]
    rails = output_rails(moving, [bad[r.name] for r in moving])
    for record, ends in zip(moving, rails, strict=True):
        clipped = at_rail(record, ends) & ~bad[record.name]
        if clipped.any() and _may_lose(record, clipped | bad[record.name]):
            findings.append(_clipped(record, clipped))
            bad[record.name] = bad[record.name] | clipped
    for name, record in tuple(records.items()):
        lost, stuck = (widened(at, MARGIN) if at.any() else at for at in silent(record, bad[name]))
        silences: Mapping[Silence, BoolArray] = {"dropout": lost, "frozen": stuck}
        for kind, at in silences.items():
            new = at & ~bad[name]
            if new.any() and _may_lose(record, new | bad[name]):
                findings.append(_silent(record, kind, new))
                bad[name] = bad[name] | new
                records[name] = replace(
                    records[name], y_um=bridged(records[name].y_um, at & record.error_mask)
                )
    uncertain = set()
    for record in [r for r in records.values() if not r.is_quiet]:
        ended = clipped_command(record, bad[record.name])
        unknown = ended & ~bad[record.name]
        if unknown.any() and _may_lose(record, unknown | bad[record.name]):
            rebuilt = rebuilt_command(record, ended, bad[record.name])
            if rebuilt is not None:
                records[record.name] = replace(record, u_V=rebuilt[0])
            missed_V = None if rebuilt is None else rebuilt[1]
            findings.append(_clipped_command(record, unknown, missed_V))
            bad[record.name] = bad[record.name] | unknown
            uncertain.add(record.name)
    findings += _clocks(records, bad, uncertain)
    openings = {}
    moving = [r for r in records.values() if not r.is_quiet]
    span_V = max((float(np.ptp(r.u_V)) for r in moving), default=0.0)
    for record in moving:
        start = opening(record)
        if start is None:
            continue
        openings[record.name] = start
        if begins_in_motion(record, start, span_V):
            findings.append(_in_motion(record, start))
    done = {
        name: replace(record, error_mask=record.error_mask & ~bad[name])
        for name, record in records.items()
    }
    return Inspected(
        replace(dataset, records=tuple(done.get(r.name, r) for r in dataset.records)),
        tuple(replace(each, quantities=dataset.quantities) for each in findings),
        openings,
    )


def _may_lose(record: Record, bad: BoolArray) -> bool:
    counts = int(record.error_mask.sum())
    left = int((record.error_mask & ~bad).sum())
    return left >= max(MIN_SAMPLES, (1.0 - _MOST) * counts)


def _spikes(record: Record, at: BoolArray, farthest: float) -> Finding:
    number = int(at.sum())
    kind = "spikes/one" if number == 1 else "spikes/several"
    text = of_record(kind, number, record, times=farthest)
    return Finding("spikes", record.name, number, text, Notice(Code.CONTACTS))


def _clipped(record: Record, at: BoolArray) -> Finding:
    number = int(at.sum())
    text = of_record("clipped output", number, record)
    return Finding("clipped output", record.name, number, text, Notice(Code.SENSOR_RANGE))


def _silent(record: Record, kind: Silence, at: BoolArray) -> Finding:
    number = int(at.sum())
    text = of_record(f"silent/{kind}", number, record)
    return Finding(kind, record.name, number, text, Notice(Code.SENSOR))


def _clipped_command(record: Record, at: BoolArray, missed_V: float | None) -> Finding:
    number = int(at.sum())
    kind = "clipped input/unknown" if missed_V is None else "clipped input/rebuilt"
    text = of_record(kind, number, record, missed=missed_V)
    return Finding("clipped input", record.name, number, text, Notice(Code.COMMAND_RANGE))


def _in_motion(record: Record, start: BoolArray) -> Finding:
    number = int(start.sum())
    text = of_record("in motion", number, record)
    return Finding("in motion", record.name, number, text, Notice(Code.BEGIN_AT_REST))


def _clocks(
    records: dict[str, Record], bad: dict[str, BoolArray], uncertain: set[str]
) -> list[Finding]:
    """Move displacements that lead, in place; say what is late by samples."""
    # where a part of the command is unknown, so is the memory that tells a lag
    moving = [r for r in records.values() if not r.is_quiet and r.name not in uncertain]
    lags = [each for r in moving if (each := lag(r, bad[r.name])) is not None]
    leads = leads_by(lags)
    found: list[Finding] = []
    for name, samples in leads.items():
        record = records[name]
        y, lost = moved(record, samples)
        records[name] = replace(record, y_um=y)
        bad[name] = bad[name] | lost
    groups: dict[float, list[str]] = {}
    for name, samples in leads.items():
        groups.setdefault(samples, []).append(name)
    advice = Notice(Code.ONE_CLOCK)
    for samples, names in groups.items():
        kind = "clock/lead by one" if samples == 1.0 else "clock/lead"
        text = statement(kind, samples=samples, records=joined_records(names))
        size = sum(records[name].t_s.size for name in names)
        found.append(Finding("clock", names[0] if len(names) == 1 else "", size, text, advice))
    late = late_by(lags)
    if late > 0.0:
        size = sum(r.t_s.size for r in moving)
        found.append(Finding("clock", "", size, statement("clock/late", samples=late), advice))
    return found


# Of the swing: by so much may the range grow within a stretch. The further ones count where the nearest
# keeps too little.
_NEAR = (0.002, 0.02, 0.1, 0.2)
_KEPT = 0.75  # Of the samples that count: little is left out where the range allows it
_STRETCHES = 3  # Of a record, the longest: each has an offset of its own to fit
_SHORTEST = 0.05  # Of a record: of a shorter stretch an offset takes most
_FEWEST_LEFT = 16
_WIDE = 0.3  # of the widest swing: memory shows
_ALIKE_NOISE, _ALIKE = 2.0, 2e-3  # times the noise; of the stroke
_SEEN_NOISE, _SEEN = 3.0, 0.01  # half of the way between branches, where there is memory
_DEGREE = 5


def stretches(record: Record) -> list[BoolArray]:
    """Samples of a record whose memory is known but for an offset, stretch by stretch, the longest first.

    A stretch is where the command stays within the range that it has passed before. A play that is
    narrower than the range has forgotten how the record began, and a wider one does not move there.
    """
    whole, before = record.with_history.u_V, record.before_V.size
    span_V = (np.maximum.accumulate(whole) - np.minimum.accumulate(whole))[before:]
    places, found = np.arange(span_V.size), list[BoolArray]()
    for near in _NEAR:
        ends = np.searchsorted(span_V, span_V + near * span_V[-1], "right")
        found, end = [], 0
        for start in np.flatnonzero(ends - places >= _SHORTEST * span_V.size):
            if start >= end:
                end = ends[start]
                found.append(record.error_mask & (start <= places) & (places < end))
        found.sort(key=np.count_nonzero, reverse=True)
        found = [mask for mask in found[:_STRETCHES] if mask.sum() >= _FEWEST_LEFT]
        if sum(mask.sum() for mask in found) >= _KEPT * record.error_mask.sum():
            break
    return found


def opening(record: Record) -> BoolArray | None:
    """Samples before the longest stretch of known memory; None where nothing is before it."""
    known = next(iter(stretches(record)), None)
    if known is None:
        return None
    mask = np.arange(known.size) < int(np.argmax(known))
    return mask if mask.sum() >= 3 and (mask & record.error_mask).any() else None


def begins_in_motion(record: Record, start: BoolArray, span_V: float) -> bool:
    """Whether a record shows that it begins in motion.

    Its periods are alike from the first one on although there is memory to be seen: the same
    command ran before. A record without periods shows nothing; a fit has to say.
    """
    u, y = record.u_V, record.y_um
    if float(np.ptp(u)) < _WIDE * span_V:
        return False
    periods = steady_periods(record, half_cycles(u, record.ts_s))
    if periods is None or periods.first > 0:
        return False
    commands, rows = periods.folded(u)[0], periods.folded(y)
    usual = rows[1:].mean(axis=0)
    noise = rough_part(y)
    # about the curve between the branches, a loop lies on the one side as the command rises
    degree = min(_DEGREE, np.unique(commands.round(9)).size - 1)
    single = np.polynomial.Polynomial.fit(commands, usual, degree)(commands)
    apart = (usual - single) * np.sign(np.gradient(commands))
    if abs(float(apart.mean())) < max(_SEEN_NOISE * noise, _SEEN * float(np.ptp(usual))):
        return False
    size = max(int(start.sum()), 3)
    differ = rows[0, :size] - usual[:size]
    allowed = max(_ALIKE_NOISE * noise, _ALIKE * float(np.ptp(usual)))
    return bool(np.sqrt(np.mean(differ**2)) < allowed)


@dataclass(frozen=True)
class Finding:
    """A fault found in one record.

    Parameters
    ----------
    kind
        ``spikes``, ``dropout``, ``frozen``, ``clipped output``, ``clipped input``, ``clock``,
        ``in motion`` or ``exchanged``.
    record
        Name of the record; empty where it is said of several.
    samples
        How many samples it touches.
    text
        What was found and what was done about it; of a file, as it stands there.
    advice
        What a better measurement would do; None in files without it.
    step
        The advice as it stands in a file; None: in the words of this version.
    quantities
        What was measured: the sentence uses its words and units.
    """

    kind: str
    record: str
    samples: int
    text: Statement | str = field(metadata=stored("sentence"))
    advice: Notice | None = None
    step: str | None = field(default=None, compare=False, metadata=stored("next_step"))
    quantities: Quantities = field(default_factory=Quantities, metadata=stored(omitted=True))

    @property
    def sentence(self) -> str:
        """The fault and what was done about it, in words."""
        return self.text if isinstance(self.text, str) else text_of(self.text, self.quantities)

    @property
    def next_step(self) -> str:
        """The advice in words."""
        if self.step is not None:
            return self.step
        return "" if self.advice is None else text_of(self.advice, self.quantities)

    def to_dict(self) -> dict[str, Any]:
        """Return it as a JSON object."""
        return {
            "kind": self.kind,
            "record": self.record,
            "samples": self.samples,
            "sentence": self.sentence,
            "next_step": self.next_step,
            "advice": None if self.advice is None else self.advice.to_dict(),
        }

    @classmethod
    def from_dict(cls, document: Any, source: str = "finding") -> Finding:
        """Build from the object of the files; its sentences stay as they are."""
        return PLAIN.read_fields(cls, document, source)


def of_record(code: str, samples: int, record: Record, **values: object) -> Statement:
    """Return a statement on some samples of a record, with the share of it that they are (%)."""
    share = 100.0 * samples / record.t_s.size
    return Statement(code, {"samples": samples, "share": share, "record": record.name, **values})


def joined_records(names: Sequence[str], most: int = 3) -> str:
    """Name a few records, and how many more there are."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
