"""Choice of the hysteresis core: a few kinds refitted and compared on held-out records."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.diagnosis.notices import Code, Notice
from rdpi_gym.diagnosis.results import CoreChoice
from rdpi_gym.diagnosis.search.candidates import Outcome, Setting, assess
from rdpi_gym.diagnosis.words import template, text_of
from rdpi_gym.identification.cores import first_fit
from rdpi_gym.identification.joint import NO_FIT
from rdpi_gym.identification.kinds import beside, compare_kinds, held_out_fit
from rdpi_gym.identification.residuals import beats
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record
from rdpi_gym.plant import CORES, RDPI
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect, in_chain_order
from rdpi_gym.support.progress import Progress

AUTO = "auto"
"""Asks for every kind that turns as the loops do."""
# Of the RDPI model's mean square, what another kind has to leave to take its place, and how surely:
# before any effect is named where loops turn the wrong way for it, and at the end of a search.
_INSTEAD, _SURE = 0.5, 0.99


@dataclass(frozen=True)
class Fitted:
    """A kind of hysteresis refitted to the records."""

    kind: type[Core]  # the core
    outcome: Outcome  # its refit, with effects beside it

    @property
    def numbers(self) -> int:
        """Numbers of the whole model: gains that are not zero, of the core's shape and of effects."""
        assert self.outcome.fit is not None
        core, effects = self.outcome.fit.variant.hysteresis, self.outcome.fit.variant.effects
        free = sum(
            not p.fixed for each in (core.shape, *(e.parameters for e in effects)) for p in each
        )
        return int(np.count_nonzero(core.gains)) + free


def turning(clockwise: bool | None) -> list[type[Core]]:
    """Return the kinds whose loops turn as those of records do; None, where that is unknown: all."""
    kinds = [kind for name, kind in CORES.items() if name != RDPI.name]
    if clockwise is None:
        return kinds
    return [kind for kind in kinds if kind.clockwise in (None, clockwise)]


def fit_kinds(
    setting: Setting,
    kinds: Sequence[type[Core]],
    report: Progress,
    effects: Sequence[Effect] = (),
    least_um: float = math.inf,
    say: Callable[[str], None] = lambda remark: None,
) -> list[Fitted]:
    """Refit kinds of hysteresis with effects beside them, best held-out error first."""
    found = []
    for done, kind in enumerate(kinds):
        report("kinds of hysteresis", done, len(kinds))
        own = in_chain_order(e for e in effects or beside(setting.scale) if type(e).fits_in(kind))
        try:
            fit = first_fit(setting.train, kind, own, setting.scale, setting.smoothness, least_um)
        except NO_FIT as error:
            say(template("core left out", core=kind.name, error=error))
            continue
        if fit is not None and math.isfinite(fit.train_rmse_um):
            found.append(Fitted(kind, assess(setting, "", fit)))
    report("kinds of hysteresis", len(kinds), len(kinds))
    return sorted(found, key=lambda each: each.outcome.mean_square)


def choose(
    setting: Setting, ways: Sequence[Fitted], clockwise: bool | None, seed: int
) -> CoreChoice:
    """Choose a kind by held-out error, as :func:`~rdpi_gym.identification.kinds.compare_kinds` does."""
    fits = [way.outcome.fit for way in ways if way.outcome.fit is not None]
    told = compare_kinds([held_out_fit(f, setting.validation) for f in fits], setting.train, seed)
    kind = type(told.chosen.core)
    advice = _experiment(kind, [CORES[name] for name in told.alike])
    text = None if advice is None else text_of(advice)
    return CoreChoice(kind.name, told.alike, told.confidence, text, clockwise, advice)


def instead(ways: Sequence[Fitted], of: Outcome, seed: int) -> bool:
    """Whether the best kind leaves so much less than a model that it takes its place."""
    if not ways or ways[0].outcome.mean_square > _INSTEAD * of.mean_square:
        return False
    return beats(of.pieces, ways[0].outcome.pieces, np.random.default_rng(seed)) >= _SURE


def simpler(ways: Sequence[Fitted], of: Fitted, noise_um: float, seed: int) -> list[Fitted]:
    """Return the kinds that explain with no more numbers half of what a model leaves beyond the noise."""
    least = noise_um**2 + _INSTEAD * max(of.outcome.mean_square - noise_um**2, 0.0)
    rng = np.random.default_rng(seed)
    return [
        way
        for way in ways
        if way.numbers <= of.numbers
        and way.outcome.mean_square <= least
        and beats(of.outcome.pieces, way.outcome.pieces, rng) >= _SURE
    ]


def _experiment(kind: type[Core], alike: Iterable[type[Core]]) -> Notice | None:
    """Name the experiment that would tell a kind from those that the records do not tell from it."""
    others = list(alike)
    if not others:
        return None
    ways = {
        Code.LOOPS_WITHIN: [o for o in others if o.wipes_out != kind.wipes_out],
        Code.ONE_LOOP: [o for o in others if o.rated != kind.rated],
    }
    most = max(ways, key=lambda way: len(ways[way]))
    code, told = (most, ways[most]) if ways[most] else (Code.NESTED, others)
    return Notice(code, (kind.name, *(other.name for other in told)))


def begun(setting: Setting, kind: type[Core], effects: Sequence[Effect] = ()) -> Core:
    """Return the core of a kind that a search begins with, to be refitted.

    A kind of one start is convex in its weights: it begins on its comb. Any other begins where a
    first fit ends, or every refit of the search would have to try all of its starts.
    """
    if len(kind.starts(setting.scale)) == 1:
        return kind.comb(setting.scale)
    found = first_fit(setting.train, kind, effects, setting.scale, setting.smoothness)
    assert found is not None
    return found.variant.hysteresis


def on_comb(core: Core, records: Sequence[Record]) -> Core:
    """Return a core on the whole comb of its kind again, with weights where it has them."""
    return core.on(type(core).comb(data_scale(records)))
