"""How sure an effect is: the share of ways to split the records in which it is chosen again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.diagnosis.search.candidates import Outcome, Setting, assess, attempt
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.identification.residuals import beats
from rdpi_gym.measurement import Record, hold_out_blocks
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect, in_chain_order

# Samples and passes of a refit that begins where the final model stands.
_SAMPLES, _PASSES = 8_000, 6
# Of a record, the part at its beginning that one split leaves out of the fit.
_OPENING = 8
WITHIN = (
    "the records to validate on do not show what those to fit ask for, as a drift of a later record "
    "cannot be told from an earlier one: a quarter of every record, in blocks, is held out from "
    "here on"
)
"""Said where an effect is judged within the records."""
LEAST_STABLE = 0.5
"""Share of the splits below which an effect is not kept."""


@dataclass(frozen=True)
class Standing:
    """How an effect stands in a model.

    Parameters
    ----------
    confidence
        How sure it is: the mean over the splits of how often it wins there, 0 to 1.
    without_um
        Validation error (µm rms) of all the others without it, as the records are given.
    """

    confidence: float
    without_um: float


@dataclass(frozen=True)
class Split:
    """One way to fit and to judge.

    Parameters
    ----------
    name
        In words.
    train, validation
        Records with the samples that count.
    """

    name: str
    train: tuple[Record, ...]
    validation: tuple[Record, ...]


def splits(setting: Setting, quarters: bool) -> tuple[Split, ...]:
    """Return the ways to split a data set beside the one that is given.

    Notes
    -----
    The given split; the beginning of each record left out; the roles exchanged; half of the
    validation record added to those to fit. Where quarters of the same records are held out, the
    others take their turns.
    """
    given = Split("as given", setting.train, setting.validation)
    opening = Split(
        "without the beginning of each record",
        tuple(_without_opening(r) for r in setting.train),
        setting.validation,
    )
    if quarters:
        turns = [_turn(setting, k) for k in (0, 1, 2)]
        return (given, *turns)
    halves = [_halves(r) for r in setting.validation]
    more = (*setting.train, *(first for first, _ in halves))
    return (
        given,
        opening,
        Split("roles exchanged", setting.validation, setting.train),
        Split("half of the validation records to fit", more, tuple(b for _, b in halves)),
    )


def in_blocks(setting: Setting) -> Setting:
    """Return a data set in which blocks of every record are held out in turn."""
    parts = [hold_out_blocks(r) for r in dict.fromkeys((*setting.train, *setting.validation))]
    return replace(
        setting, train=tuple(fit for fit, _ in parts), validation=tuple(held for _, held in parts)
    )


def exchanged(setting: Setting, quarters: bool) -> Setting | None:
    """Return a data set with the roles of its records exchanged; None where they are the same ones."""
    if quarters:
        return None
    return setting.exchanged()


def _without_opening(record: Record) -> Record:
    counted = np.flatnonzero(record.error_mask)
    mask = record.error_mask.copy()
    mask[counted[: len(counted) // _OPENING]] = False
    return replace(record, error_mask=mask)


def _halves(record: Record) -> tuple[Record, Record]:
    counted = np.flatnonzero(record.error_mask)
    middle = counted[len(counted) // 2]
    before = np.arange(len(record.error_mask)) < middle
    return (
        replace(record, error_mask=record.error_mask & before),
        replace(record, error_mask=record.error_mask & ~before),
    )


def _turn(setting: Setting, quarter: int) -> Split:
    """Hold out another quarter of each record; the two of a setting hold all samples together."""
    train, validation = [], []
    for fitted, held in zip(setting.train, setting.validation, strict=True):
        counted = np.flatnonzero(fitted.error_mask | held.error_mask)
        mask = np.zeros_like(fitted.error_mask)
        mask[np.array_split(counted, 4)[quarter]] = True
        whole = fitted.error_mask | held.error_mask
        train.append(replace(fitted, error_mask=whole & ~mask))
        validation.append(replace(held, error_mask=mask))
    return Split(f"quarter {quarter + 1} held out", tuple(train), tuple(validation))


def stability(
    setting: Setting,
    outcome: Outcome,
    rivals: Mapping[str, Sequence[Effect]],
    quarters: bool,
    seed: int,
    report: Callable[[int, int], None],
) -> dict[str, Standing]:
    """Return how each effect stands: how often it wins in splits, and what is missed without it."""
    assert outcome.fit is not None
    variant, smoothness = outcome.fit.variant, outcome.fit.smoothness
    ways = splits(setting, quarters)
    won: dict[str, list[float]] = {name: [] for name in rivals}
    without_um: dict[str, float] = {}
    rng = np.random.default_rng(seed)
    for done, split in enumerate(ways):
        report(done, len(ways))
        here = replace(setting, train=split.train, validation=split.validation)
        full = _quick(here, variant.hysteresis, variant.effects, smoothness)
        for name, others in rivals.items():
            kept = tuple(e for e in variant.effects if e.name != name)
            fields = [kept, *(in_chain_order([*kept, rival]) for rival in others)]
            outcomes = [_quick(here, variant.hysteresis, f, smoothness) for f in fields]
            shares = (beats(o.pieces, full.pieces, rng) for o in outcomes if o.fit is not None)
            won[name].append(0.0 if full.fit is None else min(shares, default=1.0))
            if split is ways[0]:
                without_um[name] = outcomes[0].errors.validation_rmse_um
    return {name: Standing(float(np.mean(won[name])), without_um[name]) for name in rivals}


def _quick(
    setting: Setting, hysteresis: Core, effects: Sequence[Effect], smoothness: float
) -> Outcome:
    def refitted() -> Outcome:
        fit = fit_joint(
            setting.train, hysteresis, effects, _PASSES, samples=_SAMPLES, smoothness=smoothness
        )
        return assess(setting, "", fit)

    return attempt(refitted)
