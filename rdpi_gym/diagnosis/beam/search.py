"""The search: a beam of sets, each by every move, until no move is better by the one decision."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import count

import numpy as np
from scipy.special import expit

from rdpi_gym.diagnosis.beam.constants import (
    BEAM,
    DRAWS,
    EXPANDED,
    FIT_SAMPLES,
    FOUND,
    LEAST_WEIGHT,
    LIKELY,
    TEMPERATURE,
)
from rdpi_gym.diagnosis.beam.decision import draw_blocks, drawn_weights, log_prior
from rdpi_gym.diagnosis.beam.evidence import Evidence
from rdpi_gym.diagnosis.beam.expansion import (
    Key,
    dropped,
    expanded,
    further,
    in_other_forms,
    of_other_kinds,
    offered,
    with_free_blocks,
)
from rdpi_gym.diagnosis.beam.models import Model, Visited, refitted
from rdpi_gym.diagnosis.beam.moves import FREE_BLOCKS, clock_starts
from rdpi_gym.diagnosis.beam.openings import without_unknown_past
from rdpi_gym.diagnosis.beam.score import Blocks
from rdpi_gym.diagnosis.beam.signatures import Signature
from rdpi_gym.diagnosis.search.verdict import open_squares
from rdpi_gym.identification.cores import first_fit
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import fit_joint, or_none
from rdpi_gym.measurement import Record
from rdpi_gym.plant import CORES, RDPI
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.families import ThresholdCore
from rdpi_gym.plant.effects import CATALOGUE, forms_of
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.parallel import ALONE, Pool
from rdpi_gym.support.progress import Progress, silent

# A tent between two thresholds, whose height is that of a play at a place that is drawn between them,
# has on average this share of the square of what a weight split onto both neighbours changes.
_TEETH = 30.0

OnVisited = Callable[[Visited], None]
"""Told of each set that is visited for the first time."""


Sets = Mapping[Key, Visited]
Stage = Callable[[str, Sets, Callable[[], list[Visited]]], list[Visited]]
"""Returns the sets that a stage of a search visits, by its name: of a file, or by visiting them."""


def visited_now(name: str, sets: Sets, make: Callable[[], list[Visited]]) -> list[Visited]:
    """Visit the sets of a stage, whatever was visited before."""
    return make()


def begun(evidence: Evidence) -> Visited:
    """Return the set that nothing was added to: RDPI, or a stop model where loops turn clockwise.

    Where the search begins with all kinds of hysteresis, one without a fit leaves its place to the next.
    """
    offer, usual = evidence.offer, CORES["stop"] if evidence.clockwise else RDPI
    if offer.begins_with_all:
        for kind in (usual, *(each for each in offer.cores if each is not usual)):
            found = or_none(partial(_begun, evidence, kind), offer.kept)
            if found is not None:
                return found
    return _begun(evidence, offer.core or usual)


def _begun(evidence: Evidence, kind: type[Core]) -> Visited:
    kept = evidence.offer.kept
    core: Core = kind.comb(evidence.scale)
    if len(kind.starts(evidence.scale)) > 1:
        core = first_fit(evidence.train, kind, kept, evidence.scale).variant.hysteresis
    found = refitted(evidence, Model(core, kept))
    if found is None:
        fit_joint(evidence.train, core, kept, 1)  # it says why
        raise InputError(f"no {kind.name} model can be fitted to the records")
    return found


@dataclass
class Beam:
    """Sets that were visited, and the decisions on them."""

    evidence: Evidence
    seed: int = 0
    on_visited: OnVisited | None = None
    visited: dict[Key, Visited] = field(default_factory=dict)
    accepted: set[Key] = field(default_factory=set)  # Sets that a chain of better moves leads to
    # Best ones, whose names and forms were exchanged
    settled: set[Key] = field(default_factory=set)
    refused: dict[str, str] = field(default_factory=dict)  # Kinds of core without a fit, and why
    _least: Visited | None = None  # Set at whose floor the sets are scored

    def add(self, found: Sequence[Visited]) -> None:
        """Add visited sets; of two visits of one set the better one stays."""
        for one in found:
            if self.on_visited is not None and one.key not in self.visited:
                self.on_visited(one)
            known = self.visited.setdefault(one.key, one)
            if one.rmse_um < known.rmse_um:  # it came there by another move
                better = replace(known, model=one.model, fit=one.fit, lefts=one.lefts)
                self.visited[one.key] = better

    def begin(self, stage: Stage, pool: Pool = ALONE) -> Visited:
        """Visit the set that the search begins with: of all kinds of hysteresis where that is wanted."""

        def first() -> list[Visited]:
            return [begun(self.evidence)]

        base, *_ = stage("base", self.visited, first) or first()  # a file may hold none
        self.add([base])
        self.accepted.add(base.key)
        if not self.evidence.offer.begins_with_all:
            return base
        kinds = partial(self.of_other_kinds, pool, [base], loose=True)
        self.judge(stage("kinds", self.visited, kinds))
        return best_of(self, self.scored())

    def of_other_kinds(self, pool: Pool, sets: Sequence[Visited], loose: bool) -> list[Visited]:
        """Visit sets with other kinds of hysteresis."""
        found = list[Visited]()
        for one, refused in pool.map(partial(of_other_kinds, self.evidence, loose=loose), sets):
            found += one
            self.refused |= refused
        return found

    def scored(self) -> Scores:
        """Score all sets on common blocks, at the floor of the one that leaves least."""
        sets = list(self.visited.values())
        least = min(sets, key=lambda each: each.rmse_um)
        if least is not self._least:
            self._least, self.evidence = least, self._with_numerical(least)
        kept = frozenset(effect.name for effect in self.evidence.offer.kept)
        offered, blocks = len(self.evidence.offer.effects.keys() - kept) + 1, Blocks.of(least.lefts)
        faults = {clock.name for clock in clock_starts(self.evidence)}
        noise_um = self.evidence.floor_um(least.lefts)
        floors_um = self.evidence.floors_um(least.lefts, FIT_SAMPLES)
        priors = offered, len(faults), kept, blocks.independent(least.lefts)
        return Scores(tuple(sets), blocks, noise_um, floors_um, self.seed, *priors)

    def _with_numerical(self, least: Visited) -> Evidence:
        """Return the records with what their simulation leaves open, bounded by what a set leaves."""
        variant = Variant(least.model.core, least.model.effects)
        here = self.evidence.mended(least.model.clocks)
        records = (*here.train, *here.validation)
        opened = [_open_squares(variant, record) for record in records]
        for record, own, left in zip(records, opened, least.lefts, strict=True):
            mean = float(own[record.error_mask].mean())
            own *= min(1.0, float(np.mean(left**2)) / max(mean, 1e-300))
        return replace(self.evidence, numerical_um2=tuple(opened))

    def judge(self, found: Sequence[Visited]) -> None:
        """Add visited sets, and accept those of them that are better."""
        self.add(found)
        self.accept(found, self.scored())

    def accept(self, found: Sequence[Visited], scores: Scores) -> None:
        """Accept the sets that outweigh their parents, and all with less than an accepted one."""
        for one in found:
            if one.parent is not None and scores.outweighs(one, self.visited[one.parent]):
                self.accepted.add(one.key)
        accepted = [one for one in scores.sets if one.key in self.accepted]
        scale = self.evidence.scale
        models = [one.model for one in accepted]
        fewer = (each.key for m in models for each in (*m.without_one(), *m.simplified(scale)))
        self.accepted.update(key for key in fewer if key in self.visited)


def _open_squares(variant: Variant[Core], record: Record) -> Array:
    """Squares of what a simulation leaves open at each sample (µm²): between samples, and thresholds."""
    core, found = variant.hysteresis, open_squares(variant, record)
    if not isinstance(core, ThresholdCore) or core.n < 3:
        return found
    both = simulate_effects([variant, replace(variant, hysteresis=core.blurred())], record)
    change, mask = both[:, 1] - both[:, 0], record.error_mask
    found[mask] += (change[mask] - change[mask].mean()) ** 2 / _TEETH
    return found


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of sets on common blocks."""

    sets: tuple[Visited, ...]
    blocks: Blocks
    noise_um: float  # Noise floor (µm rms)
    floors_um: Sequence[Array]  # Of each sample, by record, with what its simulation leaves open
    seed: int
    offered: int = len(CATALOGUE) + 1  # Effects that a move may bring, and a clock fault
    faults: int = 1  # Clock faults that the records may have
    kept: frozenset[str] = frozenset()  # Effects that are in every set
    independent: Array | float = 1.0  # Share of each block's values that are

    @cached_property
    def draws(self) -> Array:
        """Draws of the bootstrap."""
        return draw_blocks(sum(self.blocks.counts), self.seed)

    @cached_property
    def table(self) -> Array:
        """Score of each set in each block (nats), ``(K, B)``."""
        return np.array([self.of(one) for one in self.sets])

    @cached_property
    def weights(self) -> Array:
        """Weight of each set in each draw, ``(DRAWS, K)``, by which the search goes on."""
        return self._drawn(self.table)

    @cached_property
    def probabilities(self) -> Array:
        """Probability of each set in each draw, ``(DRAWS, K)``.

        In some draws all values of a residual count, in the others the independent ones alone: no record
        tells whether what repeats with the command has one cause or two. Of all draws the first are so
        many that what they alone find is likely.
        """
        whole = round(LIKELY / FOUND * DRAWS)
        apart = self._drawn(self.independent * self.table)
        return np.concatenate([self.weights[:whole], apart[whole:]])

    def _drawn(self, table: Array) -> Array:
        return drawn_weights(table, [self._prior(one) for one in self.sets], self.draws)

    def of(self, one: Visited) -> Array:
        """Score of each block of a set (nats)."""
        return self.blocks.scores(one.lefts, self.floors_um)

    def log_weight(self, one: Visited) -> float:
        """Logarithm of the weight of a set, but for a constant (nats)."""
        return self._prior(one) - float(self.of(one).sum()) / TEMPERATURE

    def is_at_floor(self, one: Visited) -> bool:
        """Whether all that is left could not pay for one effect more."""
        return self._left(one) < self._price

    def is_elsewhere(self, one: Visited, fitted: int) -> bool:
        """Whether the first records, to which a set is fitted, are at the floor, and others are not."""
        count = sum(self.blocks.counts[:fitted])
        return self._left(one, slice(count)) < self._price <= self._left(one, slice(count, None))

    def may_grow(self, one: Visited, best: Visited) -> bool:
        """Whether one effect more, were nothing left then, could make a set weigh more than the best one."""
        more = len(one.model.names) + 1 - len(best.model.names)
        return not self.is_at_floor(one) and self._left(best) >= more * self._price

    def takes_most(self, of: Visited, move: Visited) -> bool:
        """Whether a move takes as much of what a set leaves as it leaves itself, or more."""
        return self._left(of) >= 2.0 * self._left(move)

    def may_bend(self, one: Visited) -> bool:
        """Whether what a set leaves could pay for one of two forms."""
        return self._left(one) >= math.log(2.0)

    def beyond(self, one: Visited) -> float:
        """Return the weight of an unnamed cause that would leave nothing of a set above the floor."""
        price = self._price + math.log(len(FREE_BLOCKS))
        gain = self.draws @ self._above_noise(one) * (sum(self.blocks.counts) / TEMPERATURE)
        return float(expit(gain - price).mean())

    @property
    def _price(self) -> float:
        """Least gain that pays for one effect more (nats)."""
        return log_prior(0, self.offered) - log_prior(1, self.offered)

    def _left(self, one: Visited, part: slice = slice(None)) -> float:
        """Nats that a set leaves above noise at the floor, in all blocks or in a part of them."""
        return float(self._above_noise(one)[part].sum()) / TEMPERATURE

    def _above_noise(self, one: Visited) -> Array:
        """Score of each block of a set less what noise at the floor would have there (nats)."""
        return self.of(one) - self.blocks.of_noise(one.lefts)

    def outweighs(self, move: Visited, of: Visited) -> bool:
        """Whether a move weighs more than the set that it is of, less what its best phantom gains.

        By weights and not by chance: what shows in few blocks is not drawn in a third of the draws,
        however much it gains there.
        """
        both = np.array([self.of(of), self.of(move) + self._bar(move)])
        priors = [self._prior(one) for one in (of, move)]
        here, there = drawn_weights(both, priors, self.draws).mean(axis=0)
        return bool(there > here)

    def _prior(self, one: Visited) -> float:
        return prior_of(one.model, self.offered, self.faults, self.kept)

    def _bar(self, one: Visited) -> float:
        """Return what the best phantom of a move gains (nats a block)."""
        if not one.ghosts:
            return 0.0
        alone, *ghosts = (self.blocks.scores(each, self.floors_um).mean() for each in one.ghosts)
        return max(0.0, *(float(alone - each) for each in ghosts))


