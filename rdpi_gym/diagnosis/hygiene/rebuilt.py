"""A command that was clipped in the recorder, rebuilt from the displacement that followed it."""

from __future__ import annotations

import numpy as np

from rdpi_gym.diagnosis.hygiene.finding import BoolArray, runs
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.play import play_columns
from rdpi_gym.support.arrays import Array

_REACH = 32  # samples to either side from which the linear part is taken
_PLAYS = 12
_ROUNDS = 2  # a third changes nothing
_RIDGE = 1e-9
_LEAST, _MOST = 4, 20_000  # samples for each weight that is fitted, and samples of all
_POOR = 0.1  # of the swing: an inverse that misses the known command by more tells nothing


def rebuilt_command(
    record: Record, unknown: BoolArray, bad: BoolArray
) -> tuple[Array, float] | None:
    """Tell from the displacement what was commanded where the recorded command is clipped.

    Notes
    -----
    The plant is taken as play operators followed by a linear filter, its inverse as the inverse
    filter followed by play operators (the inverse of a Prandtl-Ishlinskii model is one, Kuhnen).
    Both are fitted by least squares where the command is known, in turns: the filter from the
    command that is rebuilt so far, the inverse plays from the displacement through that filter.
    What the inverse misses on either side of a stretch is taken from it in a straight line.
    """
    u = record.u_V
    y = record.y_um - record.y_um.mean()
    known = np.flatnonzero(~(unknown | bad) & record.error_mask)
    if known.size < _LEAST * (2 * _REACH + _PLAYS + 5):
        return None
    rows = known[:: -(-known.size // _MOST)]
    slow = np.vander(np.linspace(-1.0, 1.0, u.size), 3)
    near = _near(y, rows)
    weights = _fitted(np.hstack([slow[rows], near]), u[rows])
    inverse = slow @ weights[:3] + _filtered(y, weights[3:])
    command = _joined(inverse, u, unknown)
    others = np.delete(np.arange(2 * _REACH + 1), _REACH)
    for _ in range(_ROUNDS):
        plays = _plays(command, first=0)
        apart = y[rows, None] - near[:, others]
        weights = _fitted(np.hstack([apart, slow[rows], plays[rows]]), y[rows])
        taps = np.zeros(2 * _REACH + 1)
        taps[others] = weights[: others.size]
        taps[_REACH] = 1.0 - taps.sum()
        before_filter = _filtered(y, taps)
        inverse_plays = _plays(before_filter, first=1)
        columns = [slow[rows], inverse_plays[rows], _near(before_filter, rows)]
        weights = _fitted(np.hstack(columns), u[rows])
        inverse = slow @ weights[:3] + inverse_plays @ weights[3 : 3 + _PLAYS]
        inverse = inverse + _filtered(before_filter, weights[3 + _PLAYS :])
        command = _joined(inverse, u, unknown)
    missed = float(np.sqrt(np.mean((inverse - u)[known] ** 2)))
    return None if missed > _POOR * float(np.ptp(u)) else (command, missed)


def _near(x: Array, rows: np.ndarray[tuple[int], np.dtype[np.intp]]) -> Array:
    """Samples about each of some rows, ``(rows, 2 reach + 1)``; the ends are held."""
    at = np.clip(rows[:, None] + np.arange(-_REACH, _REACH + 1), 0, x.size - 1)
    return np.asarray(x[at])


def _filtered(x: Array, weights: Array) -> Array:
    """Weigh the samples about each sample: what `_near` gives, times the weights."""
    return np.asarray(np.correlate(np.pad(x, _REACH, mode="edge"), weights, "valid"))


def _plays(x: Array, first: int) -> Array:
    """Play operators with thresholds up to half of the swing, ``(N, plays)``, from `first` on."""
    rest = float(np.ptp(x)) * np.linspace(0.0, 0.5, _PLAYS + 1)[first:]
    columns = np.empty((rest.size, x.size))
    play_columns(x, np.zeros(x.size), rest, 0.0, np.zeros(rest.size), columns)
    return columns.T


def _fitted(columns: Array, target: Array) -> Array:
    """Least squares with a ridge that is small beside every column."""
    size = np.sqrt(np.mean(columns**2, axis=0))
    scaled = columns / np.where(size > 0.0, size, 1.0)
    gram = scaled.T @ scaled / len(target) + _RIDGE * np.eye(size.size)
    weights = np.linalg.solve(gram, scaled.T @ target / len(target))
    return np.asarray(weights / np.where(size > 0.0, size, 1.0))


def _joined(inverse: Array, u: Array, unknown: BoolArray) -> Array:
    """The command, and where it is unknown the inverse, moved to meet it at both ends."""
    command = u.copy()
    middle = 0.5 * (float(u.max()) + float(u.min()))
    for first, last in runs(unknown):
        missed = [u[k] - inverse[k] for k in (first - 1, last) if 0 <= k < u.size]
        told = inverse[first:last] + np.linspace(missed[0], missed[-1], last - first + 2)[1:-1]
        beyond = np.maximum if u[first] > middle else np.minimum
        command[first:last] = beyond(told, u[first:last])
    return command
