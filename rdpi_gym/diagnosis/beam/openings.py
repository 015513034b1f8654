"""Openings of records whose past nobody recorded, left out where they spoil the rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis.beam.constants import DRAWS, FIT_SAMPLES, LEVEL, MOST_BLOCKS
from rdpi_gym.diagnosis.beam.decision import chances, draw_blocks
from rdpi_gym.diagnosis.beam.evidence import Evidence, joined
from rdpi_gym.diagnosis.beam.models import Visited, refitted, residuals
from rdpi_gym.diagnosis.beam.moves import Place, raced
from rdpi_gym.diagnosis.beam.score import Blocks
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import kept_samples, or_none
from rdpi_gym.plant.effects import forms_of
from rdpi_gym.support.arrays import Array

_MEMORY = "initial_memory"


def without_unknown_past(evidence: Evidence, of: Visited) -> Evidence | None:
    """Return the records in stretches of known memory where openings spoil a set; None where all count.

    Refitted to the stretches, the set misses the opening of some record by more than as much of the
    rest; it fits the rest better by the one decision, beyond what as many stretches the other way round
    in time gain, their phantom; and beside an initial memory that all records share, that of the set or
    the best one, it misses an opening still.
    """
    return or_none(partial(_without_unknown_past, evidence, of), of.model.effects)


def _without_unknown_past(evidence: Evidence, of: Visited) -> Evidence | None:
    own = of if _MEMORY in of.model.names else None
    if own is not None:
        effects = tuple(effect for effect in of.model.effects if effect.name != _MEMORY)
        bare = refitted(evidence, replace(of.model, effects=effects), of.parent)
        if bare is None:
            return None
        of = bare
    if not evidence.openings:
        return None
    spared, ends = evidence.spared(), evidence.spared(at_end=True)
    without = refitted(spared, of.model)
    if without is None or not _is_spoilt(evidence, without):
        return None
    phantom = refitted(ends, of.model)
    if phantom is None:
        return None
    memory = own or _remembering(evidence, of)
    floor_um = evidence.floor_um(without.lefts)
    here, there, least = (_scores(spared, ends, one, floor_um) for one in (of, phantom, without))
    bar, draws = max(float((here - there).mean()), 0.0), draw_blocks(least.size)
    if chances((here - least)[None], np.array([bar]), draws)[0] >= LEVEL:
        return None
    return spared if memory is None or _is_spoilt(evidence, memory) else None


def _is_spoilt(evidence: Evidence, of: Visited) -> bool:
    """Whether a set misses more of the opening of some record than of as much of the rest."""
    parts = _parts(evidence, of).values()
    return any(_stands_out(*own) * len(parts) < LEVEL for own in parts)


def _residuals(evidence: Evidence, of: Visited) -> list[tuple[str, NDArray[np.intp], Array]]:
    """By record, its name, the samples that enter the squares, and what a set leaves of them (µm)."""
    here, found = evidence.mended(of.model.clocks), []
    variant = Variant(of.model.core, of.model.effects)
    for part in (here.train, here.validation):
        lefts = residuals(part, variant, FIT_SAMPLES)
        names = [record.name for record in part]
        found += list(zip(names, kept_samples(part, FIT_SAMPLES), lefts, strict=True))
    return found


def _parts(evidence: Evidence, of: Visited) -> Mapping[str, tuple[Array, Array]]:
    """Return what a set leaves of the opening of each record, and of the rest (µm)."""
    found = {}
    for name, index, left in _residuals(evidence, of):
        known = evidence.openings.get(name)
        early = np.zeros(index.size, dtype=np.bool_) if known is None else known[0][index]
        if early.any() and not early.all():
            found[name] = left[early] - left[~early].mean(), left[~early] - left[~early].mean()
    return found


def _scores(spared: Evidence, ends: Evidence, of: Visited, floor_um: float) -> Array:
    """Score blocks of the samples that count without the openings and without the ends of records."""
    counts = {r.name: r.error_mask for r in joined(ends.read).records}
    found = []
    for name, index, left in _residuals(spared, of):
        own = left[counts[name][index]]
        if own.size:
            floor = np.full(own.size, floor_um)
            found.append(_blocks(own).scores([own - own.mean()], [floor]))
    return np.concatenate(found)


def _blocks(left: Array, most: int = MOST_BLOCKS) -> Blocks:
    """Blocks of a residual."""
    return Blocks((min(most, left.size),))


def _stands_out(opened: Array, rest: Array) -> float:
    """Return the chance that as many blocks of the rest leave as much as those of an opening."""
    # as long as those of the rest of its record
    count = max(round(MOST_BLOCKS * opened.size / (opened.size + rest.size)), 1)
    usual = _blocks(rest, max(MOST_BLOCKS - count, 1)).mean_squares([rest])
    drawn = np.random.default_rng(0).choice(usual, (DRAWS, count)).mean(axis=1)
    return float(np.mean(drawn >= np.mean(opened**2)))


def _remembering(evidence: Evidence, of: Visited) -> Visited | None:
    """Return a set with the initial memory that all records share, in its best form."""
    if _MEMORY not in evidence.offer.effects:
        return None
    place = Place(evidence.mended(of.model.clocks), of.model)
    forms = [f for f in forms_of(evidence.offer.effects[_MEMORY]) if f.fits_in(type(of.model.core))]
    starts = place.best_starts(start for form in forms for start in form.starts(evidence.scale))
    looks = [place.look_at((start,)) for start in starts]
    base = place.stepped()
    if base is None:
        return None
    best = raced(base, [look for look in looks if look is not None], place.evidence, 1)
    return refitted(evidence, best[0].model, of.key) if best else None
