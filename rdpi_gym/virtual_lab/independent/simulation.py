"""The hidden truth: all mechanisms in a row, on a fine grid, read at the record's samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab.independent.material import Ceramic, Deformation
from rdpi_gym.virtual_lab.independent.twin import Grid, MaterialTwin, Mechanism, twins

LARGEST_STEP_S = 1e-5
"""The fine grid's step (s) divides the record's sampling time and is no larger than this."""

# Points of the fine grid that are worked on at a time.
_BLOCK = 1 << 18


def simulate_truth(
    hysteresis: Mapping[str, Any] | Callable[[float, int], Mechanism],
    effects: Sequence[Mapping[str, Any]],
    t_s: ArrayLike,
    u_V: ArrayLike,
    largest_step_s: float = LARGEST_STEP_S,
) -> Array:
    """Simulate a plant with effects, independently of the models that are fitted.

    Notes
    -----
    The rate is that of Eq. 5, over one sampling period of the record (or low-passed on the fine grid
    where the plant's rate is band-limited), and the thresholds are linear between samples like the
    command. Eq. 4 is exact for such inputs, so without an effect the sampled model and this one
    are the same, and what differs with one is the effect alone.
    """
    times, command = np.asarray(t_s, dtype=np.float64), np.asarray(u_V, dtype=np.float64)
    if command.ndim != 1 or len(command) < 2 or times.shape != command.shape:
        raise InputError(
            f"times of shape {times.shape} and commands of shape {command.shape}; give two samples "
            "or more of each"
        )
    ts = (times[-1] - times[0]) / (len(times) - 1)
    parts = max(1, math.ceil(ts / largest_step_s * (1.0 - 1e-9)))
    chain = _chain(hysteresis, effects, float(times[0]), ts / parts, parts)
    y = np.empty_like(command)
    y[0] = _through(chain, command[:1])[0]
    fractions = np.arange(1, parts + 1) / parts
    intervals = max(1, _BLOCK // parts)
    for start in range(0, len(command) - 1, intervals):
        end = min(start + intervals, len(command) - 1)
        begin, change = command[start:end], np.diff(command[start : end + 1])
        fine = (begin[:, None] + change[:, None] * fractions).ravel()
        y[start + 1 : end + 1] = _through(chain, fine)[parts - 1 :: parts]
    return y


def _through(chain: Sequence[Mechanism], x: Array) -> Array:
    for mechanism in chain:
        x = mechanism(x)
    return x


def _chain(
    hysteresis: Mapping[str, Any] | Callable[[float, int], Mechanism],
    effects: Sequence[Mapping[str, Any]],
    start_s: float,
    h: float,
    parts: int,
) -> list[Mechanism]:
    ceramic = None if callable(hysteresis) else Ceramic(**hysteresis)
    grid = Grid(start_s, h)
    mechanisms: list[tuple[int, Mechanism]] = []
    for effect in effects:
        values = dict(effect)
        name = values.pop("effect", None)
        twin = twins().get(str(name))
        if twin is None:
            raise InputError(f"no effect is named {name!r} in the independent formulation")
        form = values.pop("form", "")
        if form:
            raise InputError(
                f"{name} in the form {form!r} is not in the independent formulation; "
                "give its simplest form"
            )
        try:
            if isinstance(twin, MaterialTwin):
                if ceramic is None:
                    raise InputError(
                        f"{name} changes the RDPI model itself, and this plant has another hysteresis "
                        "core; leave it out"
                    )
                ceramic = replace(ceramic, **twin.change(**values))
            else:
                mechanisms.append((twin.place, twin.make(grid, **values)))
        except TypeError as error:
            raise InputError(f"{name}: {error}") from error
    if ceramic is not None:
        mechanisms.append((0, Deformation(ceramic, h, parts)))
    elif callable(hysteresis):
        mechanisms.append((0, hysteresis(h, parts)))
    return [mechanism for _, mechanism in sorted(mechanisms, key=lambda item: item[0])]
