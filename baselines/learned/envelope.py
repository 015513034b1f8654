"""Envelope of a training: the largest averaged errors and steps of its loops, and their monitor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from baselines.base import Observation
from rdpi_gym.envs.layout import DEFAULT_FIELDS, ObservationLayout
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

QUANTITIES = ("reference_step", "error", "measured_step", "command_step")
"""Reference, measured displacement and command change by so much from sample to sample, and the error
that is seen: in units of the layout's amplitude, commands of half their range."""
AVERAGED_S = 5e-3
"""Time constant (s) over which their squares are averaged."""
MARGIN = 3.0
"""Times the largest average of the training from which on a loop has left what was trained on."""


class Watch:
    """Root mean squares over the last 5 ms of what an observation tells of a loop.

    A policy knows what its training showed it. How fast the reference moves, how fast stage and
    command answer and how large the error is tells a loop from it before anything rings or ends at a
    limit: a student of a stage with damped modes leaves six to ten times its errors on one that has
    a mode of its own. Its memory: mean squares; reference, measured displacement and command before.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> layout = ObservationLayout.for_plant(P10, ts_s=1e-4, preview=1)
    >>> watch = Watch(layout)
    >>> memory = watch.start(1)
    >>> for measured in (0.0, 0.1, 0.1):
    ...     found = watch.take(memory, np.array([[0.1, 0.1, measured, 0.5]]))
    >>> dict(zip(QUANTITIES, found[:, 0].round(4).tolist()))
    {'reference_step': 0.0, 'error': 0.0138, 'measured_step': 0.0139, 'command_step': 0.0}
    """

    rows = len(QUANTITIES) + 3

    def __init__(self, layout: ObservationLayout) -> None:
        self._forgets = 1.0 - math.exp(-layout.ts_s / AVERAGED_S)
        self._columns = [layout.columns[name].start for name in DEFAULT_FIELDS]

    def start(self, lanes: int) -> Array:
        """Return the memory of loops that begin, float64[rows, B]."""
        memory = np.zeros((self.rows, lanes))
        memory[len(QUANTITIES) :] = np.nan
        return memory

    def take(self, memory: Array, observation: Observation) -> Array:
        """Take one sample in, and return the averages."""
        means, before = memory[: len(QUANTITIES)], memory[len(QUANTITIES) :]
        now = np.asarray(observation, dtype=np.float64)[:, self._columns].T
        steps = np.nan_to_num(now - before)
        quantities = np.stack([steps[0], now[0] - now[1], steps[1], steps[2]])
        means += self._forgets * (quantities**2 - means)
        before[:] = now
        return np.asarray(np.sqrt(means))


class EnvelopeRecorder:
    """The largest averages over all loops of an evaluation."""

    def __init__(self, layout: ObservationLayout) -> None:
        self._watch = Watch(layout)
        self._memory: Array | None = None
        self._most = np.zeros(len(QUANTITIES))

    def take(self, observation: Observation) -> None:
        """Take one sample of all loops in, ``(B, D)``."""
        if self._memory is None:
            self._memory = self._watch.start(len(observation))
        found = self._watch.take(self._memory, observation).max(axis=1)
        self._most = np.maximum(self._most, found)

    @property
    def largest(self) -> dict[str, float]:
        """So far, rounded to four digits."""
        return {name: float(f"{x:.4g}") for name, x in zip(QUANTITIES, self._most, strict=True)}


def checked_envelope(document: Any) -> dict[str, float]:
    """Return what a description says was seen; empty where it is of before this was kept."""
    if document is None:
        return {}
    if (
        not isinstance(document, Mapping)
        or sorted(document) != sorted(QUANTITIES)
        or not all(is_finite(x) and x > 0 for x in document.values())
    ):
        raise InputError(
            f"seen is {quoted(document)}; give numbers above 0 for {', '.join(QUANTITIES)}"
        )
    return {name: float(document[name]) for name in QUANTITIES}
