"""Portrait of an effect that the catalogue does not have: its numbers, its file and its sentences."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rdpi_gym.diagnosis.notices import Statement, statement
from rdpi_gym.diagnosis.words import template
from rdpi_gym.support.documents import Document, stored
from rdpi_gym.support.words import number


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
class Portrait(Document):
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
    before_um: float = field(metadata=stored("validation_rmse_before"))
    after_um: float = field(metadata=stored("validation_rmse_after"))
    form: str
    nearest: tuple[Kin, ...]
    experiment: str
    sentences: tuple[str, ...]

    def __repr__(self) -> str:
        return "\n".join(self.sentences)

    def to_dict(self) -> dict[str, Any]:
        """Return the object of the files."""
        document = super().to_dict()
        for key in ("validation_rmse_before", "validation_rmse_after"):
            document[key] = document.pop(key)
        return document


_DRIFTS = 2.0  # errors from which on a change is one
_ALL = 0.99  # of a few hundred draws, a share that is written as a bound
_SLIGHT = 0.05  # a share that is left out
_RATED = 0.3  # power of the rate from which on an effect is driven by it


def experiment_for(drawn: Portrait) -> Statement:
    """Return the experiment that would show the effect best, or tell what is open."""
    if drawn.place is None:
        first, second, *_ = sorted(drawn.places, key=lambda name: -drawn.places[name])
        return statement(f"to portray/between/{'+'.join(sorted((first, second)))}")
    driven = drawn.rate_power is not None and drawn.rate_power.value > _RATED
    if drawn.time_constants_s:
        seconds = number(3.0 * drawn.time_constants_s[0].value, 2)
        return statement("to portray/fast" if driven else "to portray/rests", seconds=seconds)
    return statement("to portray/rates" if driven else "to portray/curve")


def sentences_of(drawn: Portrait) -> tuple[str, ...]:
    """Return the portrait in words, as templates, the answer with its number first."""
    kin = [statement("portrait/kin", effect=k.effect, differs=k.differs) for k in drawn.nearest]
    found = [
        statement(
            "portrait/error", before=drawn.before_um, after=drawn.after_um,
            form=repr(drawn.form or "static, behind"),
        ),
        _place(drawn),
        statement("portrait/nature", memory=_memory(drawn), parity=_parity(drawn)),
        _growth(drawn),
        _drift(drawn),
        statement("portrait/nearest", kin=kin) if kin else None,
        statement("portrait/experiment", experiment=experiment_for(drawn)),
    ]  # fmt: skip
    return tuple(template(each.code, **each.values) for each in found if each is not None)


def _share(share: float) -> Statement:
    return statement("share/all" if share > _ALL else "share", percent=100.0 * share)


def _place(drawn: Portrait) -> Statement:
    if drawn.place is not None:
        return statement(f"portrait/place/{drawn.place}", share=_share(drawn.places[drawn.place]))
    order = sorted(drawn.places, key=lambda name: -drawn.places[name])
    shares = tuple(
        statement("portrait/other place" if k else "portrait/first place", place=n, share=_share(s))
        for k, n in enumerate(order)
        if (s := drawn.places[n]) > _SLIGHT
    )
    return statement("portrait/place open", shares=shares)


def _memory(drawn: Portrait) -> Statement:
    if drawn.memory is None:
        return statement("portrait/memory open", share=_share(drawn.memories))
    if not drawn.memory:
        return statement("portrait/no memory")
    seconds = tuple(statement("seconds", value=(v.value, v.error)) for v in drawn.time_constants_s)
    return statement(
        "portrait/memories" if len(seconds) > 1 else "portrait/memory", seconds=seconds
    )


def _parity(drawn: Portrait) -> Statement:
    if drawn.parity is not None:
        return statement(f"portrait/parity/{drawn.parity}")
    shares = tuple(
        statement("portrait/share of parity", parity=name, share=_share(share))
        for name, share in drawn.parities.items()
        if share > _SLIGHT
    )
    return statement("portrait/parity open", shares=shares)


def _growth(drawn: Portrait) -> Statement:
    if drawn.power is None or drawn.rate_power is None:
        return statement("portrait/no power")
    powers = {"portrait/amplitude": drawn.power, "portrait/rate": drawn.rate_power}
    grows = tuple(
        Statement(code, {"power": (each.value, each.error)})
        for code, each in powers.items()
        if each.error > 0.0 or each.value > 0.0
    )
    return statement("portrait/growth", ways=grows)


def _drift(drawn: Portrait) -> Statement | None:
    drift = drawn.drift_percent
    if drift is None:
        return None
    sure = abs(drift.value) > _DRIFTS * drift.error
    kind = "portrait/drift" if sure else "portrait/no drift"
    return statement(kind, change=(drift.value, drift.error))
