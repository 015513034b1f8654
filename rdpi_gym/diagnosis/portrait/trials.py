"""Free blocks refitted at every place, with and without memory, even and odd, on the same records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, get_args

import numpy as np

from rdpi_gym.diagnosis.search.setting import Outcome, Setting, assess, assess_refit
from rdpi_gym.identification.joint import fit_joint, or_none
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, forms_of, in_chain_order
from rdpi_gym.plant.effects.unknown import Block, Place, Unknown, is_even
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.progress import Progress

# Passes and samples in which every start shows which are worth the rest: two of many where they are as near as this.
_FIRST_PASSES, _FIRST_SAMPLES, _MANY, _AS_NEAR = 4, 4_000, 3, 1.1
_PASSES, SAMPLES = 20, 10_000
# A memory that is shorter than so many samples is none.
_LEAST_SAMPLES = 2.0
# Times the least squared error, on the records held out, that a memory may leave to be worth a second.
_WORTH_A_SECOND = 2.0


def learn(
    setting: Setting,
    hysteresis: Core,
    present: Sequence[Effect],
    starts: Sequence[Effect],
    held: frozenset[str] = frozenset(),
) -> Outcome:
    """Refit a block with the hysteresis and all effects, from the best of some starts."""
    fields = [in_chain_order([*present, start]) for start in starts]
    begun = [(hysteresis, effects) for effects in fields]
    if len(fields) > 1:
        first = [
            fit_joint(
                setting.train, hysteresis, effects, _FIRST_PASSES, held=held,
                samples=_FIRST_SAMPLES,
            )
            for effects in fields
        ]  # fmt: skip
        best = sorted(first, key=lambda fit: fit.train_rmse_um)[: 2 if len(first) >= _MANY else 1]
        near = _AS_NEAR * best[0].train_rmse_um
        begun = [
            (fit.variant.hysteresis, fit.variant.effects)
            for fit in best
            if fit.train_rmse_um <= near
        ]
    fits = [
        fit_joint(setting.train, core, effects, _PASSES, held=held, samples=SAMPLES)
        for core, effects in begun
    ]
    return assess_refit(setting, Unknown.name, min(fits, key=lambda fit: fit.train_rmse_um))


def learn_forms(
    setting: Setting,
    hysteresis: Core,
    present: Sequence[Effect],
    kind: type[Effect],
    progress: Progress,
) -> list[Outcome]:
    """Refit the forms of the block; those with two memories where one memory comes near the best.

    Forms that do not converge are left out, and those whose memory came out shorter than the samples:
    they are static ones that a compensator takes for what they are not.
    """
    kinds = forms_of(kind)
    found: dict[str, Outcome] = {}
    for done, form in enumerate(kinds):
        progress(f"forms of {form.name}", done, len(kinds))
        simpler = found.get(one := form.form.replace("two memories", "memory"))
        starts: Sequence[Effect] = form.starts(setting.scale)
        if one != form.form:
            if simpler is None or simpler.mean_square > _WORTH_A_SECOND * min(
                o.mean_square for o in found.values()
            ):
                continue
            starts = form.from_simpler(simpler.fitted, setting.scale)
        make = partial(learn, setting, hysteresis, present, starts)
        refit = or_none(make)
        if refit is not None:
            found[form.form] = refit
    progress(f"forms of {kind.name}", len(kinds), len(kinds))
    return [each for each in found.values() if are_shown(each.fitted, setting.scale)]


def are_shown(block: Effect, scale: DataScale) -> bool:
    """Whether the samples show all memories that a block has."""
    taus = (v for name, v in block.values.items() if name.startswith("time_constant"))
    return all(tau >= _LEAST_SAMPLES * scale.shortest_s for tau in taus)


Nature = Literal["static", "of the rate", "with memory", "with two memories"]
Parity = Literal["even", "odd", "both"]
_WEIGHTS = frozenset(p.name for k in forms_of(Unknown) for p in k.parameters if p.neutral == 0.0)
PLACES: tuple[Place, ...] = ("before", "in", "behind", "beside")
_DRAWS = 400
# Of the logarithm of the error, what a second memory or a second parity has to take.
_WORTH = 0.15
# The same by which a nature may be worse, of either parity, for each parity to be tried alone.
_NEAR = 0.7


@dataclass(frozen=True)
class Tried:
    """One block that was refitted."""

    # Where it stands, and what it has
    place: Place
    nature: Nature
    drive: Parity  # which terms it was allowed: of s even, odd, or both
    outcome: Outcome  # the refit
    # tuple of float64[R, P]: mean squares (µm²) of pieces of the records to fit and of those held
    # out
    pieces: tuple[Array, Array]
    held: frozenset[str] = frozenset()  # parameters that stayed at zero, as ``unknown.parameter``

    @property
    def block(self) -> Effect:
        """As it was fitted."""
        return self.outcome.fitted

    @property
    def parity(self) -> Parity:
        """Parity under a mirrored command; in the weights of plays, which are odd, the opposite of the drive's."""
        if self.place != "in" or self.drive == "both":
            return self.drive
        return "odd" if self.drive == "even" else "even"

    @property
    def time_constants_s(self) -> tuple[float, ...]:
        """Time constants of its memories (s), that with the largest weights first."""
        values = self.block.values
        found = []
        for name, tau in values.items():
            if name.startswith("time_constant"):
                number = name.removeprefix("time_constant").removesuffix("_s")
                own = [abs(w) for n, w in values.items() if n.endswith(number) and n in _WEIGHTS]
                found.append((sum(own), tau))
        return tuple(tau for _, tau in sorted(found, reverse=True))

    @property
    def score(self) -> float:
        """Mean logarithm of the squared errors of the records to fit and of those held out."""
        return float(np.mean([np.log(p.mean()) for p in self.pieces]))


