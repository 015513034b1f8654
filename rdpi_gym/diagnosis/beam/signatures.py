"""Signatures of effects, and what they promise beside a set, by linear algebra alone.

A signature is what an effect changes of the displacement from one of its starts, with the derivatives
by its parameters. All are simulated once, beside the core alone. What a start promises beside a set is
one Gauss-Newton step: the residual of the set, regressed on the signature, less what the set's own
numbers explain of it (the score test of Rao 1948).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import groupby

import numpy as np

from rdpi_gym.diagnosis.beam.constants import RACE_SAMPLES
from rdpi_gym.diagnosis.beam.score import within
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import Tangents, effect_rows, or_none
from rdpi_gym.identification.least_squares import BoolArray, signed_least_squares
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect, in_chain_order
from rdpi_gym.support.arrays import Array


@dataclass(frozen=True, eq=False)
class Signature:
    """One start of an effect."""

    start: Effect
    # By each parameter, and what the start itself changes (µm), on all records, ``(N, p + 1)``
    rows: Array
    fitted: int  # Rows of the records to fit, which come first
    ways: Sequence[tuple[bool, bool]]  # Whether each parameter may go up and down

    @cached_property
    def gram(self) -> Array:
        """Products of its columns on the records to fit."""
        rows = self.rows[: self.fitted]
        return np.asarray(rows.T @ rows)


Part = tuple[Sequence[Record], Array]
"""Records, and what a set leaves of them (µm), centred by record and joined."""


def signatures(
    parts: Sequence[Part], core: Core, effects: Sequence[Effect], starts: Iterable[Effect]
) -> list[Signature]:
    """Simulate starts beside a set, on the records to fit and on those to judge by."""
    found = []
    for _, group in groupby(starts, key=type):
        alike = list(group)
        make, every = partial(_of_one_form, parts, core, effects), (*effects, alike[0])
        whole = or_none(partial(make, alike), every)
        each = [whole] if whole is not None else [or_none(partial(make, [s]), every) for s in alike]
        found += [own for one in each if one is not None for own in one]
    return [each for each in found if np.isfinite(each.rows).all()]


def _of_one_form(
    parts: Sequence[Part], core: Core, effects: Sequence[Effect], starts: Sequence[Effect]
) -> list[Signature]:
    chains = [in_chain_order([*effects, start]) for start in starts]
    place = next(k for k, effect in enumerate(chains[0]) if effect is starts[0])
    unrated = False
    if starts[0].slot == "rate" and isinstance(core, RDPI) and core.delta2_s == 0.0:
        # no law of the rate changes anything at a δ2 of 0, which may rise with it
        core, unrated = core.rated_at(data_scale(parts[0][0]).fastest_V_s), True
    variants = [Variant(core, tuple(chain)) for chain in chains]
    both = [effect_rows(records, variants, place, RACE_SAMPLES) for records, _ in parts]
    left = np.concatenate([each for _, each in parts])
    found = []
    for start, *own in zip(starts, *both, strict=True):
        rows, ways = np.concatenate([each for part in own for each in part.rows]), own[0].ways
        rows[:, -1] = left - rows[:, -1]
        if unrated:
            rows, ways = np.pad(rows, ((0, 0), (0, 1))), [*ways, (True, False)]
        found.append(Signature(start, rows, parts[0][1].size, ways))
    return found


@dataclass(frozen=True, eq=False)
class Promise:
    """Predicted gain of a start beside a set."""

    signature: Signature
    step: Array  # Of the effect's parameters
    squares: float  # That are left of the records to fit after this step (µm²)

    @property
    def start(self) -> Effect:
        """The start."""
        return self.signature.start

    @property
    def form(self) -> type[Effect]:
        """Form of the effect."""
        return type(self.signature.start)


class Foresight:
    """A set linearised: what its own numbers explain of a column, and what it leaves.

    Parameters
    ----------
    train, validation
        On the records to fit and to judge by.
    own
        Which of its numbers tell of the experiment and not of the plant.
    """

    def __init__(self, train: Tangents, validation: Tangents, own: BoolArray) -> None:
        columns = np.flatnonzero(train.moves)
        rows = [*train.rows, *validation.rows]
        self._columns = np.concatenate([each[:, columns] for each in rows])
        self._fitted = sum(map(len, train.rows))
        self._ends = np.cumsum([len(each) for each in rows])[:-1]
        self._inverse = np.linalg.pinv(self._columns[: self._fitted])
        self._left = self._less(np.concatenate([each[:, -1] for each in rows]))
        self._own = self._columns[:, own[columns]]
        here = self._left[: self._fitted]
        self.squares = float(here @ here)

    def _less(self, columns: Array) -> Array:
        """Return columns less what the set's own numbers, fitted to the same, explain of them."""
        explained = self._columns @ (self._inverse @ columns[: self._fitted])
        return np.asarray(columns - explained)

    def _by_record(self, left: Array, *further: Signature) -> list[Array]:
        """Split by record; numbers of the experiment, of further starts too, are fitted to all."""
        columns = [self._own, *(own.rows[:, :-1] for own in further if own.start.clocked)]
        local, found = np.hstack(columns), np.split(left, self._ends)
        if not local.size:
            return found
        x = np.split(local, self._ends)
        count = int(np.searchsorted(self._ends, self._fitted)) + 1
        told = local[: self._fitted].T @ local[: self._fitted]
        return [*found[:count], *within(list(zip(x[count:], found[count:], strict=True)), told)]

    @property
    def lefts(self) -> list[Array]:
        """Residual of the set (µm), by record: those to fit, then those to judge by."""
        return self._by_record(self._left)

    def promises(self, offered: Sequence[Signature]) -> list[Promise]:
        """Return what the best start of each form promises."""
        found: dict[type[Effect], list[Promise]] = {}
        for own in offered:
            rows = own.rows[: self._fitted]
            inside = self._inverse @ rows
            across = self._columns[: self._fitted].T @ rows
            gram = own.gram - inside.T @ across
            pull = self._left[: self._fitted] @ rows
            rhs = pull[:-1] - gram[:-1, -1]
            total = self.squares - 2.0 * float(pull[-1]) + float(gram[-1, -1])
            step = bounded(gram[:-1, :-1], rhs, own.ways)
            squares = total - 2.0 * float(step @ rhs) + float(step @ gram[:-1, :-1] @ step)
            found.setdefault(type(own.start), []).append(Promise(own, step, squares))
        return [min(each, key=lambda own: own.squares) for each in found.values()]

    def after(self, promise: Promise) -> list[Array]:
        """Return what the set would leave after the step (µm), by record."""
        change = promise.signature.rows @ np.append(promise.step, 1.0)
        return self._by_record(self._left - self._less(change), promise.signature)

    def after_both(self, a: Promise, b: Promise) -> list[Array]:
        """Return what the set would leave after a step of two starts together (µm), by record."""
        rows = [self._less(each.signature.rows) for each in (a, b)]
        left = self._left - rows[0][:, -1] - rows[1][:, -1]
        columns = np.hstack([each[:, :-1] for each in rows])
        here, fitted = columns[: self._fitted], left[: self._fitted]
        step = bounded(here.T @ here, here.T @ fitted, [*a.signature.ways, *b.signature.ways])
        return self._by_record(left - columns @ step, a.signature, b.signature)


def bounded(gram: Array, rhs: Array, ways: Sequence[tuple[bool, bool]]) -> Array:
    """Return the step of numbers that may go up, down, or both."""
    up, down = np.array(ways, dtype=np.bool_).reshape(-1, 2).T
    every = np.arange(len(rhs))
    allowed = np.concatenate([up, down])
    if not every.size:
        return np.zeros(0)
    return signed_least_squares(gram, rhs, every, allowed, 0.0, allowed.copy())