def prior_of(model: Model, offered: int, faults: int, kept: frozenset[str]) -> float:
    """Logarithm of the prior of a set: of effects that moves bring, all forms, clock faults, kind of core."""
    found = log_prior(len(model.names - kept), offered) - len(model.clocks) * math.log(faults)
    for effect in model.effects:
        if effect.name == Unknown.name:
            found -= math.log(len(FREE_BLOCKS))
        elif effect.form:
            found -= math.log(len(forms_of(type(effect))))
    if model.core.name != RDPI.name:
        found -= math.log(len(CORES))
    return found


def searched(
    evidence: Evidence,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    on_visited: OnVisited | None = None,
    stage: Stage = visited_now,
) -> tuple[Beam, Scores, Visited]:
    """Run the beam to its end; return all sets, their scores, and the best one with names alone."""
    report, tried = progress or silent, count(1)
    pool = Pool(jobs, lambda: report("moves of the search", next(tried), 0))
    report("moves of the search", 0, 0)
    beam = Beam(evidence, seed, on_visited)
    base, with_all = beam.begin(stage, pool), evidence.offer.begins_with_all
    kinds = partial(beam.of_other_kinds, pool)
    done: set[Key] = set()
    signatures = dict[str, Sequence[Signature]]()
    for _ in range(EXPANDED):
        scores, best = _led(beam, stage)
        chosen = _next(beam, scores, best, done)
        if chosen is None:
            scores, best = _settled(beam, pool, stage)
            chosen = _next(beam, scores, best, done)
        if chosen is None:  # where no name pays any more
            spared = None if scores.is_at_floor(best) else without_unknown_past(evidence, best)
            if spared is not None:
                return searched(spared, jobs, seed, progress, on_visited)
            if scores.is_elsewhere(best, len(evidence.train)) and not evidence.is_exchanged:
                again = partial(searched, evidence.exchanged, jobs, seed, progress, on_visited)
                other = or_none(again, evidence.offer.kept)
                if other and other[1].log_weight(other[2]) > scores.log_weight(best):
                    return other
            break
        one, grows = chosen
        if grows and one.model.core.name not in signatures:
            signatures[one.model.core.name] = offered(evidence, one)
        known = frozenset(beam.visited)
        case = (one, grows, one is best)
        make = partial(expanded, beam.evidence, known, frozenset(done), signatures, case, pool)
        found = stage(f"moves of {' '.join(one.key)}", beam.visited, make)
        if one is base and not with_all:
            found = [*found, *stage("kinds", beam.visited, partial(kinds, [base], loose=False))]
        beam.judge(found)
        done.add(one.key)
    scores, best = _settled(beam, pool, stage)
    if not scores.is_at_floor(best):
        bare = [base] if best.model.effects else []
        beam.judge(
            stage("kinds at the end", beam.visited, partial(kinds, [best, *bare], loose=True))
        )
        scores, best = _settled(beam, pool, stage)
    if not scores.is_at_floor(best):
        blocks = partial(with_free_blocks, beam.evidence, best, pool)
        beam.add(stage("free blocks", beam.visited, blocks))
        scores = beam.scored()
    return beam, scores, best


