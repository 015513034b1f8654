"""Statements of a diagnosis by code: limits of the records, reservations, advice, findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from rdpi_gym.support.documents import PLAIN, Document


class Code(Enum):
    """Subject of a notice; :mod:`rdpi_gym.diagnosis.texts` has its text."""

    # limits of the records
    STILL = "no record moves"
    FEW_SAMPLES = "few samples"  # samples, samples that would do
    UNRELATED = "hardly related"  # share of the output's power that follows the input (1)
    ONE_RECORD = "one record"
    FEW_HALF_CYCLES = "few half-cycles"  # whole half-cycles
    ONE_FREQUENCY = "one frequency"  # of the half-cycles (Hz)
    ONE_AMPLITUDE = "one amplitude"
    NO_REST = "no rest"
    NO_SMALL_SIGNALS = "no small signals"
    NO_REPETITION = "no repetition"
    # reservations that a verdict is under: sampling rate that would do (Hz) or stamps (s) first
    STEP_TOO_LONG = "step too long"  # what it changes (µm)
    STAMPS_UNEVEN = "stamps uneven"  # what they change (µm)
    MOTION_BETWEEN = (
        "motion between samples"  # rate of the record (Hz), steps, what they leave (µm)
    )
    EFFECT_TOO_FAST = "effect too fast"  # its parameter, highest rate of the records (Hz)
    # motions to record
    LONGER = "longer record"
    DECAYING = "decaying triangle"
    RATES = "sines at four rates"
    BIASES = "triangle and loops at three biases"
    HOLDS = "steps with holds"
    SMALL = "small multisine"
    TWICE = "same motion twice"
    OTHER_MOTION = "other motion"
    STANDARD = "standard protocol"
    EFFECTS_APART = "effects apart"  # record of the standard protocol, two effects; slowness
    LOOPS_WITHIN = "loops within a loop"  # kind of hysteresis, its rivals
    ONE_LOOP = "one loop at four rates"  # kind of hysteresis, its rivals
    NESTED = "nested loops"  # kind of hysteresis, its rivals
    FASTER = "same motion faster"
    CLOCKED = "same motion by one clock"
    # what to mend
    CONTACTS = "contacts"
    SENSOR_RANGE = "range of the sensor"
    SENSOR = "sensor"
    COMMAND_RANGE = "range of the command"
    BEGIN_AT_REST = "begin at rest"
    BEGIN_AFTER_CYCLE = "begin after a cycle"
    FIT_THESE = "fit these records"  # records
    ONE_CLOCK = "one clock"
    SAMPLING_TIME = "sampling time"  # record
    TRIGGER = "trigger"  # record


_SINES = ("sine-10hz", "sine-50hz", "sine-100hz-half", "sine-200hz-quarter")
RECORDS: Mapping[Code, tuple[str, ...]] = {
    Code.DECAYING: ("triangle-slow",),
    Code.RATES: _SINES,
    Code.BIASES: ("triangle-slow", "minor-loops"),
    Code.HOLDS: ("stairs",),
    Code.SMALL: ("multisine-small",),
    Code.TWICE: ("triangle-slow-again", "triangle-slow"),
    Code.OTHER_MOTION: ("validation-loops",),
    Code.STANDARD: (
        "triangle-slow", "sine-10hz", "sine-50hz", "sine-100hz-half", "multisine", "stairs",
    ),
    Code.LOOPS_WITHIN: ("minor-loops",),
    Code.ONE_LOOP: _SINES,
    Code.NESTED: ("minor-loops",),
}  # fmt: skip
"""Records of the standard protocol that an advice asks for."""
_AGAIN: Mapping[Code, float] = {Code.FASTER: 4.0, Code.CLOCKED: 1.0}


@dataclass(frozen=True)
class Statement:
    """A sentence of the table of texts by its code, with its values.

    Parameters
    ----------
    code
        Key of :data:`rdpi_gym.diagnosis.texts.TEXTS`.
    values
        What the text has fields for: numbers in base units, a value with its standard error, names
        of records and effects, another statement.
    """

    code: str
    values: Mapping[str, object] = field(default_factory=dict)

    @classmethod
    def from_dict(cls, document: Any, source: str) -> Statement:
        """Build from a sentence of a file, which stays as it is."""
        return cls("as written", {"text": PLAIN.read(str, document, source)})


def statement(code: str, **values: object) -> Statement:
    """Return a statement."""
    return Statement(code, values)


@dataclass(frozen=True)
class Notice(Document):
    """A limit of the records, a reservation, or an advice.

    Parameters
    ----------
    code
        What it is about.
    names
        Records, effects and kinds that it names, in the order that the code states.
    numbers
        In base units, in the order that the code states.
    """

    code: Code
    names: tuple[str, ...] = ()
    numbers: tuple[float, ...] = ()

    @property
    def records(self) -> tuple[str, ...]:
        """Records of the standard protocol that it asks for; none where it asks for none."""
        return self.names[:1] if self.code is Code.EFFECTS_APART else RECORDS.get(self.code, ())

    @property
    def again(self) -> float | None:
        """Times its own rate at which the first record is to be made again; None where it is not."""
        return _AGAIN.get(self.code)
