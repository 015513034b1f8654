"""Effects in forms that the catalogue does not begin with: how each is drawn, and what it does."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.effect_discovery.physics import (
    charged_softly,
    gap,
    limited_rate,
    linear,
)
from benchmarks.effect_discovery.protocols import Experiment
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

Numbers = Mapping[str, Any]
CORE = 40
"""Place of the hysteresis in the chain."""
TIMED = tuple(name for name, kind in CATALOGUE.items() if kind.clocked)
"""Effects that go by the clock and not by the command."""
_SHORTEST_CREEP_S = 0.02  # the catalogue's shortest time constant is 0.01 s
# What amplifiers, sensors and rooms do at most, whatever the records would show.
_LONGEST_LAG_S, _LONGEST_DELAY_S = 0.05, 0.02
_FASTEST_GAIN_1_S, _FASTEST_DRIFT_UM_S, _SHORTEST_DRIFT_S = 0.02, 0.5, 1.0
_ELEMENTS = 3.0  # a decade of time, of a spectrum of creep


class UnfitError(InputError):
    """These records cannot hold the effect."""


@dataclass(frozen=True)
class Scale:
    """Size of an experiment on a plant, which effects are drawn to suit."""

    # of the command and the displacement, half of peak to peak
    centre_V: float
    span_V: float
    stroke_um: float
    rate_V_s: float  # fastest rate of the command
    # shortest and longest sampling time (s)
    ts_s: float
    slowest_ts_s: float
    # longest record, and all of them (s)
    longest_s: float
    total_s: float
    is_held: bool  # whether a command is held between the samples
    is_coarse: bool  # whether effects may be faster than the samples can show

    @property
    def turn_s(self) -> float:
        """Time that the fastest rate takes across the span (s)."""
        return self.span_V / self.rate_V_s

    @property
    def least_s(self) -> float:
        """Shortest time that the samples show (s)."""
        if self.is_coarse:
            return 0.2 * self.ts_s
        return 3.0 * self.slowest_ts_s if self.is_held else 1.0 * self.ts_s


def scale_of(experiment: Experiment, stroke_um: float, is_coarse: bool) -> Scale:
    """Return the size of an experiment on a plant."""
    steps = [d.ts_s for d in experiment.drives]
    durations = [d.duration_s for d in experiment.drives]
    is_held = any(d.is_held for d in experiment.drives)
    return Scale(
        experiment.centre_V, experiment.span_V, stroke_um, experiment.fastest_rate_V_s, min(steps), max(steps),
        max(durations), sum(durations), is_held, is_coarse,
    )  # fmt: skip


@dataclass(frozen=True)
class Grid:
    """Fine grid that a mechanism works on."""

    t_s: Array  # float64[P]: Clock of the experiment at every point (s)
    step_s: float  # step of the grid


@dataclass(frozen=True)
class Form:
    """One form of an effect."""

    effect: str  # its name in the catalogue
    form: str  # what is unlike the catalogue's simplest
    place: int  # in the chain; :data:`CORE` for what changes the hysteresis itself
    # numbers for a scale and a size; a larger size is a larger effect
    draw: Callable[[Scale, np.random.Generator, float], dict[str, Any]]
    # what it makes of a signal; None where it changes the hysteresis
    apply: Callable[[Array, Grid, Numbers], Array] | None = None


@dataclass(frozen=True)
class Mechanism:
    """A form with its numbers."""

    form: Form
    numbers: Numbers

    @property
    def effect(self) -> str:
        """Name of the effect in the catalogue."""
        return self.form.effect

    def to_dict(self) -> dict[str, Any]:
        """Return effect, form and numbers, as JSON."""
        return {"effect": self.effect, "form": self.form.form, **dict(self.numbers)}


def _sign(rng: np.random.Generator) -> float:
    return 1.0 if rng.random() < 0.5 else -1.0


# --- in front of the plays ---


def _rails(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    up, down = (min(0.05 * size * rng.uniform(0.5, 1.5), 0.6) for _ in range(2))
    return {
        "low_V": scale.centre_V - scale.span_V * (1.0 - down),
        "high_V": scale.centre_V + scale.span_V * (1.0 - up),
    }


def _one_rail(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    cut, far = min(0.06 * size, 0.6), 10.0 * scale.span_V
    low, high = scale.centre_V - far, scale.centre_V + scale.span_V * (1.0 - cut)
    if rng.random() < 0.5:
        low, high = 2.0 * scale.centre_V - high, 2.0 * scale.centre_V - low
    return {"low_V": low, "high_V": high}


def _clip(x: Array, at: Grid, n: Numbers) -> Array:
    return np.clip(x, n["low_V"], n["high_V"])


def _soft(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    limits = scale.span_V * np.maximum(2.5 / np.sqrt(size) * rng.uniform(0.8, 1.25, 2), 0.75)
    return {"up_V": float(limits[0]), "down_V": float(limits[1]), "centre_V": scale.centre_V}


def _bounded(x: Array, at: Grid, n: Numbers) -> Array:
    from scipy.special import erf

    y = x - n["centre_V"]
    limit = np.where(y > 0.0, n["up_V"], n["down_V"])
    return np.asarray(n["centre_V"] + limit * erf(0.5 * math.sqrt(math.pi) * y / limit))


def _slew(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    fastest = scale.rate_V_s
    if scale.is_held and not scale.is_coarse:  # a step takes some samples
        fastest = min(fastest, scale.span_V / (4.0 * scale.slowest_ts_s))
    rates = [fastest / (1.0 + 0.3 * size * f) for f in (1.0, rng.uniform(0.4, 0.8))]
    if rng.random() < 0.5:
        rates.reverse()
    return {"up_V_s": rates[0], "down_V_s": rates[1]}


def _limit_rate(x: Array, at: Grid, n: Numbers) -> Array:
    return np.asarray(limited_rate(x, n["up_V_s"] * at.step_s, n["down_V_s"] * at.step_s))


def _charge(x: Array, at: Grid, n: Numbers) -> Array:
    softness = max(n["softness_s"] / at.step_s, 1.0)
    return np.asarray(
        charged_softly(x, n["up_V_s"] * at.step_s, n["down_V_s"] * at.step_s, softness)
    )


def _soft_slew(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return _slew(scale, rng, size) | {"softness_s": 0.3 * scale.least_s}


def _tau(scale: Scale, rng: np.random.Generator, size: float) -> float:
    if 1.5 * scale.least_s > _LONGEST_LAG_S:
        raise UnfitError("a lag is too fast for these samples")
    tau = max(0.1 * size * scale.turn_s, scale.least_s * rng.uniform(1.0, 1.5))
    return min(tau, _LONGEST_LAG_S)


def _two_poles(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    tau = _tau(scale, rng, size)
    return {"time_constant_s": tau, "second_s": tau * rng.uniform(0.3, 1.0)}


def _second_order(x: Array, at: Grid, n: Numbers) -> Array:
    a, b = n["time_constant_s"], n["second_s"]
    return linear(x, [1.0], [a * b, a + b, 1.0], at.step_s)


def _bessel(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"order": int(rng.integers(2, 5)), "delay_s": _tau(scale, rng, size)}


def _through_bessel(x: Array, at: Grid, n: Numbers) -> Array:
    from scipy.signal import bessel

    _, denominator = bessel(n["order"], 1.0 / n["delay_s"], analog=True, norm="delay")
    return linear(x, [1.0], (denominator / denominator[-1]).tolist(), at.step_s)


# --- the hysteresis itself ---


def _table(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    _check_moves(scale)
    at = np.array([0.0, 0.03, 0.1, 0.25, 0.5, 1.0, 4.0])
    rises = np.diff(at) ** rng.uniform(0.2, 0.6) * rng.uniform(0.6, 1.4, at.size - 1)
    heights = np.concatenate([[0.0], np.cumsum(rises)])
    heights *= 0.08 * min(size, 8.0) * scale.span_V / heights[-2]
    return {"rates_V_s": (scale.rate_V_s * at).tolist(), "wider_V": heights.tolist()}


def _check_moves(scale: Scale) -> None:
    if scale.is_held:
        raise UnfitError("a command that jumps has no rate")


def _arcsinh(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    _check_moves(scale)
    knee = rng.uniform(0.02, 0.15)
    height = 0.08 * min(size, 8.0) * scale.span_V / math.asinh(1.0 / knee)
    return {"knee_V_s": knee * scale.rate_V_s, "height_V": height}


def wider_V(n: Numbers, speed_V_s: Array) -> Array:
    """Growth of the thresholds with the speed (V), by the law with these numbers."""
    if "rates_V_s" in n:
        return np.interp(speed_V_s, n["rates_V_s"], n["wider_V"])
    return np.asarray(n["height_V"] * np.arcsinh(speed_V_s / n["knee_V_s"]))


def _past(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    reach = _sign(rng) * scale.span_V * min(0.35 * size, 1.0)
    shares = np.cumprod(np.concatenate([[1.0], -rng.uniform(0.15, 0.7, int(rng.integers(1, 4)))]))
    return {"turns_V": (reach * shares).tolist()}


def _odd(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    c = _sign(rng) * min(0.08 * size, 0.8)
    return {"coefficient": c, "centre_V": scale.centre_V, "span_V": scale.span_V}


def _bell(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    c = max(_sign(rng) * 0.12 * size, -0.8)
    return {
        "coefficient": min(c, 4.0),
        "bias_V": scale.centre_V + scale.span_V * rng.uniform(-0.5, 0.5),
        "width_V": scale.span_V * rng.uniform(0.3, 0.7),
    }


def weight_gain(n: Numbers, u_V: Array) -> Array:
    """Factor on the weights of the plays where the command stands."""
    if "bias_V" in n:
        bell = np.exp(-(((u_V - n["bias_V"]) / n["width_V"]) ** 2))
        return np.asarray(1.0 + n["coefficient"] * bell)
    return np.asarray(1.0 + n["coefficient"] * (u_V - n["centre_V"]) / n["span_V"])


def _two_envelopes(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    wide, narrow = min(0.03 * size, 0.45), rng.uniform(0.4, 0.9)
    bends = (wide, narrow * wide) if rng.random() < 0.5 else (-narrow * wide, -wide)
    return {
        "rising": bends[0], "falling": bends[1], "growth": _sign(rng) * rng.uniform(0.4, 1.2),
        "centre_V": scale.centre_V, "span_V": scale.span_V,
    }  # fmt: skip


def envelopes(n: Numbers, u_V: Array) -> tuple[Array, Array]:
    """Envelopes of the falling and the rising branch (V): exponentials."""
    k = n["growth"]
    s = k * (u_V - n["centre_V"]) / n["span_V"]
    bend = n["span_V"] * 2.0 * (np.expm1(s) - s) / k**2
    return u_V + n["falling"] * bend, u_V + n["rising"] * bend


# --- behind the plays ---


def _cubic(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    c = _sign(rng) * min(0.02 * size, 0.3)
    return {
        "square": c, "cube": c * rng.uniform(-0.4, 0.4), "span_um": scale.stroke_um,
        "centre_um": scale.centre_V * scale.stroke_um / scale.span_V,
    }  # fmt: skip


def _polynomial(x: Array, at: Grid, n: Numbers) -> Array:
    y = (x - n["centre_um"]) / n["span_um"]
    return np.asarray(x + n["span_um"] * (n["square"] * y**2 + n["cube"] * y**3))


def _bend(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {
        "bend": _sign(rng) * min(0.05 * size, 1.0), "span_um": scale.stroke_um,
        "centre_um": scale.centre_V * scale.stroke_um / scale.span_V,
    }  # fmt: skip


def _exponential(x: Array, at: Grid, n: Numbers) -> Array:
    y = (x - n["centre_um"]) / n["span_um"]
    return np.asarray(n["centre_um"] + n["span_um"] * np.expm1(n["bend"] * y) / n["bend"])


def _creep_times(scale: Scale, rng: np.random.Generator, count: int) -> list[float]:
    low, high = max(_SHORTEST_CREEP_S, 0.01 * scale.longest_s), 0.5 * scale.longest_s
    if high < 3.0 * low:
        raise UnfitError(f"a record of {scale.longest_s:.3g} s is too short to creep in")
    ends = np.exp(np.linspace(math.log(low), math.log(high), count + 1))
    return [math.exp(rng.uniform(math.log(a), math.log(b))) for a, b in pairwise(ends.tolist())]


def _elements(count: int) -> Callable[[Scale, np.random.Generator, float], dict[str, Any]]:
    def draw(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
        times = _creep_times(scale, rng, count)
        shares = 0.02 * min(size, 10.0) * rng.uniform(0.5, 1.5, count) / math.sqrt(count)
        return {"times_s": times, "shares": shares.tolist()}

    return draw


def _spectrum(low_s: float, high_s: float, slope: float) -> tuple[Array, Array]:
    count = max(2, round(_ELEMENTS * math.log10(high_s / low_s)))
    times = np.exp(np.linspace(math.log(low_s), math.log(high_s), count))
    return times, times**slope / np.sum(times**slope)


def _truncated(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    low, high = _creep_times(scale, rng, 2)
    high = max(high, 5.0 * low)
    times, shares = _spectrum(low, high, 0.0)
    total = 0.015 * min(size, 10.0) * math.log10(high / low)
    return {"times_s": times.tolist(), "shares": (total * shares).tolist()}


def _power(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    low, _ = _creep_times(scale, rng, 2)
    times, shares = _spectrum(low, 5.0 * scale.longest_s, rng.uniform(0.15, 0.4))
    return {"times_s": times.tolist(), "shares": (0.04 * min(size, 10.0) * shares).tolist()}


def _kelvin_voigt(x: Array, at: Grid, n: Numbers) -> Array:
    y = x.copy()
    for tau, share in zip(n["times_s"], n["shares"], strict=True):
        y += share * linear(x, [1.0], [tau, 1.0], at.step_s)
    return y


def _mode(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    fs = 1.0 / scale.ts_s
    highest = fs / (3.0 if scale.is_coarse else 12.0 if not scale.is_held else 25.0)
    f0 = highest * rng.uniform(0.7, 1.0) / max(size, 1.0) ** 0.5
    return {"f0_hz": max(f0, 10.0 / scale.longest_s), "damping": rng.uniform(0.01, 0.08)}


def _two_modes(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    ratio, share = rng.uniform(1.8, 4.0), rng.uniform(0.02, 0.12)
    return _mode(scale, rng, size) | {
        "second_ratio": ratio, "second_share": share, "second_damping": rng.uniform(0.01, 0.08),
    }  # fmt: skip


def _with_zero(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    second = rng.uniform(1.8, 4.0)
    return _mode(scale, rng, size) | {
        "zero_ratio": 1.0 + (second - 1.0) * rng.uniform(0.4, 0.8), "zero_damping": 0.02,
        "second_ratio": second, "second_damping": rng.uniform(0.01, 0.08),
    }  # fmt: skip


def _square(hz: float, damping: float) -> Array:
    w = 2.0 * math.pi * hz
    return np.array([1.0 / w**2, 2.0 * damping / w, 1.0])


def _vibrate(x: Array, at: Grid, n: Numbers) -> Array:
    f0 = n["f0_hz"]
    first = _square(f0, n["damping"])
    second = _square(f0 * n["second_ratio"], n["second_damping"])
    if "zero_ratio" in n:
        top = _square(f0 * n["zero_ratio"], n["zero_damping"])
    else:
        share = n["second_share"]
        top = (1.0 - share) * second + share * first
    return linear(x, top.tolist(), np.convolve(first, second).tolist(), at.step_s)


def _width(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return {"half_width_um": 0.003 * size * scale.stroke_um * rng.uniform(0.7, 1.4)}


def _gap(x: Array, at: Grid, n: Numbers) -> Array:
    return np.asarray(gap(x, n["half_width_um"]))


def _compliant_width(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    return _width(scale, rng, size) | {"compliance": rng.uniform(0.05, 0.3)}


def _compliant_gap(x: Array, at: Grid, n: Numbers) -> Array:
    c = n["compliance"]
    return np.asarray(c * x + (1.0 - c) * gap(x, n["half_width_um"]))


_WALK_LINES, _LOWEST = 6, 0.4  # lines of a walk, and periods of the lowest in all records
_WALK_SLOPE = (
    2.0 * math.pi * _LOWEST * math.sqrt(_WALK_LINES)
)  # rms slope of size one, in all records


def _walk(rng: np.random.Generator, total_s: float, size: float) -> dict[str, Any]:
    lines = np.arange(1, _WALK_LINES + 1)
    return {
        "sizes": (size * rng.normal(size=lines.size) / lines).tolist(),
        "phases_rad": rng.uniform(0.0, 2.0 * math.pi, lines.size).tolist(),
        "lowest_hz": _LOWEST / total_s,
    }


def _walked(t: Array, n: Numbers) -> Array:
    """Random walk without its fastest steps: lines whose size falls with their frequency."""
    out = np.zeros_like(t)
    for k, (size, phase) in enumerate(zip(n["sizes"], n["phases_rad"], strict=True), start=1):
        out += size * (np.sin(2.0 * math.pi * k * n["lowest_hz"] * t + phase) - math.sin(phase))
    return out


def _gain_limit(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    sign, tau = _sign(rng), scale.total_s * rng.uniform(0.15, 0.8)
    change = min(0.005 * size, 0.5, _FASTEST_GAIN_1_S * tau)
    return {"change": sign * change, "time_constant_s": tau}


def _gain_to_limit(x: Array, at: Grid, n: Numbers) -> Array:
    return np.asarray(x * (1.0 - n["change"] * np.expm1(-at.t_s / n["time_constant_s"])))


def _gain_walk(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    largest = _FASTEST_GAIN_1_S * scale.total_s / _WALK_SLOPE
    return _walk(rng, scale.total_s, min(0.003 * size, largest))


def _wandering_gain(x: Array, at: Grid, n: Numbers) -> Array:
    return np.asarray(x * (1.0 + _walked(at.t_s, n)))


def _drift_limit(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    first = max(_SHORTEST_DRIFT_S, scale.total_s * rng.uniform(0.05, 0.2))
    second = max(2.0 * first, scale.total_s * rng.uniform(0.4, 1.0))
    change = min(0.005 * size * scale.stroke_um, _FASTEST_DRIFT_UM_S * first)
    return {
        "change_um": _sign(rng) * change, "share": rng.uniform(0.2, 0.6),
        "first_s": first, "second_s": second,
    }  # fmt: skip


def _drift_to_limit(x: Array, at: Grid, n: Numbers) -> Array:
    gone = n["share"] * np.expm1(-at.t_s / n["first_s"])
    gone += (1.0 - n["share"]) * np.expm1(-at.t_s / n["second_s"])
    return np.asarray(x - n["change_um"] * gone)


def _offset_walk(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    largest = _FASTEST_DRIFT_UM_S * scale.total_s / _WALK_SLOPE
    return _walk(rng, scale.total_s, min(0.003 * size * scale.stroke_um, largest))


def _wandering(x: Array, at: Grid, n: Numbers) -> Array:
    return np.asarray(x + _walked(at.t_s, n))


def _late(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    step = scale.slowest_ts_s if scale.is_held else scale.ts_s
    if step > _LONGEST_DELAY_S:
        raise UnfitError("a delay is too short for these samples")
    wanted = 0.4 * size * step if scale.is_held else 0.1 * size * scale.turn_s
    samples = round(step / scale.ts_s) * max(1, round(min(wanted, _LONGEST_DELAY_S) / step))
    return {"delay_s": samples * scale.ts_s, "samples": samples}


def _delayed(x: Array, at: Grid, n: Numbers) -> Array:
    points = round(n["delay_s"] / at.step_s)
    return np.concatenate([np.full(points, x[0]), x[: x.size - points]]) if points else x


def _hum(scale: Scale, rng: np.random.Generator, size: float) -> dict[str, Any]:
    if 1.0 / scale.slowest_ts_s < 250.0:
        raise UnfitError("the mains is not sampled")
    return {
        "amplitude_um": 0.0015 * size * scale.stroke_um,
        "frequency_hz": float(rng.choice([50.0, 60.0])) + rng.uniform(-0.03, 0.03),
        "shares": [1.0, *rng.uniform(0.0, 0.5, 4).tolist()],
        "phases_rad": rng.uniform(-math.pi, math.pi, 5).tolist(),
    }


def _humming(x: Array, at: Grid, n: Numbers) -> Array:
    y = x.copy()
    for k, (share, phase) in enumerate(zip(n["shares"], n["phases_rad"], strict=True), start=1):
        turn = 2.0 * math.pi * k * n["frequency_hz"] * at.t_s + phase
        y += n["amplitude_um"] * share * np.sin(turn)
    return y


FORMS: Sequence[Form] = (
    Form("saturation", "unlike hard rails", 10, _rails, _clip),
    Form("saturation", "one hard rail", 10, _one_rail, _clip),
    Form("saturation", "error function, unlike sides", 10, _soft, _bounded),
    Form("slew_limit", "unlike up and down", 20, _slew, _limit_rate),
    Form("slew_limit", "soft current limit", 20, _soft_slew, _charge),
    Form("actuator_lag", "second order", 30, _two_poles, _second_order),
    Form("actuator_lag", "Bessel filter", 30, _bessel, _through_bessel),
    Form("rate_law", "table", CORE, _table),
    Form("rate_law", "arcsinh", CORE, _arcsinh),
    Form("initial_memory", "decaying history", CORE, _past),
    Form("congruency", "odd in the bias", CORE, _odd),
    Form("congruency", "Gaussian about a bias", CORE, _bell),
    Form("asymmetry", "two envelopes", CORE, _two_envelopes),
    Form("asymmetry", "cubic", 50, _cubic, _polynomial),
    Form("asymmetry", "exponential", 50, _bend, _exponential),
    Form("creep", "two Kelvin-Voigt elements", 60, _elements(2), _kelvin_voigt),
    Form("creep", "three Kelvin-Voigt elements", 60, _elements(3), _kelvin_voigt),
    Form("creep", "truncated logarithm", 60, _truncated, _kelvin_voigt),
    Form("creep", "power law", 60, _power, _kelvin_voigt),
    Form("resonance", "two modes", 70, _two_modes, _vibrate),
    Form("resonance", "two modes and a zero", 70, _with_zero, _vibrate),
    Form("backlash", "gap", 80, _width, _gap),
    Form("backlash", "compliant gap", 80, _compliant_width, _compliant_gap),
    Form("gain_drift", "to a limit", 90, _gain_limit, _gain_to_limit),
    Form("gain_drift", "slow walk", 90, _gain_walk, _wandering_gain),
    Form("thermal_drift", "two time constants", 100, _drift_limit, _drift_to_limit),
    Form("thermal_drift", "slow walk", 100, _offset_walk, _wandering),
    Form("delay", "whole samples", 110, _late, _delayed),
    Form("sensor_lag", "second order", 120, _two_poles, _second_order),
    Form("sensor_lag", "Bessel filter", 120, _bessel, _through_bessel),
    Form("mains_hum", "harmonics", 130, _hum, _humming),
)
"""Every form that may be hidden."""

EFFECTS: tuple[str, ...] = tuple(dict.fromkeys(form.effect for form in FORMS))
"""Names of the effects, in the chain's order."""


def draw_form(effect: str, rng: np.random.Generator) -> Form:
    """Draw one of the forms of an effect."""
    forms = [form for form in FORMS if form.effect == effect]
    return forms[int(rng.integers(len(forms)))]


def mechanism(form: Form, scale: Scale, seed: int, size: float) -> Mechanism:
    """Return a form of some size: the same seed gives the same effect, larger or smaller."""
    return Mechanism(form, form.draw(scale, np.random.default_rng(seed), size))
