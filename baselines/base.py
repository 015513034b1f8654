"""Base of the controllers of this package: limits, a memory by names, and ``predict``."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


class Limits(NamedTuple):
    """Lowest and highest command (V) and its largest change in one sample (V)."""

    low_V: float
    high_V: float
    step_V: float

    @classmethod
    def of(cls, layout: ObservationLayout) -> Limits:
        """Return what a layout allows; only actions read as increments limit the change."""
        low, high = layout.command_range_V
        step = layout.action_scale_V if layout.action == "increment" else math.inf
        return cls(float(low), float(high), float(step))

    @property
    def rest_V(self) -> float:
        """Command nearest 0 V (V), where an episode begins."""
        return min(max(0.0, self.low_V), self.high_V)


@njit(cache=True)
def limited(command: float, last: float, low: float, high: float, step: float) -> float:
    """Return what is allowed of one command (V) after `last` (V; NaN: no command yet)."""
    allowed = min(max(command, low), high)
    if not np.isnan(last):
        allowed = min(max(allowed, last - step), last + step)
    return allowed


@njit(cache=True)
def limit_block(u: Array, last: Array, low: float, high: float, step: float) -> None:
    """Clip commands to their range and to the largest change from sample to sample, in place."""
    for t in range(u.shape[0]):
        for b in range(u.shape[1]):
            last[b] = u[t, b] = limited(u[t, b], last[b], low, high, step)


class Rows:
    """Named blocks of rows of a memory ``float64[S, B]``.

    Examples
    --------
    >>> import numpy as np
    >>> rows = Rows(last_V=1, measured_um=3)
    >>> memory = np.zeros((rows.total, 2))
    >>> rows.of(memory, "measured_um")[:] = 1.0
    >>> memory[:, 0].tolist()
    [0.0, 1.0, 1.0, 1.0]
    """

    def __init__(self, **counts: int) -> None:
        self._slices: dict[str, slice] = {}
        self.total, self.counts = 0, counts
        for name, count in counts.items():
            self._slices[name] = slice(self.total, self.total + count)
            self.total += count

    def of(self, memory: Array, name: str) -> Array:
        """Return a block as a view, float64[rows, B]."""
        return memory[self._slices[name]]


def shift_in(ring: Array, newest: Array) -> None:
    """Move a block on by one: its oldest entry is dropped and `newest` becomes its last, in place."""
    ring[:-1] = ring[1:].copy()
    ring[-1] = newest


def product(matrix: Array, columns: Array) -> Array:
    """Return ``matrix @ columns``, terms added one after the other.

    A library's product takes them in an order that hangs on the number of lanes, so that what a
    controller does in one of them differs in the last digit.
    """
    if not matrix.size:  # a model without states
        return np.zeros((*matrix.shape[:-1], columns.shape[1]))
    # One layout, so that one compiled kernel serves all: two that are kept by two processes at once
    # may be mistaken for one another.
    rows = matrix if matrix.ndim == 2 else matrix[None]
    if not (rows.flags.carray and rows.dtype == np.float64):
        rows = np.require(rows, np.float64, ["C", "W"])
    found: Array = _products(rows, np.ascontiguousarray(columns))
    return found[0] if matrix.ndim == 1 else found


@njit(cache=True)
def _products(matrix: Array, columns: Array) -> Array:
    rows, terms = matrix.shape
    out = np.zeros((rows, columns.shape[1]))
    for r in range(rows):
        for k in range(terms):
            for b in range(columns.shape[1]):
                out[r, b] += matrix[r, k] * columns[k, b]
    return out


@njit(cache=True)
def lane_products(one: Array, other: Array) -> Array:
    """Return Σ_k one[k] other[k] of every lane, terms added one after the other."""
    out = np.zeros(one.shape[1])
    for k in range(one.shape[0]):
        for b in range(one.shape[1]):
            out[b] += one[k, b] * other[k, b]
    return out


Observation: TypeAlias = NDArray[np.floating[Any]]
"""Observations of B episodes side by side, ``(B, D)``."""


class Baseline(ABC):
    """A :class:`~rdpi_gym.envs.controller.Controller` that Stable-Baselines3's ``evaluate_policy`` runs too.

    A class that states its ``name`` is a controller of that name: nothing else is needed than a file
    in this folder.

    At step k it reads an observation and sets the command u(k+1). What it remembers is one array,
    ``float64[S, B]``: it is handed out by :meth:`predict` and taken back at the next call, and is
    never changed behind the caller's back. So one controller may run several loops in turn.

    Parameters
    ----------
    belief
        What it knows of the plant; the truth is never read.
    layout
        Where an observation shows what, and how an action is read.

    Raises
    ------
    InputError
        The layout reads actions as corrections to a baseline; a baseline computes the command. The
        belief has another kind of hysteresis core than :attr:`needs_core`.

    Attributes
    ----------
    name : str
        What the command line and tables call it; stated by the class itself.
    aliases : tuple of str
        Further names that it is made by; tables have the first.
    on_feedforwards : bool
        Whether it takes a ``feedforward`` too, and is made on each as ``<name>-<feedforward>``.
    inverts_effects : bool
        Whether it makes use of the effects of its belief, beside the hysteresis.
    needs_core : type or None
        Kind of hysteresis core that its belief has to have; None: any.
    """

    name: ClassVar[str]
    aliases: ClassVar[tuple[str, ...]] = ()
    on_feedforwards: ClassVar[bool] = False
    inverts_effects: ClassVar[bool] = False
    needs_core: ClassVar[type[Core] | None] = None

    def __init__(self, belief: PlantModel, layout: ObservationLayout) -> None:
        if layout.action == "correction":
            raise InputError(
                "actions are read as correction to a baseline; a baseline itself needs a layout with action 'command' or 'increment'"
            )
        core, needed = belief.hysteresis, self.needs_core
        if needed is not None and not isinstance(core, needed):
            raise InputError(
                f"{self.name} inverts the core {needed.name}, and belief {belief.name} has the core "
                f"{core.name}; core-inverse inverts any"
            )
        self.belief = belief
        self.layout = layout
        self.limits = Limits.of(layout)

    @abstractmethod
    def start(self, reference_um: Array) -> Array:
        """Return the memory of episodes that begin at rest at the command nearest 0 V.

        Parameters
        ----------
        reference_um
            r(0) (µm), ``(B,)``.

        Returns
        -------
        float64[S, B]
        """

    @abstractmethod
    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """Return u(k+1) (V), ``(B,)``, within the limits, and move the memory on.

        Parameters
        ----------
        observation
            ``(B, D)``.
        reference_um
            r(k) and r(k+1) (µm) as decoded from it, float64[2, B].
        state
            Memory, ``float64[S, B]``, changed in place.
        """

    @property
    def needed_preview(self) -> int:
        """Samples of the reference that a layout should show ahead for all that it can do."""
        return 1

    def warning(self) -> str | None:
        """Return one line on what keeps the controller from what it should do, else None.

        It is outside its stability limit, or inverts its belief in part.
        """
        return None

    def certificate(self) -> str | None:
        """Return one line on what is proved of the loop on its belief, else None.

        It is known before the controller drives anything: small gain, passivity, or poles.
        """
        return None

    def predict(
        self,
        observation: Observation,
        state: Array | None = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], Array]:
        """Return actions and the memory for the next call.

        Parameters
        ----------
        observation
            ``(D,)`` or, for B episodes side by side, ``(B, D)``; the history that the layout says an
            environment appends may stand behind.
        state
            What the last call returned; None begins every episode.
        episode_start
            ``(B,)``, true where an episode begins; its memory is that of rest.
        deterministic
            Without effect: no baseline draws random numbers.

        Returns
        -------
        action : float32[1] or float32[B, 1]
        state : float64[S, B]

        Raises
        ------
        InputError
            The observation does not fit the layout, or the state another number of episodes.

        Examples
        --------
        >>> from baselines import make_controller
        >>> from rdpi_gym.plant import named_plant
        >>> layout = ObservationLayout.for_plant(named_plant("P5"), ts_s=1e-3, preview=1)
        >>> controller = make_controller("none", named_plant("P5"), layout)
        >>> action, state = controller.predict(np.array([0.0, 1.0, 0.0, 0.0], dtype=np.float32))
        >>> round(float(action[0]), 3)
        0.392
        """
        shown = np.asarray(observation)
        batch = self.layout.shown_now(shown[None] if shown.ndim == 1 else shown)
        if batch.ndim != 2 or batch.shape[1] != self.layout.size:
            raise InputError(
                f"an observation of shape {shown.shape}; this layout shows {self.layout.size} numbers, with preview {self.layout.preview}"
            )
        # Only r(k) and r(k+1) are decoded: a long preview costs nothing.
        reference = np.ascontiguousarray(self.layout.reference_um(batch, slice(2)).T)
        moved = self._resumed(reference[0], state, episode_start)
        command = self.next_command(batch, reference, moved)
        action = self.layout.action_for(command, batch)
        return (action[0] if shown.ndim == 1 else action), moved

    def _resumed(
        self, reference_um: Array, state: Array | None, episode_start: ArrayLike | None
    ) -> Array:
        if state is None:
            return self.start(reference_um)
        if state.shape[1] != len(reference_um):
            raise InputError(
                f"a state of {state.shape[1]} episodes with observations of {len(reference_um)}; pass None to begin anew"
            )
        moved = state.copy()
        if episode_start is not None:
            begins = np.atleast_1d(np.asarray(episode_start, dtype=bool))
            if np.count_nonzero(begins):
                moved[:, begins] = self.start(reference_um[begins])
        return moved
