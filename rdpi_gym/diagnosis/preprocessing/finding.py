"""One thing that is wrong with a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from rdpi_gym.diagnosis.notices import Notice, Statement
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.measurement import Quantities, Record
from rdpi_gym.support.documents import PLAIN, stored


@dataclass(frozen=True)
class Finding:
    """A fault found in one record.

    Parameters
    ----------
    kind
        ``spikes``, ``dropout``, ``frozen``, ``clipped output``, ``clipped input``, ``clock`` or
        ``in motion``.
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