def _settled(beam: Beam, pool: Pool, stage: Stage) -> tuple[Scores, Visited]:
    """Drop and exchange names and forms of the best set until no such set has a larger weight."""
    scores, best = _led(beam, stage)
    while best.key not in beam.settled:
        name = " ".join(best.key)
        beam.settled.add(best.key)
        if scores.may_bend(best):
            forms = partial(in_other_forms, beam.evidence, best, pool)
            beam.judge(stage(f"forms of {name}", beam.visited, forms))
        fewer = partial(dropped, beam.evidence, best, pool)
        beam.judge(stage(f"less than {name}", beam.visited, fewer))
        scores, best = _led(beam, stage)
    return scores, best


def _led(beam: Beam, stage: Stage) -> tuple[Scores, Visited]:
    """Score all sets, and return the best one: where its refit had not ended, it goes on first."""
    scores = beam.scored()
    best = best_of(beam, scores)
    if best.fit.converged:
        return scores, best
    name = f"{' '.join(best.key)} from {best.rmse_um:.9g} to its end"
    beam.add(stage(name, beam.visited, partial(further, beam.evidence, best)))
    scores = beam.scored()
    return scores, best_of(beam, scores)


def best_of(beam: Beam, scores: Scores) -> Visited:
    """Return the accepted set of the largest weight, of those with the names that weigh most in all forms."""
    mean = scores.weights.mean(axis=0)
    named: dict[tuple[str, frozenset[str]], float] = {}
    chosen = []
    for k, one in enumerate(scores.sets):
        if one.key in beam.accepted:
            names = one.model.core.name, one.model.names
            named[names] = named.get(names, 0.0) + float(mean[k])
            chosen.append((k, names))
    return scores.sets[max(chosen, key=lambda own: (named[own[1]], mean[own[0]]))[0]]


