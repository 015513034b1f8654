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
from rdpi_gym.virtual_lab.independent.measurement_path import Ageing, Hum, Line, Warming
from rdpi_gym.virtual_lab.independent.mechanics import Gap, Vibration, Viscoelasticity
from rdpi_gym.virtual_lab.independent.voltage import CurrentLimit, FirstOrder, Softening

LARGEST_STEP_S = 1e-5
"""The fine grid's step (s) divides the record's sampling time and is no larger than this."""

# Points of the fine grid that are worked on at a time.
_BLOCK = 1 << 18

_Mechanism = Callable[[Array], Array]


def simulate_truth(
    hysteresis: Mapping[str, Any],
    effects: Sequence[Mapping[str, Any]],
    t_s: ArrayLike,
    u_V: ArrayLike,
    largest_step_s: float = LARGEST_STEP_S,
) -> Array:
    """Simulate a plant with effects, independently of the models that are fitted.

    Parameters
    ----------
    hysteresis
        ``weights`` (µm/V), ``thresholds_V``, ``delta2_s``, ``rate_bandwidth_hz`` (or None).
    effects
        ``{"effect": name, parameter: value, ...}`` each, in any order.
    t_s, u_V
        Times (s), evenly spaced on the experiment's clock, and command (V), linear between them;
        ``(T,)``.
    largest_step_s
        Largest step of the fine grid (s).

    Returns
    -------
    float64[T]
        Displacement (µm), without offset and noise.

    Raises
    ------
    InputError
        An unknown effect, a missing parameter, or fewer than two samples.

    Notes
    -----
    The rate is that of Eq. 5, over one sampling period of the record (or low-passed on the fine grid
    where the plant's rate is band-limited), and the thresholds are linear between samples like the
    command. Eq. 4 is exact for such inputs, so without an effect the sampled model and this one
    are the same, and what differs with one is the effect alone.

    Examples
    --------
    >>> t = np.arange(5) * 1e-3
    >>> plain = {"weights": [1.0, 0.5], "thresholds_V": [1.0], "delta2_s": 0.0}
    >>> simulate_truth(plain, [], t, [0.0, 2.0, 4.0, 2.0, 0.0]).round(6).tolist()
    [0.0, 2.5, 5.5, 3.5, 0.5]
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


def _through(chain: Sequence[_Mechanism], x: Array) -> Array:
    for mechanism in chain:
        x = mechanism(x)
    return x


def _chain(
    hysteresis: Mapping[str, Any],
    effects: Sequence[Mapping[str, Any]],
    start_s: float,
    h: float,
    parts: int,
) -> list[_Mechanism]:
    ceramic = Ceramic(**hysteresis)
    mechanisms: list[tuple[int, _Mechanism]] = []
    for effect in effects:
        values = dict(effect)
        name = values.pop("effect", None)
        try:
            if name in _IN_MATERIAL:
                ceramic = replace(ceramic, **_IN_MATERIAL[name](**values))
            elif name in _ORDER:
                mechanisms.append((_ORDER.index(name), _mechanism(name, values, start_s, h)))
            else:
                raise InputError(f"no effect is named {name!r} in the independent formulation")
        except TypeError as error:
            raise InputError(f"{name}: {error}") from error
    mechanisms.append((_ORDER.index("hysteresis"), Deformation(ceramic, h, parts)))
    return [mechanism for _, mechanism in sorted(mechanisms, key=lambda item: item[0])]


_ORDER = (
    *("saturation", "slew_limit", "actuator_lag", "hysteresis", "creep", "resonance", "backlash"),
    *("gain_drift", "thermal_drift", "delay", "sensor_lag", "mains_hum"),
)

_IN_MATERIAL: Mapping[str, Callable[..., dict[str, Any]]] = {
    "rate_law": lambda exponent, reference_rate_V_s: {
        "exponent": exponent,
        "reference_rate_V_s": reference_rate_V_s,
    },
    "initial_memory": lambda extremum_V: {"extremum_V": extremum_V},
    "congruency": lambda coefficient, span_V: {"growth_per_V2": coefficient / span_V**2},
    "asymmetry": lambda coefficient, span_um: {"square_per_um": coefficient / span_um},
}


def _mechanism(name: str, values: Mapping[str, Any], start_s: float, h: float) -> _Mechanism:
    kinds: dict[str, Callable[[], _Mechanism]] = {
        "saturation": lambda: Softening(**values),
        "slew_limit": lambda: CurrentLimit(**values, step_s=h),
        "actuator_lag": lambda: FirstOrder(**values, step_s=h),
        "creep": lambda: Viscoelasticity(**values, step_s=h),
        "resonance": lambda: Vibration(**values, step_s=h),
        "backlash": lambda: Gap(**values),
        "gain_drift": lambda: Ageing(**values, start_s=start_s, step_s=h),
        "thermal_drift": lambda: Warming(**values, start_s=start_s, step_s=h),
        "delay": lambda: Line(**values, step_s=h),
        "sensor_lag": lambda: FirstOrder(**values, step_s=h),
        "mains_hum": lambda: Hum(**values, start_s=start_s, step_s=h),
    }
    return kinds[name]()
