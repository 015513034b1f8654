"""Signatures of effects, and what they promise beside a set, by linear algebra alone.

A signature is what an effect changes of the displacement from one of its starts, with the derivatives
by its parameters. All are simulated once, beside the core alone. What a start promises beside a set is
one Gauss-Newton step: the residual of the set, regressed on the signature, less what the set's own
numbers explain of it (the score test of Rao 1948).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np

from rdpi_gym.diagnosis.beam.constants import RACE_SAMPLES
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import NO_FIT, Tangents, effect_rows
from rdpi_gym.identification.least_squares import signed_least_squares
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect, in_chain_order
from rdpi_gym.support.arrays import Array


@dataclass(frozen=True, eq=False)
class Signature:
    """One start of an effect."""

    start: Effect
    rows: Array  # By each parameter, and what the start itself changes (µm), ``(N, p + 1)``
    ways: Sequence[tuple[bool, bool]]  # Whether each parameter may go up and down

    @cached_property
    def gram(self) -> Array:
        """Products of its columns."""
        return np.asarray(self.rows.T @ self.rows)


def signatures(
    records: Sequence[Record],
    core: Core,
    effects: Sequence[Effect],
    left: Array,
    starts: Iterable[Effect],
) -> list[Signature]:
    """Simulate starts beside a set, which leaves so much of the records (µm, centred)."""
    found = []
    for _, group in groupby(starts, key=type):
        alike = list(group)
        try:
            found += _of_one_form(records, core, effects, left, alike)
        except NO_FIT:  # one of them, perhaps
            for start in alike:
                try:
                    found += _of_one_form(records, core, effects, left, [start])
                except NO_FIT:
                    continue
    return [each for each in found if np.isfinite(each.gram).all()]


def _of_one_form(
    records: Sequence[Record],
    core: Core,
    effects: Sequence[Effect],
    left: Array,
    starts: Sequence[Effect],
) -> list[Signature]:
    chains = [in_chain_order([*effects, start]) for start in starts]
    place = next(k for k, effect in enumerate(chains[0]) if effect is starts[0])
    variants = [Variant(core, tuple(chain)) for chain in chains]
    found = []
    for start, own in zip(starts, effect_rows(records, variants, place, RACE_SAMPLES), strict=True):
        rows = np.concatenate(own.rows)
        rows[:, -1] = left - rows[:, -1]
        found.append(Signature(start, rows, own.ways))
    return found


@dataclass(frozen=True, eq=False)
class Promise:
    """What a start promises beside a set."""

    signature: Signature
    squares: float  # That are left after one step (µm²)
    step: Array  # Of the effect's parameters


class Foresight:
    """A set linearised: a basis of its columns, and what it leaves beside them.

    Parameters
    ----------
    at
        On the records to fit.
    """

    def __init__(self, at: Tangents) -> None:
        columns = np.flatnonzero(at.moves)
        self._basis = np.linalg.qr(np.concatenate([rows[:, columns] for rows in at.rows]))[0]
        self.left = self._less(np.concatenate([rows[:, -1] for rows in at.rows]))
        self.squares = float(self.left @ self.left)

    def _less(self, columns: Array) -> Array:
        """Return columns less what the set's own numbers explain of them."""
        return np.asarray(columns - self._basis @ (self._basis.T @ columns))

    def promises(self, offered: Sequence[Signature]) -> list[Promise]:
        """Return what each start promises, most first."""
        found = []
        for own in offered:
            inside = self._basis.T @ own.rows
            gram, pull = own.gram - inside.T @ inside, self.left @ own.rows
            rhs = pull[:-1] - gram[:-1, -1]
            total = self.squares - 2.0 * float(pull[-1]) + float(gram[-1, -1])
            step = bounded(gram[:-1, :-1], rhs, own.ways)
            squares = total - 2.0 * float(step @ rhs) + float(step @ gram[:-1, :-1] @ step)
            found.append(Promise(own, squares, step))
        return sorted(found, key=lambda each: each.squares)

    def after(self, promise: Promise) -> Array:
        """Return what the set would leave after the step (µm)."""
        rows = promise.signature.rows
        return self.left - self._less(rows @ np.append(promise.step, 1.0))

    def both(self, a: Promise, b: Promise) -> float:
        """Return the squares that two starts together would leave (µm²)."""
        rows = self._less(np.hstack([a.signature.rows, b.signature.rows]))
        n = a.signature.rows.shape[1] - 1
        columns = np.delete(rows, (n, rows.shape[1] - 1), axis=1)
        left = self.left - rows[:, n] - rows[:, -1]
        ways = [*a.signature.ways, *b.signature.ways]
        step = bounded(columns.T @ columns, columns.T @ left, ways)
        return float(np.sum((left - columns @ step) ** 2))


def bounded(gram: Array, rhs: Array, ways: Sequence[tuple[bool, bool]]) -> Array:
    """Return the step of numbers that may go up, down, or both."""
    up, down = np.array(ways, dtype=np.bool_).reshape(-1, 2).T
    every = np.arange(len(rhs))
    allowed = np.concatenate([up, down])
    if not every.size:
        return np.zeros(0)
    return signed_least_squares(gram, rhs, every, allowed, 0.0, allowed.copy())
