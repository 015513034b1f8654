"""What a model leaves of records that it was not fitted to, in pieces; and how surely one is better."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

PIECES = 8
"""Pieces that a record is cut into: what the spread of an improvement is judged by."""
_DRAWS = 400


def left_by(variant: Variant[Any], record: Record) -> Array:
    """Return what a model leaves of the samples that count (µm), offset free."""
    left = (record.y_um - simulate_effects([variant], record)[:, 0])[record.error_mask]
    centred: Array = left - left.mean()
    return centred


def pieces_of(lefts: Sequence[Array]) -> Array:
    """Return the mean squares (µm²) of the pieces of records, ``(R, PIECES)``."""
    pieces = []
    for left in lefts:
        squares = left**2
        parts = np.array_split(squares, PIECES)  # empty ones where there are few samples
        pieces.append([(part if part.size else squares).mean() for part in parts])
    return np.array(pieces)


def beats(loser: Array, winner: Array, rng: np.random.Generator) -> float:
    """Return the share of bootstrap draws of pieces in which the winner is better."""
    difference = (loser - winner).ravel()
    draws = rng.integers(0, difference.size, (_DRAWS, difference.size))
    return float(np.mean(difference[draws].mean(axis=1) > 0.0))