def try_all(
    setting: Setting,
    hysteresis: Core,
    present: Sequence[Effect],
    forms: Sequence[Outcome],
    progress: Progress,
) -> list[Tried]:
    """Refit the block of every place and nature that comes near with one parity alone."""
    kinds = {(k.place, _nature(k)): k for k in _kinds()}
    shortest_s, longest_s = setting.scale.shortest_s, setting.scale.longest_s
    found = [_tried(setting, o, "both", frozenset()) for o in forms]
    near = leading(found).score + _NEAR
    single = [t for t in found if t.nature != "with two memories"]
    worth = {t.nature for t in single if t.score < near}
    drives: tuple[Parity, ...] = ("even", "odd")
    for done, both in enumerate([t for t in single if t.nature in worth]):
        progress("portrait", done, len(PLACES) * len(worth))
        start: Effect = kinds[both.place, both.nature].starts(setting.scale)[0]
        if both.time_constants_s:  # one parity has the same time constant
            tau = min(max(both.time_constants_s[0], shortest_s), longest_s)
            start = start.with_values({"time_constant_s": tau})
        for drive in drives:
            held = _held(type(start), drive)
            outcome = or_none(partial(learn, setting, hysteresis, present, [start], held))
            if outcome is not None:
                found.append(_tried(setting, outcome, drive, held))
    found = [t for t in found if are_shown(t.block, setting.scale)]
    if leading(found).time_constants_s:
        slow = [t for t in found if t.nature == "with memory"]
        for place in dict.fromkeys(t.place for t in slow):
            one = leading([t for t in slow if t.place == place])
            if one.drive != "both" and _asks_for_two(found, place):
                found.append(_twice(setting, hysteresis, present, one, one.drive))
        one = leading(found)
        near_by = [t for t in slow if t.place == one.place]
        if one.nature == "with two memories" and near_by:
            tried = {t.drive for t in found if (t.place, t.nature) == (one.place, one.nature)}
            for drive in (d for d in get_args(Parity) if d not in tried):
                found.append(_twice(setting, hysteresis, present, leading(near_by), drive))
    progress("portrait", len(PLACES) * len(worth), len(PLACES) * len(worth))
    return sorted(found, key=_priced)


def _asks_for_two(found: Sequence[Tried], place: Place) -> bool:
    """Whether a second memory takes what it is worth with both parities; where it was far it was not tried."""
    both = {t.nature: t.score for t in found if t.place == place and t.drive == "both"}
    once, twice = both.get("with memory"), both.get("with two memories")
    return once is not None and twice is not None and twice < once - _WORTH


def _twice(
    setting: Setting, hysteresis: Core, present: Sequence[Effect], one: Tried, drive: Parity
) -> Tried:
    """Refit two memories where one stands."""
    nature: Nature = "with two memories"
    kind = next(k for k in _kinds() if k.place == one.place and k.form.startswith(nature))
    held = _held(kind, drive)
    none = dict.fromkeys((name.partition(".")[2] for name in held), 0.0)
    starts = [e.with_values(none) for e in kind.from_simpler(one.block, setting.scale)]
    outcome = learn(setting, hysteresis, present, starts, held)
    return _tried(setting, outcome, drive, held)


def _kinds() -> list[type[Block]]:
    return [kind for kind in forms_of(Unknown) if issubclass(kind, Block)]


def _held(kind: type[Effect], drive: Parity) -> frozenset[str]:
    """Parameters of the other parity, which stay at zero."""
    if drive == "both":
        return frozenset()
    weights = [p.name for p in kind.parameters if p.neutral is not None]
    return frozenset(f"{kind.name}.{n}" for n in weights if is_even(n) != (drive == "even"))


def _nature(kind: type[Block]) -> Nature:
    return next(n for n in get_args(Nature) if n == (kind.form.partition(",")[0] or "static"))


def _tried(setting: Setting, outcome: Outcome, drive: Parity, held: frozenset[str]) -> Tried:
    block = outcome.fitted
    assert isinstance(block, Block)
    train = assess(setting.exchanged(), outcome.effect, outcome.fit)
    pieces = train.pieces, outcome.pieces
    return Tried(block.place, _nature(type(block)), drive, outcome, pieces, held)


def leading(tried: Sequence[Tried]) -> Tried:
    """Return the best of some blocks."""
    return min(tried, key=_priced)


def _priced(one: Tried) -> float:
    price = _WORTH * ((one.drive == "both") + (one.nature == "with two memories"))
    return one.score + price


def shares(
    tried: Sequence[Tried], of: Mapping[str, Sequence[Tried]], seed: int
) -> dict[str, float]:
    """Return in how many draws of pieces of the records each group holds the best block."""
    rng = np.random.default_rng(seed)
    sides = []
    for side in (0, 1):
        count = tried[0].pieces[side].size
        draws = rng.multinomial(count, np.full(count, 1.0 / count), _DRAWS) / count
        sides.append(draws)

    def scored(one: Tried) -> Array:
        logs = [np.log(d @ one.pieces[k].ravel()) for k, d in enumerate(sides)]
        return np.asarray(0.5 * (logs[0] + logs[1]) + (_priced(one) - one.score))

    scores = {
        name: np.min(np.stack([scored(one) for one in group]), axis=0)
        for name, group in of.items()
        if group
    }
    names = list(scores)
    best = np.argmin([scores[name] for name in names], axis=0)
    return {name: float(np.mean(best == k)) for k, name in enumerate(names)}
