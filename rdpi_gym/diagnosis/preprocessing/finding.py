"""One thing that is wrong with a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis.notices import Notice
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.fields import Fields
from rdpi_gym.support.words import digits

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Finding:
    """What was found in one record.

    Parameters
    ----------
    kind
        ``spikes``, ``dropout``, ``frozen``, ``clipped output``, ``clipped input``, ``clock`` or
        ``in motion``.
    record
        Name of the record; empty where it is said of several.
    samples
        How many samples it touches.
    sentence
        What was found and what was done about it.
    next_step
        What a better measurement would do.
    advice
        The same as a notice; None in files without it.
    """

    kind: str
    record: str
    samples: int
    sentence: str
    next_step: str = ""
    advice: Notice | None = None

    @classmethod
    def of(cls, kind: str, record: str, samples: int, sentence: str, advice: Notice) -> Finding:
        """Build one with the text of its advice."""
        return cls(kind, record, samples, sentence, text_of(advice), advice)

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
    def from_fields(cls, fields: Fields) -> Finding:
        """Build from the object of the files."""
        return cls(
            fields.text("kind"),
            fields.text("record"),
            int(fields.number("samples")),
            fields.text("sentence"),
            fields.text("next_step"),
            Notice.optional(fields, "advice"),
        )


def counted(samples: int, record: Record) -> str:
    """Say how many samples of a record, and which share of it."""
    share = digits(100.0 * samples / record.t_s.size)
    return f"{samples} sample{'s' if samples != 1 else ''} ({share} %) of {record.name}"


def runs(at: BoolArray) -> list[tuple[int, int]]:
    """Return where a condition holds without a break: first sample, and one past the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def widened(at: BoolArray, margin: int) -> BoolArray:
    """Widen a mask by some samples to either side."""
    wide = at.copy()
    for shift in range(1, margin + 1):
        wide[shift:] |= at[:-shift]
        wide[:-shift] |= at[shift:]
    return wide


def bridged(x: Array, bad: BoolArray) -> Array:
    """Carry a trace across the samples that are no measurement, in straight lines."""
    if not bad.any() or bad.all():
        return x
    k = np.arange(x.size)
    patched = x.copy()
    patched[bad] = np.interp(k[bad], k[~bad], x[~bad])
    return patched


def smallest_step(x: Array) -> float:
    """Return the smallest change from sample to sample: the step of a recorder that is coarse."""
    if x.size < 2:
        return 0.0
    steps = np.abs(np.diff(x))
    moved = steps[steps > 1e-9 * max(float(np.ptp(x)), 1e-300)]
    return float(moved.min()) if moved.size else 0.0


def gain(u: Array, y: Array) -> float:
    """Return the size of the response over the command, whatever single samples say, with its sign."""
    low, high = np.quantile(y, (0.02, 0.98))
    swing = float(np.ptp(u))
    if swing == 0.0:
        return 0.0
    moment = float(np.mean((u - u.mean()) * (np.clip(y, low, high) - np.median(y))))
    return float(np.sign(moment)) * float(high - low) / swing


def joined_records(names: Sequence[str], most: int = 3) -> str:
    """Name a few records, and how many more there are."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
