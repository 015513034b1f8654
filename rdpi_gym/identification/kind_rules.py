"""Which of several kinds of hysteresis records tell apart: by what each leaves held out, and its freedom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.identification.cores import responses_to
from rdpi_gym.identification.held_out import beats, left_by, pieces_of
from rdpi_gym.identification.joint import JointFit
from rdpi_gym.measurement import Record
from rdpi_gym.plant import CORES
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

# Of the best held-out error, what another kind may have more and be no worse; the share of draws of
# held-out pieces from which on one is better; and times what the best one leaves beyond the noise,
# what another may leave: where something else is missing too, no kind shows by a little less.
_ALIKE, _BETTER, _BEYOND = 1.05, 0.95, 3.0
# Power of the ratio of their numbers by which the freer kind has to leave less (mean square).
_PRICE = 0.1
# What moving numbers may change of the displacement, and how many standard errors they may move,
# where a model is one with that of other numbers.
_SAME, _ERRORS = 1e-3, 2.0


@dataclass(frozen=True)
class Way:
    """A kind of hysteresis refitted to records, and what it leaves of records held out.

    Parameters
    ----------
    fit
        The refit.
    pieces : float64[R, PIECES]
        Mean squares (µm²) of what it leaves of the pieces of each record.
    white_um2 : float64[R]
        Mean square (µm²) of what changes from one sample to the next in that: of white noise all
        of it, of what a model misses little.
    """

    fit: JointFit
    pieces: Array
    white_um2: Array

    @property
    def core(self) -> Core:
        """The core as it was fitted."""
        return self.fit.variant.hysteresis

    @property
    def freedom(self) -> int:
        """Numbers of the core: gains that are not zero, and those of its shape."""
        free = sum(not p.fixed for p in self.core.shape)
        return int(np.count_nonzero(self.core.gains)) + free


def judged_way(fit: JointFit, held_out: Sequence[Record]) -> Way:
    """Return a refit with what it leaves of records held out."""
    lefts = [left_by(fit.variant, record) for record in held_out]
    white = [float(np.mean(np.diff(left) ** 2)) / 2.0 if left.size > 1 else 0.0 for left in lefts]
    return Way(fit, pieces_of(lefts), np.array(white))


@dataclass(frozen=True)
class Told:
    """What a comparison of kinds tells.

    Parameters
    ----------
    chosen
        Of the kinds that are no worse than the best, that of the fewest numbers.
    alike
        Names of the others that the records do not tell from the best, and of kinds that are one
        model with the chosen one.
    same
        The latter.
    confidence
        Share of draws of held-out pieces in which the best one beats every kind that is told from
        it; None where there is none.
    """

    chosen: Way
    alike: tuple[str, ...]
    same: tuple[str, ...]
    confidence: float | None


def told_apart(ways: Sequence[Way], records: Sequence[Record], seed: int = 0) -> Told:
    """Compare kinds by what they leave of records held out.

    Every record counts alike: by what kinds leave of it over the least that any of them leaves.
    """
    least = np.maximum(np.min([way.pieces.mean(axis=1) for way in ways], axis=0), 1e-300)
    pieces = [way.pieces / least[:, None] for way in ways]
    left = [float(piece.mean()) for piece in pieces]
    best = int(np.argmin(left))
    noise = float(np.minimum(ways[best].white_um2 / least, 1.0).mean())
    beyond = max(left[best] - noise, 0.0)
    rng, near, alike, apart = np.random.default_rng(seed), list[Way](), list[str](), list[float]()
    for k, way in enumerate(ways):
        priced = max(ways[best].freedom / max(way.freedom, 1), 1.0) ** _PRICE
        if left[k] <= _ALIKE**2 * priced * left[best]:
            near.append(way)
            continue
        sure = beats(pieces[k], pieces[best], rng)
        if sure < _BETTER or left[k] - noise < _BEYOND * beyond:
            alike.append(way.core.name)
        else:
            apart.append(sure)
    chosen = min(near, key=lambda way: way.freedom)
    same = same_models(chosen.core, records, chosen.fit.shape_errors)
    alike = [way.core.name for way in near if way is not chosen] + alike
    alike += [name for name in same if name not in alike]
    return Told(chosen, tuple(alike), same, min(apart) if apart else None)


def same_models(
    core: Core, records: Sequence[Record], errors: Mapping[str, float | None]
) -> tuple[str, ...]:
    """Return the other kinds that are one model with a core at the numbers that a fit found.

    The numbers of a case that both kinds have are within two standard errors, or putting them there
    changes the displacement by less than a thousandth.
    """
    met = {
        case for case, numbers in core.cases.items() if _stands_at(core, numbers, records, errors)
    }
    return tuple(k.name for k in CORES.values() if k.name != core.name and met & set(k.cases))


def _stands_at(
    core: Core,
    numbers: Mapping[str, float],
    records: Sequence[Record],
    errors: Mapping[str, float | None],
) -> bool:
    told = {}
    for name, value in numbers.items():
        error = errors.get(name, 0.0)
        if error is None or abs(getattr(core, name) - value) > _ERRORS * error:
            told[name] = value
    try:
        there = replace(core, **told)  # type: ignore[type-var]
    except InputError:  # what the other numbers do not allow
        return False
    moves = changes = 0.0
    for record in records:
        here = responses_to(core, record) @ np.array(core.gains)
        change = responses_to(there, record) @ np.array(there.gains) - here
        moves += len(here) * float(np.var(here))
        changes += len(here) * float(np.var(change))
    return changes <= _SAME**2 * moves
