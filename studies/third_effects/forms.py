"""Effects in forms that neither other study draws: their draws for a plant, and what they do to a signal."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.effect_discovery.forms import CORE, Form, Grid, Numbers, Scale, UnfitError
from rdpi_gym.support.arrays import Array
from studies.third_effects.physics import dragged_gap, filtered, follow, relaxed, soft_mode

Draw = Callable[[Scale, np.random.Generator, float], dict[str, Any]]
_LONGEST_LAG_S = 0.05  # of amplifiers and sensors
_SHORTEST_CREEP_S = 0.02


def _middle_um(s: Scale) -> float:
    """Return the displacement at the centre of the range (µm)."""
    return s.centre_V * s.stroke_um / s.span_V


def _sign(rng: np.random.Generator) -> float:
    return 1.0 if rng.random() < 0.5 else -1.0


# --- the drive ---


def _langevin(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"steepness": min(0.7 * math.sqrt(size), 6.0), "centre_V": s.centre_V, "span_V": s.span_V}  # fmt: skip


def _magnetise(x: Array, at: Grid, n: Numbers) -> Array:
    a, z = n["steepness"], (x - n["centre_V"]) / n["span_V"]
    az = np.where(np.abs(a * z) < 1e-3, 1e-3, a * z)
    curve = np.where(np.abs(a * z) < 1e-3, a * z / 3.0, 1.0 / np.tanh(az) - 1.0 / az)
    return np.asarray(n["centre_V"] + n["span_V"] * 3.0 / a * curve)


def _knees(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    up, down = 1.0 - np.minimum(0.08 * size * rng.uniform(0.4, 1.6, 2), 0.8)
    low = s.centre_V - s.span_V * (down if rng.random() < 0.5 else 9.0)
    return {"low_V": low, "high_V": s.centre_V + s.span_V * up, "gain": rng.uniform(0.15, 0.6)}


def _droop(x: Array, at: Grid, n: Numbers) -> Array:
    inside = np.clip(x, n["low_V"], n["high_V"])
    return np.asarray(inside + n["gain"] * (x - inside))


def _fastest(s: Scale, size: float) -> float:
    rate = min(s.rate_V_s, s.span_V / (4.0 * s.slowest_ts_s)) if s.is_held else s.rate_V_s
    return rate / (1.0 + 0.3 * size)


def _growing_load(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    rate, growth = _fastest(s, size), rng.uniform(0.2, 0.7)
    return {"up_V_s": rate, "down_V_s": rate, "time_constant_s": 0.0, "growth": growth,
            "centre_V": s.centre_V, "span_V": s.span_V}  # fmt: skip


def _source_alone(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    made = _growing_load(s, rng, size) | {"growth": 0.0}
    return made | {rng.choice(["up_V_s", "down_V_s"]): 1e3 * made["up_V_s"]}


def _lag_s(s: Scale, rng: np.random.Generator, size: float) -> float:
    least = (3.0 * s.slowest_ts_s if s.is_held else s.ts_s) * rng.uniform(1.0, 1.5)
    if least > _LONGEST_LAG_S:
        raise UnfitError("a lag is too fast for these samples")
    return float(min(max(0.08 * size * s.turn_s, least), _LONGEST_LAG_S))


def _varactor(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    far = 1e6 * s.span_V / s.ts_s
    return {"up_V_s": far, "down_V_s": far, "time_constant_s": _lag_s(s, rng, size),
            "growth": rng.uniform(0.2, 0.7), "centre_V": s.centre_V, "span_V": s.span_V}  # fmt: skip


def _charged(x: Array, at: Grid, n: Numbers) -> Array:
    h = at.step_s
    return np.asarray(
        follow(
            x, n["time_constant_s"] / h, n["up_V_s"] * h, n["down_V_s"] * h, n["growth"],
            n["centre_V"], n["span_V"],
        )
    )  # fmt: skip


def _zero(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"time_constant_s": _lag_s(s, rng, 1.5 * size), "zero_share": rng.uniform(0.15, 0.5)}


def _through_zero(x: Array, at: Grid, n: Numbers) -> Array:
    tau = n["time_constant_s"]
    return filtered(x, [n["zero_share"] * tau, 1.0], [tau, 1.0], at.step_s)


# --- the core ---


def _moving(s: Scale) -> None:
    if s.is_held:
        raise UnfitError("a command that jumps has no rate")


def _relaxing(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    _moving(s)
    return {"delta2_s": 0.1 * min(size, 6.0) * s.turn_s, "time_constant_s": s.turn_s * rng.uniform(0.05, 0.3)}  # fmt: skip


def _limited(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    _moving(s)
    return {"height_V": 0.08 * min(size, 6.0) * s.span_V, "knee_V_s": s.rate_V_s * rng.uniform(0.03, 0.2)}  # fmt: skip


def wider_V(n: Numbers, speed_V_s: Array, step_s: float) -> Array:
    """Growth of the thresholds (V) by the law with these numbers."""
    if "knee_V_s" in n:
        return np.asarray(-n["height_V"] * np.expm1(-speed_V_s / n["knee_V_s"]))
    return np.maximum(relaxed(n["delta2_s"] * speed_V_s, n["time_constant_s"], step_s), 0.0)


def _poled(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"turns_V": [_sign(rng) * s.span_V * min(0.4 * size, 1.2)]}


def _lived(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    turns = np.cumsum(rng.normal(size=int(rng.integers(8, 25))))
    return {"turns_V": (turns / np.max(np.abs(turns)) * s.span_V * min(0.5 * size, 1.2)).tolist()}


def _step_gain(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"change": max(_sign(rng) * 0.12 * min(size, 12.0), -0.7), "width": rng.uniform(0.1, 0.4),
            "at": rng.uniform(-0.5, 0.5), "centre_V": s.centre_V, "span_V": s.span_V}  # fmt: skip


def _even_gain(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"change": max(_sign(rng) * 0.12 * min(size, 12.0), -0.7), "centre_V": s.centre_V, "span_V": s.span_V}  # fmt: skip


def weight_gain(n: Numbers, u: Array) -> Array:
    """Factor on the hysteretic part where the command stands."""
    z = (u - n["centre_V"]) / n["span_V"]
    if "width" in n:
        return np.asarray(1.0 + 0.5 * n["change"] * (1.0 + np.tanh((z - n["at"]) / n["width"])))
    return np.asarray(1.0 + n["change"] * np.minimum(z * z, 1.5))


# --- the stage ---


def _contact(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"change": max(_sign(rng) * 0.05 * min(size, 12.0), -0.6), "width_um": s.stroke_um * rng.uniform(0.05, 0.2),
            "at_um": _middle_um(s) + s.stroke_um * rng.uniform(-0.4, 0.4)}  # fmt: skip


def _opened(x: Array, at: Grid, n: Numbers) -> Array:
    w = n["width_um"]
    return np.asarray(x + n["change"] * w * np.logaddexp(0.0, (x - n["at_um"]) / w))


def _lever(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"angle_rad": _sign(rng) * rng.uniform(0.3, 0.8), "swing_rad": min(0.08 * size, 0.6),
            "middle_um": _middle_um(s), "stroke_um": s.stroke_um}  # fmt: skip


def _turned(x: Array, at: Grid, n: Numbers) -> Array:
    a, b = n["angle_rad"], n["swing_rad"]
    z = (x - n["middle_um"]) / n["stroke_um"]
    turned = (np.sin(a + b * z) - math.sin(a)) / (b * math.cos(a))
    return np.asarray(n["middle_um"] + n["stroke_um"] * turned)


def _creep_s(s: Scale, rng: np.random.Generator) -> float:
    low, high = max(_SHORTEST_CREEP_S, 0.02 * s.longest_s), 0.4 * s.longest_s
    if high < 2.0 * low:
        raise UnfitError("the records are too short to creep in")
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _spectrum(
    density: Callable[[Array], Array],
) -> Callable[[Scale, np.random.Generator, float], dict[str, Any]]:
    def draw(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
        tau, spread = _creep_s(s, rng), rng.uniform(0.5, 1.5)
        x = np.linspace(-3.0, 3.0, 9)
        shares = density(x)
        total = 0.03 * min(size, 10.0)
        return {"times_s": (tau * np.exp(spread * x)).tolist(), "shares": (total * shares / shares.sum()).tolist()}  # fmt: skip

    return draw


def _of_plays(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"times_s": [_creep_s(s, rng)], "shares": [0.06 * min(size, 10.0)]}


def creep(x: Array, at: Grid, n: Numbers) -> Array:
    """Add first-order retardations of a signal to it."""
    y = x.copy()
    for tau, share in zip(n["times_s"], n["shares"], strict=True):
        y += share * relaxed(x, tau, at.step_s)
    return y


def _mode_hz(s: Scale, rng: np.random.Generator, size: float) -> float:
    highest = 1.0 / s.ts_s / (25.0 if s.is_held else 10.0)
    return float(max(highest * rng.uniform(0.6, 1.0) / max(size, 1.0) ** 0.5, 12.0 / s.longest_s))


def _softening(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"f0_hz": _mode_hz(s, rng, size), "damping": rng.uniform(0.01, 0.06),
            "soft_1_um": rng.uniform(0.5, 3.0) / s.stroke_um}  # fmt: skip


def _vibrate(x: Array, at: Grid, n: Numbers) -> Array:
    w = 2.0 * math.pi * n["f0_hz"] * at.step_s
    return np.asarray(soft_mode(x, w, n["damping"], n["soft_1_um"]))


def _close_pair(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"f0_hz": _mode_hz(s, rng, size), "damping": rng.uniform(0.008, 0.04),
            "second_ratio": rng.uniform(1.06, 1.3), "second_share": rng.uniform(0.2, 0.6)}  # fmt: skip


def _square(hz: float, damping: float) -> list[float]:
    w = 2.0 * math.pi * hz
    return [1.0 / w**2, 2.0 * damping / w, 1.0]


def _two_levers(x: Array, at: Grid, n: Numbers) -> Array:
    share, second = n["second_share"], n["second_ratio"] * n["f0_hz"]
    a = filtered(x, [1.0], _square(n["f0_hz"], n["damping"]), at.step_s)
    b = filtered(x, [1.0], _square(second, n["damping"]), at.step_s)
    return np.asarray((1.0 - share) * a + share * b)


def _mount(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"f0_hz": _mode_hz(s, rng, size), "damping": rng.uniform(0.02, 0.08),
            "zero_ratio": rng.uniform(0.7, 0.92)}  # fmt: skip


def _on_mount(x: Array, at: Grid, n: Numbers) -> Array:
    zero = _square(n["zero_ratio"] * n["f0_hz"], n["damping"])
    return filtered(x, zero, _square(n["f0_hz"], n["damping"]), at.step_s)


def _dragged(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"half_width_um": 0.004 * size * s.stroke_um, "drag_s": s.turn_s * rng.uniform(3.0, 20.0), "wear": 0.0,
            "middle_um": _middle_um(s), "stroke_um": s.stroke_um}  # fmt: skip


def _worn(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return _dragged(s, rng, size) | {"drag_s": 1e12, "wear": rng.uniform(0.5, 2.0)}


def _lost(x: Array, at: Grid, n: Numbers) -> Array:
    z = (x - n["middle_um"]) / n["stroke_um"]
    half = n["half_width_um"] * (1.0 + n["wear"] * np.exp(-4.0 * z * z))
    return np.asarray(dragged_gap(x, half, -math.expm1(-at.step_s / n["drag_s"])))


# --- the clock ---


def _ageing(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    first = s.total_s * rng.uniform(0.01, 0.1)
    return {"per_decade": _sign(rng) * min(0.006 * size, 0.2), "first_s": first}


def _aged(x: Array, at: Grid, n: Numbers) -> Array:
    return np.asarray(x * (1.0 + n["per_decade"] * np.log10(1.0 + at.t_s / n["first_s"])))


def _room(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"share": min(0.004 * size, 0.1), "period_s": s.total_s * rng.uniform(0.5, 1.5), "phase_rad": rng.uniform(0.0, 6.28)}  # fmt: skip


def _breathed(x: Array, at: Grid, n: Numbers) -> Array:
    turn = 2.0 * math.pi * at.t_s / n["period_s"] + n["phase_rad"]
    return np.asarray(x * (1.0 + n["share"] * (np.sin(turn) - math.sin(n["phase_rad"]))))


def _thermostat(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"change_um": 0.006 * size * s.stroke_um, "period_s": s.total_s * rng.uniform(0.3, 0.9), "total_s": s.total_s, "on": rng.uniform(0.2, 0.6)}  # fmt: skip


def _heated(x: Array, at: Grid, n: Numbers) -> Array:
    period, total = n["period_s"], n["total_s"]
    t = np.linspace(-2.0 * period, 1.2 * total, 8000)  # in its rhythm when the records begin
    room = relaxed(((t / period) % 1.0 < n["on"]) * 1.0, 0.3 * period, t[1] - t[0])
    return np.asarray(x + n["change_um"] * (np.interp(at.t_s, t, room) - room[t.searchsorted(0.0)]))


def _ending_ramp(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"change_um": _sign(rng) * 0.005 * size * s.stroke_um, "end_s": s.total_s * rng.uniform(0.2, 0.7)}  # fmt: skip


def _ramped(x: Array, at: Grid, n: Numbers) -> Array:
    return np.asarray(x + n["change_um"] * np.minimum(at.t_s / n["end_s"], 1.0))


def _late(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    step = s.slowest_ts_s if s.is_held else s.ts_s
    samples = max(1, round(0.08 * size * s.turn_s / step)) + rng.uniform(0.2, 0.8)
    if step > 0.01:
        raise UnfitError("a delay is too short for these samples")
    return {"delay_s": min(samples * step, _LONGEST_LAG_S)}


def _delayed(x: Array, at: Grid, n: Numbers) -> Array:
    k = np.arange(x.size, dtype=np.float64)
    return np.asarray(np.interp(k - n["delay_s"] / at.step_s, k, x))


def _integrating(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"window_s": 2.0 * _lag_s(s, rng, size)}


def _averaged(x: Array, at: Grid, n: Numbers) -> Array:
    points = max(1, round(n["window_s"] / at.step_s))
    total = np.cumsum(np.concatenate([np.full(points, x[0]), x]))
    return np.asarray((total[points:] - total[:-points]) / points)


def _third_order(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"corner_rad_s": 2.0 / _lag_s(s, rng, size)}


def _butterworth(x: Array, at: Grid, n: Numbers) -> Array:
    w = n["corner_rad_s"]
    y = filtered(x, [1.0], [1.0 / w, 1.0], at.step_s)
    return filtered(y, [1.0], [1.0 / w**2, 1.0 / w, 1.0], at.step_s)


def _mains(s: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    if 1.0 / s.slowest_ts_s < 300.0:
        raise UnfitError("the mains is not sampled")
    return {"amplitude_um": 0.0015 * size * s.stroke_um, "frequency_hz": float(rng.choice([50.0, 60.0])),
            "phase_rad": rng.uniform(0.0, 6.28), "wander_rad": rng.uniform(0.2, 1.0),
            "wander_hz": rng.uniform(0.02, 0.2)}  # fmt: skip


def _hum(x: Array, at: Grid, n: Numbers) -> Array:
    wander = n["wander_rad"] * np.sin(2.0 * math.pi * n["wander_hz"] * at.t_s)
    turn = 2.0 * math.pi * n["frequency_hz"] * at.t_s + n["phase_rad"] + wander
    return np.asarray(x + n["amplitude_um"] * (np.sin(turn) + 0.3 * np.sin(3.0 * turn)))


def _rectified(x: Array, at: Grid, n: Numbers) -> Array:
    turn = math.pi * n["frequency_hz"] * at.t_s + n["phase_rad"]
    return np.asarray(x + 2.0 * n["amplitude_um"] * (np.abs(np.sin(turn)) - 2.0 / math.pi))


FORMS: Sequence[Form] = (
    Form("saturation", "Langevin", 10, _langevin, _magnetise),
    Form("saturation", "gain that droops beyond knees", 10, _knees, _droop),
    Form("slew_limit", "load that grows with the voltage", 20, _growing_load, _charged),
    Form("slew_limit", "one direction alone", 20, _source_alone, _charged),
    Form("actuator_lag", "load that grows with the voltage", 30, _varactor, _charged),
    Form("actuator_lag", "pole and zero", 30, _zero, _through_zero),
    Form("rate_law", "thresholds that relax", CORE, _relaxing),
    Form("rate_law", "exponential to a limit", CORE, _limited),
    Form("initial_memory", "poled to one side", CORE, _poled),
    Form("initial_memory", "long history", CORE, _lived),
    Form("congruency", "step in the bias", CORE, _step_gain),
    Form("congruency", "even in the bias", CORE, _even_gain),
    Form("creep", "of the plays alone", CORE, _of_plays),
    Form("asymmetry", "contact that opens", 50, _contact, _opened),
    Form("asymmetry", "lever with a cosine error", 50, _lever, _turned),
    Form("creep", "log-normal spectrum", 60, _spectrum(lambda x: np.exp(-0.5 * x * x)), creep),
    Form("creep", "Cole-Cole spectrum", 60, _spectrum(lambda x: 1.0 / np.cosh(x)), creep),
    Form("resonance", "softening mode", 70, _softening, _vibrate),
    Form("resonance", "two close modes", 70, _close_pair, _two_levers),
    Form("resonance", "zero below the mode", 70, _mount, _on_mount),
    Form("backlash", "gap with drag", 80, _dragged, _lost),
    Form("backlash", "gap worn in the middle", 80, _worn, _lost),
    Form("gain_drift", "logarithm of time", 90, _ageing, _aged),
    Form("gain_drift", "cycle of the room", 90, _room, _breathed),
    Form("thermal_drift", "thermostat through a lag", 100, _thermostat, _heated),
    Form("thermal_drift", "ramp that ends", 100, _ending_ramp, _ramped),
    Form("delay", "fraction of a sample", 110, _late, _delayed),
    Form("sensor_lag", "integrating converter", 120, _integrating, _averaged),
    Form("sensor_lag", "Butterworth, third order", 120, _third_order, _butterworth),
    Form("mains_hum", "wandering phase", 130, _mains, _hum),
    Form("mains_hum", "rectified", 130, _mains, _rectified),
)
"""Every form that may be hidden, in the chain's order."""
EFFECTS: tuple[str, ...] = tuple(dict.fromkeys(form.effect for form in FORMS))
"""Names of the effects."""
