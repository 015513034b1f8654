"""Parameters as kernels read them: one column a lane, rows as play.py states them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite, shown
from rdpi_gym.support.errors import InputError


def check_ts(ts_s: float) -> float:
    """Return `ts_s` (s) as a float, or refuse one that is not finite and above zero.

    Raises
    ------
    InputError
        With the value found.

    Examples
    --------
    >>> check_ts(5e-5)
    5e-05
    """
    if not (is_finite(ts_s) and ts_s > 0):
        raise InputError(f"ts_s is {shown(ts_s)}; give a sampling time above 0 s, for example 5e-5")
    return float(ts_s)


def pack(models: Sequence[Core], ts_s: float, offsets_um: Sequence[float]) -> Array:
    """Pack the parameters of hysteresis cores for their kernel.

    Parameters
    ----------
    models
        One core a lane, all of one kind with the same n.
    ts_s
        Sampling time (s); it sets the pole of a band-limited rate.
    offsets_um
        Added to each lane's displacement (µm).

    Returns
    -------
    float64[P + 2, B]
        What the core packs, the pole of the rate's low-pass, the offset (µm).

    Raises
    ------
    InputError
        The models differ in kind or in n, or Ts is not above zero.

    Examples
    --------
    >>> from rdpi_gym.plant import RDPI
    >>> pack([RDPI.from_law([1.0, 0.5], 2.0, 0.0)], 1e-4, [0.0]).ravel().tolist()
    [1.0, 0.5, 2.0, 0.0, 0.0, 0.0]
    """
    check_ts(ts_s)
    if len({model.name for model in models}) != 1:
        names = sorted({model.name for model in models})
        raise InputError(
            f"lanes with the cores {' and '.join(names)}; all lanes of one plant need the same one"
        )
    if len({model.n for model in models}) != 1:
        counts = sorted({model.n for model in models})
        raise InputError(
            f"lanes with {counts} play operators; all lanes of one plant need the same n"
        )
    columns = [
        [*m.coefficients(), m.rate_pole(ts_s), float(offset)]
        for m, offset in zip(models, offsets_um, strict=True)
    ]
    if len({len(column) for column in columns}) != 1:
        counts = sorted({len(model.gains) for model in models})
        raise InputError(
            f"lanes with {counts} gains; all lanes of one plant need as many of the core {models[0].name}"
        )
    return np.ascontiguousarray(np.array(columns, dtype=np.float64).T)


def empty_state(n: int, lanes: int) -> Array:
    """State of `lanes` plants with `n` rows of memory that have never been moved: float64[n + 2, lanes].

    Examples
    --------
    >>> empty_state(5, 3).shape
    (7, 3)
    """
    return np.zeros((n + 2, lanes))
