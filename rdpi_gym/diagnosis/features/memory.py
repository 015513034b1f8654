"""What a generic learner with memory sees of a record: its input's past, in many forms."""

from __future__ import annotations

import math
from itertools import combinations_with_replacement

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.play import play_columns
from rdpi_gym.plant.effects.base import DataScale
from rdpi_gym.support.arrays import Array

_PLAYS = 12
_SPREAD = 1.5  # finer at small thresholds, as the comb of the diagnosis
# Widths of the memory that fades along the path, as shares of the span.
_WIDTHS = np.geomspace(0.02, 0.8, 6)
# Time constants from two of the shortest samples to half of the longest record.
_TIME_CONSTANTS = 13
# Oscillators over two decades below half of the highest Nyquist frequency, lightly damped.
_OSCILLATORS, _DAMPING = 24, 0.05
_FASTEST_RATE = 2.0

FAMILIES: tuple[tuple[str, ...], ...] = (
    ("path", "powers"),
    ("path", "output"),
    ("path", "powers", "products", "output"),
    ("output", "time"),
    ("path", "powers", "output", "time"),
    ("output", "time", "heat"),
    ("path", "powers", "output", "time", "rate"),
    ("path", "powers", "products", "mixed", "output", "time", "rate", "heat"),
)
"""Sets of features that a learner may have, from few to all."""


def memory_features(
    record: Record, output_um: Array, scale: DataScale, rows: NDArray[np.intp]
) -> dict[str, Array]:
    """Return features of the input's past, at some of a record's samples.

    The stage is taken to be at rest, with no memory, where the record begins.

    Parameters
    ----------
    record
        Its command and sampling time.
    output_um : float64[T]
        What the model makes of the command (µm).
    scale
        Size of the data: features are of order one, whatever the units.
    rows : intp[N]
        Samples that are wanted.

    Returns
    -------
    dict of float64[N, K]
        ``path`` (rate-independent memory: command, play operators, memory that fades along the
        path), ``powers`` of these, ``products`` of the fading ones, ``mixed`` with the command,
        ``output`` (the model's displacement with the command), ``time`` (low-passes and
        oscillators), ``heat`` (low-passes of the squared rate, as losses warm the stack),
        ``rate`` (rates times play operators).

    Notes
    -----
    Sums over functions of play operators and of fading memory are the two classical ways to
    approximate a rate-independent operator: Preisach's class has the wiping-out property and
    forgets at larger excursions, Duhem's forgets with the path travelled (Visintin, "Differential
    Models of Hysteresis", Springer 1994).

    Examples
    --------
    >>> t = np.arange(500) * 1e-3
    >>> u = 10.0 * np.sin(2 * np.pi * 5.0 * t)
    >>> scale = DataScale(0.0, 10.0, 20.0, 314.0, 1e-3, 0.5)
    >>> record = Record("sine", t, u, 2.0 * u, ts_s=1e-3)
    >>> features = memory_features(record, 2.0 * u, scale, np.arange(0, 500, 10))
    >>> {name: columns.shape for name, columns in features.items()}["path"]
    (50, 19)
    """
    u = (record.u_V - scale.centre_V) / scale.span_V
    y = output_um / max(scale.stroke_um, 1e-9) - scale.centre_V / scale.span_V
    plays = _plays(u)[rows]
    fading = _fading(u)[rows]
    rate = _rate(u, record.ts_s, scale)[rows]
    time = [*_low_passes(u, record.ts_s, scale, rows), *_low_passes(y, record.ts_s, scale, rows)]
    time += _oscillations(y, record.ts_s, scale, rows)
    heat = _low_passes(_rate(u, record.ts_s, scale) ** 2, record.ts_s, scale, rows)
    x, z = u[rows, None], y[rows, None]
    path = np.column_stack([x, plays, fading])
    sizes = np.column_stack([np.abs(rate), np.sqrt(np.abs(rate))])
    moved = np.column_stack([x, plays])
    remembered = np.column_stack([plays, fading])
    return {
        "path": path,
        "powers": np.column_stack([x**2, x**3, x**4, x**5, plays**2, plays**3]),
        "products": np.column_stack([_products(fading, 2), _products(fading, 3)]),
        "mixed": np.column_stack([x * remembered, x**2 * remembered]),
        "output": np.column_stack([z, z**2, z**3, z * x, z**2 * x, z * x**2]),
        "time": np.column_stack([*time, rate]),
        "heat": np.column_stack(heat),
        "rate": np.column_stack([sizes, sizes[:, :1] * moved, sizes[:, 1:] * moved]),
    }


def _plays(u: Array) -> Array:
    thresholds = (np.arange(1, _PLAYS + 1) / (_PLAYS + 1.0)) ** _SPREAD
    columns = np.empty((_PLAYS, len(u)))
    play_columns(u, np.zeros_like(u), thresholds, 0.0, np.full(_PLAYS, u[0]), columns)
    return columns.T


def _fading(u: Array) -> Array:
    columns = np.zeros((len(_WIDTHS), len(u)))
    _directions(u, _WIDTHS, columns)
    return columns.T


@njit(cache=True)
def _directions(u: Array, widths: Array, columns: Array) -> None:
    """Direction of travel, low-passed over the path travelled instead of over time."""
    for i in range(widths.shape[0]):
        z = 0.0
        for k in range(1, u.shape[0]):
            step = u[k] - u[k - 1]
            direction = 1.0 if step > 0.0 else -1.0
            z = direction + (z - direction) * math.exp(-abs(step) / widths[i])
            columns[i, k] = z


def _rate(u: Array, ts_s: float, scale: DataScale) -> Array:
    steps = np.diff(u, prepend=u[:1])
    fastest = max(scale.fastest_V_s / scale.span_V * ts_s, 1e-12)
    return np.clip(steps / fastest, -_FASTEST_RATE, _FASTEST_RATE)


def _low_passes(x: Array, ts_s: float, scale: DataScale, rows: NDArray[np.intp]) -> list[Array]:
    """What low-passes take away: it is of the size of a lag, not of the stroke."""
    constants = np.geomspace(2.0 * scale.shortest_s, 0.5 * scale.longest_s, _TIME_CONSTANTS)
    return [(x - _filtered(x, -ts_s / constant).real)[rows] for constant in constants]


def _oscillations(x: Array, ts_s: float, scale: DataScale, rows: NDArray[np.intp]) -> list[Array]:
    highest_hz = 0.25 / scale.shortest_s
    columns = []
    for frequency_hz in np.geomspace(0.01 * highest_hz, highest_hz, _OSCILLATORS):
        root = 2.0 * np.pi * frequency_hz * complex(-_DAMPING, math.sqrt(1.0 - _DAMPING**2))
        ringing = _filtered(x, root * ts_s)[rows]
        columns += [ringing.real, ringing.imag]
    return columns


def _filtered(x: Array, step: complex) -> NDArray[np.complex128]:
    """First-order low-pass of gain 1 with a real or complex root, settled where x begins."""
    from scipy.signal import lfilter

    pole = np.exp(complex(step))
    filtered, _ = lfilter([1.0 - pole], [1.0, -pole], x, zi=[pole * x[0]])
    return np.asarray(filtered, dtype=np.complex128)


def _products(columns: Array, factors: int) -> Array:
    return np.column_stack(
        [
            np.prod(columns[:, list(chosen)], axis=1)
            for chosen in combinations_with_replacement(range(columns.shape[1]), factors)
        ]
    )