def _next(
    beam: Beam, scores: Scores, best: Visited, done: Collection[Key]
) -> tuple[Visited, bool] | None:
    """Return the set that goes on, and whether with one effect more.

    It is the first of the best few that may yet lead to the right one.

    These have a weight, or are behind the best one by no more than that itself leaves: whatever takes
    that may be missing beside them as well.
    """
    chosen = [k for k, one in enumerate(scores.sets) if one.key in beam.accepted]
    mean = scores.weights[:, chosen].mean(axis=0)
    mean = mean / max(float(mean.sum()), 1e-300)
    left = scores.table[chosen].mean(axis=1)
    order = [int(k) for k in np.argsort(-mean)[:BEAM]]
    most = 0.0 if scores.is_at_floor(best) else 2.0 * left[order[0]]
    for k in order:
        one = scores.sets[chosen[k]]
        if one.key in done or (mean[k] < LEAST_WEIGHT and left[k] > most):
            continue
        grows = _may_grow(beam, scores, one, best)
        if grows or len(one.model.effects) > 1:
            return one, grows
    return None


def _may_grow(beam: Beam, scores: Scores, one: Visited, best: Visited) -> bool:
    """Whether a set goes on with one effect more.

    It does not after several that each took less than was left then: these are no causes, and further
    ones beside them even less so.
    """
    small = 0
    if not scores.may_grow(one, best):
        return False
    while one.parent is not None and small < BEAM:
        before = beam.visited[one.parent]
        if scores.takes_most(before, one):
            return True
        small += len(one.model.names) > len(before.model.names)
        one = before
    return small < BEAM
