"""An independent integration of a core's equation along a path that is linear between samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array


def integrated(slope: Callable[[float, float], float], u: Array, event: bool = False) -> Array:
    """Z after each sample of the command from rest; ``slope(z, sgn u')`` is dz/du.

    With `event` the integration starts anew where z passes zero and the slope may jump.
    """
    z, last, found = 0.0, 0.0, []
    for value in u:
        sign, here = float(np.sign(value - last)), 0.0
        way = abs(value - last)

        def right(_: float, y: Array, sign: float = sign) -> list[float]:
            return [sign * slope(float(y[0]), sign)]

        def passes(_: float, y: Array) -> float:
            return float(y[0])

        passes.terminal = True  # type: ignore[attr-defined]
        while way - here > 0.0:
            stops = passes if event and z * sign < 0.0 else None
            part = solve_ivp(
                right, (here, way), [z], "DOP853", rtol=1e-11, atol=1e-12, events=stops
            )
            here, z = float(part.t[-1]), float(part.y[0, -1])
            if part.status == 1:
                z = 1e-300 * sign
        last = float(value)
        found.append(z)
    return np.array(found)


def corners() -> Array:
    """A command with loops within loops, of both signs, by its turns (V)."""
    return np.array([9.0, -4.0, 6.0, 3.0, 5.0, -11.0, -8.0, -9.5, 14.0, 13.0, 13.5, -2.0, 0.5])


def sampled(turns: Array, longest_V: float) -> tuple[Array, Array]:
    """The command through turns in steps of at most `longest_V` (V), and where the turns are."""
    path, where, last = [], [], 0.0
    for turn in turns:
        count = int(np.ceil(abs(turn - last) / longest_V))
        path.append(np.linspace(last, turn, count + 1)[1:])
        where.append(sum(map(len, path)) - 1)
        last = turn
    return np.concatenate(path), np.array(where)


def run(core: Core, u: Array, ts_s: float = 1e-3) -> Array:
    """Displacement of a core over a command (V)."""
    model = PlantModel(core, "demo", (-30.0, 30.0), (0.0, 8.0))  # type: ignore[arg-type]
    return Plant(model, ts_s).simulate(u)


def path(turns: Array | Sequence[float], samples: int = 40) -> Array:
    """A command through turns (V), each leg of as many samples."""
    legs = [np.linspace(a, b, samples)[1:] for a, b in pairwise(turns)]
    return np.concatenate([turns[:1], *legs])
