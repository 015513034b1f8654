"""Expansion of the sets of a beam: all first looks as one pool of tasks, then all refits as another."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from rdpi_gym.diagnosis.beam.constants import REFITTED
from rdpi_gym.diagnosis.beam.evidence import Evidence
from rdpi_gym.diagnosis.beam.models import Linear, Model, Visited, refitted
from rdpi_gym.diagnosis.beam.moves import Look, Place, Starts, bearable, exchanged, kinds, raced
from rdpi_gym.diagnosis.beam.signatures import Signature
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import or_none
from rdpi_gym.plant.effects import Effect, forms_of
from rdpi_gym.support.parallel import Pool

Key = tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Asked:
    """Moves of one set that are to be looked at, those of one group against each other."""

    of: Visited
    place: Place  # From which the looks are taken
    starts: Sequence[Starts]  # An empty one is the place itself
    against: Place  # What they have to gain upon
    most: int = 1  # Looks of the group that are refitted whole
    clocks: Sequence[Look] = ()
    may_lose: bool = False  # Whether all looks that are not worse are refitted


def offered(evidence: Evidence, of: Visited) -> list[Signature]:
    """Signatures of the starts of all effects, beside the core of a set alone."""
    core, scale = type(of.model.core), evidence.scale
    kinds = evidence.offer.effects.values()
    forms = [form for kind in kinds for form in forms_of(kind) if form.fits_in(core)]
    bare = replace(of.model, effects=evidence.offer.kept)
    place = Place(evidence.mended(of.model.clocks), bare)
    starts = [start for form in forms for start in form.starts(scale)]
    return or_none(partial(place.signed, starts), bare.effects) or []


def _asked(
    evidence: Evidence,
    known: Collection[Key],
    done: Collection[Key],
    signatures: Mapping[str, Sequence[Signature]],
    case: tuple[Visited, bool, bool],
) -> list[Asked]:
    """Return the moves of a set that promise most, and those that drop an effect.

    Names are exchanged in the set that leads: the others that go on are its rivals already. What
    promises most beside a set that was expanded was looked at there.
    """
    of, grows, leads = case
    place = Place(
        evidence.mended(of.model.clocks), of.model, signatures.get(of.model.core.name, ())
    )
    found = []
    if grows:
        starts = [*place.additions(), *place.pairs()]
        found.append(Asked(of, place, starts, place, REFITTED, place.clocks()))
    for effect in _free(evidence, of.model):
        bare = place.without(effect.name)
        others = bare.names() if leads and bare.model.key not in done else []
        if grows:
            found.append(Asked(of, bare, [*bare.forms(effect), *others], place))
        elif others:
            found.append(Asked(of, bare, [*others, *bare.still()], place, may_lose=True))
        if bare.model.key not in known:
            found.append(Asked(of, bare, ((),), place, may_lose=True))
    return found


def _free(evidence: Evidence, model: Model) -> list[Effect]:
    """Return the effects that moves may drop or exchange."""
    return [effect for effect in model.effects if not evidence.offer.is_kept(effect.name)]


def _blocks_asked(evidence: Evidence, of: Visited) -> list[Asked]:
    """Return the free blocks that promise most beside all effects, and in the place of each."""
    place = Place(evidence.mended(of.model.clocks), of.model)
    places = [place, *(place.without(effect.name) for effect in _free(evidence, of.model))]
    starts = [or_none(each.blocks, of.model.effects) or [] for each in places]
    return [Asked(of, each, own, each) for each, own in zip(places, starts, strict=True)]


def _looked(places: Sequence[Place], case: tuple[int, Starts]) -> Look | None:
    which, starts = case
    return places[which].look_at(starts)


def _refitted(
    evidence: Evidence, linear: Sequence[Linear], case: tuple[int, Visited, Look]
) -> Visited | None:
    which, of, look = case
    one = refitted(evidence, look.model, of.key)
    if one is None or not look.new:
        return one
    make = partial(linear[which].with_phantoms, one.model, look.new)
    ghosts = or_none(make, one.model.effects)
    return None if ghosts is None else replace(one, ghosts=ghosts, new=look.new)


def _expanded(evidence: Evidence, asked: Sequence[Asked], pool: Pool) -> list[Visited]:
    """Take the looks, race them, and refit those that gain most."""
    places = list(dict.fromkeys(p for each in asked for p in (each.place, each.against)))
    wanted: dict[tuple[int, Starts], None] = {}
    for each in asked:
        own = [(places.index(each.place), starts) for starts in each.starts]
        wanted |= dict.fromkeys([(places.index(each.against), ()), *own])
    # the longest first, so that no process waits for another's last
    cases = sorted(wanted, key=lambda case: -_numbers(places[case[0]], case[1]))
    looks = dict(zip(cases, pool.map(partial(_looked, places), cases), strict=True))
    parents = list(dict.fromkeys(each.of.key for each in asked))
    linear = [_linear(evidence, next(a.of for a in asked if a.of.key == key)) for key in parents]
    kept: list[tuple[int, Visited, Look]] = []
    for each in asked:
        seen = [looks[places.index(each.place), starts] for starts in each.starts]
        found = [*(look for look in seen if look is not None), *each.clocks]
        base = looks[places.index(each.against), ()] if found else None
        if base is None:
            continue
        near = each.place.evidence
        if each.may_lose:
            chosen = bearable(base, found, near)
        else:
            chosen = raced(base, found, near, each.most)
            first = seen[0] if seen and each.most > 1 else None
            if first is not None and first not in chosen:  # a look may end before a curve is bent
                chosen.append(first)
        kept += [(parents.index(each.of.key), each.of, look) for look in chosen]
    kept.sort(key=lambda case: -len(case[2].model.effects))
    sets = pool.map(partial(_refitted, evidence, linear), kept)
    return [each for each in sets if each is not None]


def _numbers(place: Place, starts: Starts) -> int:
    """Numbers that a look moves."""
    return sum(len(effect.parameters) for effect in (*place.model.effects, *starts))


def _linear(evidence: Evidence, of: Visited) -> Linear:
    return Linear(evidence.mended(of.model.clocks), Variant(of.model.core, of.model.effects))


def expanded(
    evidence: Evidence,
    known: Collection[Key],
    done: Collection[Key],
    signatures: Mapping[str, Sequence[Signature]],
    case: tuple[Visited, bool, bool],
    pool: Pool,
) -> list[Visited]:
    """Return the sets that moves make of one of a beam, those that the race leaves refitted whole.

    With the set stands whether there is anything that more effects could take, and whether it leads.
    Sets without an effect that are `known` are not refitted again, and names are not exchanged where
    the set without them is `done`.
    """
    of, grows, _ = case
    asked = or_none(partial(_asked, evidence, known, done, signatures, case), of.model.effects)
    found = _expanded(evidence, asked or [], pool)
    models = exchanged(of.model, evidence.scale, evidence.offer) if grows else []
    return [*found, *_whole(evidence, known, [(model, of.key) for model in models], pool)]


def dropped(evidence: Evidence, of: Visited, pool: Pool) -> list[Visited]:
    """Return the sets that have no more effects: with one less, simpler, or under another name.

    With one less the others are looked at in richer forms too, which may have needed it. Those that were
    visited are refitted from here: a fit may have ended in another valley.
    """
    kept = {effect.name for effect in evidence.offer.kept}
    models = [model for model in of.model.without_one() if kept <= model.names]
    models += of.model.simplified(evidence.scale)
    models += exchanged(of.model, evidence.scale, evidence.offer)
    place = Place(evidence.mended(of.model.clocks), of.model)
    fewer = [place.without(effect.name) for effect in _free(evidence, of.model)]
    richer = [each for one in fewer for each in _in_richer_forms(evidence, of, one)]
    whole = _whole(evidence, (), [(model, of.key) for model in models], pool)
    return [*whole, *_expanded(evidence, richer, pool)]


def in_other_forms(evidence: Evidence, of: Visited, pool: Pool) -> list[Visited]:
    """Return the sets with one effect in the richer form that a look gains most with.

    A form with a cusp is begun anew about its place, which the other effects may have moved.
    """
    place = Place(evidence.mended(of.model.clocks), of.model)
    anew = [
        Asked(of, place.without(effect.name), [(effect,)], place)
        for effect in _free(evidence, of.model)
        if effect.kinked
    ]
    return _expanded(evidence, [*_in_richer_forms(evidence, of, place), *anew], pool)


def _in_richer_forms(evidence: Evidence, of: Visited, place: Place) -> list[Asked]:
    """Return the richer forms of each effect of a place that are to be looked at beside the others."""
    found = []
    for effect in _free(evidence, place.model):
        bare = place.without(effect.name)
        starts = or_none(partial(bare.forms, effect), of.model.effects) or []
        found.append(Asked(of, bare, starts, place))
    return found


def further(evidence: Evidence, of: Visited) -> list[Visited]:
    """Return a set refitted again from where its passes ended."""
    one = refitted(evidence, of.model, of.parent)
    return [] if one is None else [replace(one, ghosts=of.ghosts, new=of.new)]


def _whole(
    evidence: Evidence, known: Collection[Key], models: Sequence[tuple[Model, Key]], pool: Pool
) -> list[Visited]:
    """Refit models that are not known, each with the key of its parent, without a look."""
    new = [case for case in models if case[0].key not in known]
    sets = pool.map(partial(_refitted_as, evidence), new)
    return [each for each in sets if each is not None]


def _refitted_as(evidence: Evidence, case: tuple[Model, Key]) -> Visited | None:
    return refitted(evidence, *case)


def with_free_blocks(evidence: Evidence, of: Visited, pool: Pool) -> list[Visited]:
    """Return the sets with the best free block beside all effects, and in the place of each."""
    return _expanded(evidence, _blocks_asked(evidence, of), pool)


def of_other_kinds(
    evidence: Evidence, of: Visited, *, loose: bool = False
) -> tuple[list[Visited], dict[str, str]]:
    """Return the set with other kinds of hysteresis, those that come near refitted whole.

    Kinds of many gains, which make up for any effect, only where these are `loose`. Beside them, why
    others have no fit, by their name.
    """
    here = evidence.mended(of.model.clocks)
    models, refused = kinds(here, of.model, of.fit.train_rmse_um, loose)
    sets = [refitted(evidence, model, of.key) for model in models]
    return [one for one in sets if one is not None], refused
