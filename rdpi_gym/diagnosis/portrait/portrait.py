"""What is known of an effect that the catalogue does not have, as it stands in files and sentences."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from rdpi_gym.support.fields import Fields


@dataclass(frozen=True)
class Value:
    """A number of the portrait.

    Parameters
    ----------
    value, error
        In the unit of its field; the error is the larger of the standard error of the fit and half of
        what the records held out say differently.
    """

    value: float
    error: float

    @classmethod
    def from_fields(cls, fields: Fields) -> Value:
        """Build from the object of the files."""
        return cls(fields.number("value"), fields.number("error"))


@dataclass(frozen=True)
class Kin:
    """An effect of the catalogue that comes near.

    Parameters
    ----------
    effect
        Its name.
    differs
        In what it differs, in words.
    """

    effect: str
    differs: str


@dataclass(frozen=True, repr=False)
class Portrait:
    """Where an unknown effect sits in the chain, and what it goes by.

    Parameters
    ----------
    place
        ``before``, ``in`` or ``behind`` the hysteresis; None where these records cannot tell.
    places
        By place, the share of draws of the records in which a block there is best.
    memory
        Whether it has a memory; None where these records cannot tell.
    memories
        The share of draws in which a block with one is best.
    time_constants_s
        Of its memory or two (s), the one with the larger weight first; empty without one.
    parity
        ``even`` or ``odd``: what becomes of it where the command is mirrored about the middle of its
        range; ``both``: parts of either kind; None where these records cannot tell.
    parities
        By parity, the share of draws.
    power, rate_power
        With which power of the amplitude and of the rate it grows; None where no power describes it.
    drift_percent
        By how much it changes from the first to the last record (%); None where that cannot be told.
    before_um, after_um
        Validation error without and with the block (µm rms).
    form
        Of the effect ``unknown`` that takes most.
    nearest
        Effects of the catalogue that come nearest, with what differs.
    experiment
        That would show it best.
    sentences
        All of it in words.
    """

    place: str | None
    places: dict[str, float]
    memory: bool | None
    memories: float
    time_constants_s: tuple[Value, ...]
    parity: str | None
    parities: dict[str, float]
    power: Value | None
    rate_power: Value | None
    drift_percent: Value | None
    before_um: float
    after_um: float
    form: str
    nearest: tuple[Kin, ...]
    experiment: str
    sentences: tuple[str, ...]

    def __repr__(self) -> str:
        return "\n".join(self.sentences)

    def to_dict(self) -> dict[str, Any]:
        """Return the object of the files."""
        document = asdict(self)
        document["validation_rmse_before"] = document.pop("before_um")
        document["validation_rmse_after"] = document.pop("after_um")
        for name in ("time_constants_s", "nearest", "sentences"):
            document[name] = list(document[name])
        return document

    @classmethod
    def from_fields(cls, fields: Fields) -> Portrait:
        """Build from the object of the files."""

        def value(name: str) -> Value | None:
            return None if fields.raw(name) is None else Value.from_fields(fields.inner(name))

        memory = fields.raw("memory")
        return cls(
            place=fields.optional_text("place"),
            places=dict(fields.numbers("places")),
            memory=None if memory is None else bool(memory),
            memories=fields.number("memories"),
            time_constants_s=tuple(map(Value.from_fields, fields.objects("time_constants_s"))),
            parity=fields.optional_text("parity"),
            parities=dict(fields.numbers("parities")),
            power=value("power"),
            rate_power=value("rate_power"),
            drift_percent=value("drift_percent"),
            before_um=fields.number("validation_rmse_before"),
            after_um=fields.number("validation_rmse_after"),
            form=fields.text("form"),
            nearest=tuple(
                Kin(each.text("effect"), each.text("differs")) for each in fields.objects("nearest")
            ),
            experiment=fields.text("experiment"),
            sentences=fields.texts("sentences"),
        )
