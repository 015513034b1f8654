"""Simulation of a hidden truth: all mechanisms in a row on a fine grid, read at the record's samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab.independent.twin import Grid, MaterialTwin, Mechanism, carried, twins


@njit(cache=True)
def _deform(
    u: Array, parts: int, step: float, weights: Array, rest: Array, delta2: float,
    bandwidth: float, exponent: float, reference_rate: float, growth: float, square: float,
    stops: Array, memory: Array,
) -> Array:  # fmt: skip
    """Stress-like stops s_i' = u' within |s_i| <= r_i(t); a play is u - s_i.

    `u` holds whole sampling intervals of `parts` steps. The rate is the difference over an interval,
    Eq. 5, or its low-passed slope; the thresholds are linear in time over the interval.
    """
    out = np.empty_like(u)
    last, rate, growth_before = memory
    half = math.pi * bandwidth * step
    for begin in range(0, len(u), parts):
        if bandwidth > 0.0:
            before = last
            for k in range(begin, begin + parts):
                slope = (u[k] - before) / step
                rate = ((1.0 - half) * rate + 2.0 * half * slope) / (1.0 + half)
                before = u[k]
        else:
            rate = (u[begin + parts - 1] - last) / (parts * step)
        speed = abs(rate)
        if exponent != 1.0 and speed > 0.0:
            speed = reference_rate * math.exp(exponent * math.log(speed / reference_rate))
        growth_now = delta2 * speed
        for k in range(begin, begin + parts):
            share = (k - begin + 1) / parts
            wider = growth_before + share * (growth_now - growth_before)
            plays = 0.0
            for i in range(len(rest)):
                s = stops[i] + (u[k] - last)
                if abs(s) > rest[i] + wider:
                    s = math.copysign(rest[i] + wider, s)
                stops[i] = s
                plays += weights[i + 1] * (u[k] - s)
            last = u[k]
            strain = weights[0] * u[k] + plays * (1.0 + growth * u[k] ** 2)
            out[k] = strain * (1.0 + square * strain)
        growth_before = growth_now
    memory[0], memory[1], memory[2] = last, rate, growth_before
    return out


@dataclass(frozen=True)
class Ceramic:
    """Numbers of the material: the RDPI model's, then those of the effects that lie within it.

    Thresholds grow with v0 (|v| / v0)^p; the voltage turned at `extremum_V` before the record.
    """

    weights: Sequence[float]
    thresholds_V: Sequence[float]
    delta2_s: float
    rate_bandwidth_hz: float | None = None
    exponent: float = 1.0
    reference_rate_V_s: float = 1.0
    extremum_V: float = 0.0
    growth_per_V2: float = 0.0
    square_per_um: float = 0.0


def deformation(c: Ceramic, step_s: float, parts: int) -> Mechanism:
    """Displacement (µm) of the ceramic over the voltage at the stack, with the memory of its stops."""
    weights = np.array(c.weights, dtype=np.float64)
    rest = np.array(c.thresholds_V, dtype=np.float64)

    def start(u: Array) -> Array:
        turned = np.clip(c.extremum_V, -rest, rest)
        return np.array([u[0], 0.0, 0.0, *np.clip(turned + u[0] - c.extremum_V, -rest, rest)])

    def deform(u: Array, state: Array) -> Array:
        return np.asarray(
            _deform(
                u, min(parts, len(u)), step_s, weights, rest, c.delta2_s, c.rate_bandwidth_hz or 0.0,
                c.exponent, c.reference_rate_V_s, c.growth_per_V2, c.square_per_um, state[3:], state[:3],
            )
        )  # fmt: skip

    return carried(start, deform)


TWINS = (
    MaterialTwin(
        "asymmetry", 6, lambda coefficient, span_um: {"square_per_um": coefficient / span_um}
    ),
    MaterialTwin(
        "rate_law",
        11,
        lambda exponent, reference_rate_V_s: {
            "exponent": exponent,
            "reference_rate_V_s": reference_rate_V_s,
        },
    ),
    MaterialTwin(
        "congruency", 14, lambda coefficient, span_V: {"growth_per_V2": coefficient / span_V**2}
    ),
    MaterialTwin("initial_memory", 15, lambda extremum_V: {"extremum_V": extremum_V}),
)
"""Effects that lie in the ceramic."""


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
        mechanisms.append((0, deformation(ceramic, h, parts)))
    elif callable(hysteresis):
        mechanisms.append((0, hysteresis(h, parts)))
    return [mechanism for _, mechanism in sorted(mechanisms, key=lambda item: item[0])]
