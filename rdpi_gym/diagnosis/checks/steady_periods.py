"""Half-wave symmetry of steady periods: plays are odd, so what is even is asymmetry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, cannot_tell, zone_of
from rdpi_gym.diagnosis.features.cycles import Complexes, Periods, harmonics, orders_off_mains
from rdpi_gym.diagnosis.notices import statement
from rdpi_gym.support.arrays import Array

EVEN_PERCENT = 0.15
"""Even part over the rest (rms): a quadratic distortion of 1 % of the stroke leaves 0.5 %."""
_LARGE = 0.5  # of the largest swing: records that count
_MOST_ORDERS = 400


def half_wave(stretches: Sequence[Periods]) -> Check:
    """Even harmonics of the displacement under commands that have none.

    A play operator is odd and congruent: a command whose second half period is the negative of
    its first gives a displacement of the same symmetry, whatever thresholds and weights are.
    """
    found = []
    for periods in stretches:
        share = _even_share(periods, periods.record.u_V)
        if share is not None and share[0] + share[1] < EVEN_PERCENT:
            even = _even_share(periods, periods.record.y_um)
            if even is not None:
                swing = float(np.ptp(periods.record.u_V[periods.part]))
                found.append((swing, *even, periods))
    if not found:
        return cannot_tell("asymmetry", "asymmetry/none", "slow sine")
    widest = max(swing for swing, *_ in found)
    large = [entry for entry in found if entry[0] > _LARGE * widest]
    # a record whose second harmonic is free of the mains goes before one where it is not
    _, value, error, periods = max(large, key=lambda e: (_second_is_clear(e[3]), e[0], -e[2]))
    zone = zone_of(value, error, EVEN_PERCENT)
    text = statement(f"asymmetry/{zone}", record=periods.record.name, percent=value)
    advice = None if zone != "cannot tell" else statement("slow sine")
    return Check("asymmetry", value, EVEN_PERCENT, "%", zone, text, advice, ("asymmetry",))


def _second_is_clear(periods: Periods) -> bool:
    return orders_off_mains(periods, np.array([2])).size > 0


def _even_share(periods: Periods, x: Array) -> tuple[float, float] | None:
    """Even over odd harmonics (%) and its error; None without steady motion."""
    found = harmonics(periods, x)
    last = min(found.mean.size - 1, _MOST_ORDERS)
    odd, _ = found.rms(np.arange(1, last + 1, 2))
    orders = np.arange(2, last + 1, 2)
    clear = orders_off_mains(periods, orders)
    even, error = found.rms(clear if clear.size and clear[0] == 2 else orders)
    return (100.0 * even / odd, 100.0 * error / odd) if odd > 0.0 else None


PHASE_RAD = 0.06
"""A lag counts from this phase at the highest frequency on (rad)."""
GAIN_PERCENT = 3.0
"""A change of the gain counts from this on at the highest frequency (%)."""
DISTORTION_PERCENT = 4.0
"""Displacement that is not what a linear path makes of the command (% of the rest, rms)."""
SMALL = 0.1
"""Share of the widest swing of the data up to which a record may lie below the first threshold."""
_EXCITED = 0.02  # of the strongest line
_CLEAR = 8.0  # standard errors that a line stands above its noise
_FAR = 1.2  # of ln G: the band in which the series is used
_NEAR = 0.15  # of ln G: no higher terms are needed
_KIND = 0.3  # of τ²
_BEYOND = 3  # times the highest line: where distortion is looked for
_NAMES = ("lag at small signals", "resonance at small signals", "motion at small signals")


@dataclass(frozen=True)
class SmallSignal:
    """Response to a small command; each number with its standard error."""

    lag_s: tuple[float, float]  # τ = -g1 (s)
    kappa_s2: tuple[float, float]  # κ (s²)
    # Displacement at frequencies that are not in the command, or off the series of 1 / G at those
    # that are, over the rest (1)
    distortion: tuple[float, float]
    highest_hz: float  # highest frequency used (Hz)
    ts_s: float  # sampling time (s)
    record: str  # name of the record


def small_signal(
    stretches: Sequence[Periods], span_V: float, gain_um_V: float
) -> tuple[Check, Check, Check]:
    """Lag, kind of lag, and motion of plays under small commands."""
    small = [p for p in stretches if np.ptp(p.record.u_V[p.part]) <= SMALL * span_V]
    found = [response for p in small if (response := _response(p)) is not None]
    still = [p.record.name for p in small if _still(p, gain_um_V)]
    if not found and not still:
        lag, resonance, motion = (
            cannot_tell(name, "small signals/none", "small multisine") for name in _NAMES
        )
        return lag, resonance, motion
    if not found:
        code, record = "small signals/still", still[0]
        lost = statement("motion at small signals/lost", record=record)
        motion = Check(_NAMES[2], 100.0, DISTORTION_PERCENT, "%", "yes", lost, None, ("backlash",))
    else:
        best = min(found, key=lambda r: r.lag_s[1])
        motion = _motion(best)
        if motion.zone != "yes":
            return _lag(best), _resonance(best), motion
        code, record = "small signals/nonlinear", best.record
    lag, resonance = (
        cannot_tell(name, code, "small multisine", record=record) for name in _NAMES[:2]
    )
    return lag, resonance, motion


def _motion(found: SmallSignal) -> Check:
    value, error = (100.0 * number for number in found.distortion)
    zone = zone_of(value, error, DISTORTION_PERCENT)
    text = statement(f"motion at small signals/{zone}", record=found.record, percent=value)
    advice = None if zone == "no" else statement("smaller multisine")
    effects = ("backlash", "slew_limit")
    return Check(_NAMES[2], value, DISTORTION_PERCENT, "%", zone, text, advice, effects)


def _lag(found: SmallSignal) -> Check:
    value, error = (1e6 * number for number in found.lag_s)
    threshold = 1e6 * PHASE_RAD / (2.0 * np.pi * found.highest_hz)
    zone = zone_of(value, error, threshold)
    values: dict[str, object] = {"record": found.record, "highest_hz": found.highest_hz}
    if zone == "yes" and value > 0:
        nature, effects = _kind(found)
        text = statement(f"lag at small signals/{nature}", lag_us=value, **values)
        return Check(_NAMES[0], value, threshold, "µs", zone, text, None, effects)
    kind = {"no": "none", "cannot tell": "uncertain", "yes": "leads"}[zone]
    text = statement(f"lag at small signals/{kind}", lag_us=(value, error), **values)
    if zone == "no":
        return Check(_NAMES[0], value, threshold, "µs", zone, text)
    return Check(
        _NAMES[0], value, threshold, "µs", "cannot tell", text, statement("small multisine")
    )


def _kind(
    found: SmallSignal,
) -> tuple[str, tuple[str, ...]]:
    """Return the kind of a lag, and the effects that it speaks for."""
    square = found.lag_s[0] ** 2
    kappa, error = found.kappa_s2
    # a delay by a part of a sample is the mean of two samples, which looks like a lag
    blur = 0.25 * found.ts_s**2
    if kappa > _KIND * square + 3.0 * error:
        return "resonance", ("resonance",)
    if kappa + 3.0 * error < -_KIND * square - blur:
        return "first order", ("sensor_lag", "actuator_lag")
    if kappa - 3.0 * error > -(1.0 - _KIND) * square:
        return "delay", ("delay",)
    return "open", ("delay", "sensor_lag", "actuator_lag")


def _resonance(found: SmallSignal) -> Check:
    scale = 50.0 * (2.0 * np.pi * found.highest_hz) ** 2
    value, error = (scale * number for number in found.kappa_s2)
    zone = zone_of(value, error, GAIN_PERCENT)
    values: dict[str, object] = {"record": found.record, "highest_hz": found.highest_hz}
    if zone == "yes" and value > 0:
        f0 = np.sqrt(2.0 / found.kappa_s2[0]) / (2.0 * np.pi)
        text = statement("resonance at small signals/yes", percent=value, f0_hz=f0, **values)
    elif zone == "cannot tell":
        text = statement("resonance at small signals/cannot tell", change=(value, error), **values)
    else:
        fallen = statement("resonance at small signals/falls", percent=-value, **values)
        text = fallen if zone == "yes" else statement("resonance at small signals/no", **values)
        zone = "no"
    advice = statement("small multisine") if zone == "cannot tell" else None
    return Check(_NAMES[1], value, GAIN_PERCENT, "%", zone, text, advice, ("resonance",))


def _still(periods: Periods, gain_um_V: float) -> bool:
    """Whether a sensor that sees a tenth of the expected motion sees none."""
    u = harmonics(periods, periods.record.u_V)
    y = harmonics(periods, periods.record.y_um)
    strongest = int(np.argmax(np.abs(u.mean[1:]))) + 1
    seen = max(abs(y.mean[strongest]), _CLEAR * np.sqrt(y.noise[strongest]))
    return bool(seen < 0.1 * gain_um_V * abs(u.mean[strongest]))


def _response(periods: Periods) -> SmallSignal | None:
    record = periods.record
    u, y = harmonics(periods, record.u_V), harmonics(periods, record.y_um)
    orders = np.arange(1, u.mean.size - 1)
    size_u, size_y = np.abs(u.mean), np.abs(y.mean)
    excited = orders[size_u[orders] > _EXCITED * size_u[orders].max()]
    lines = orders_off_mains(periods, excited)
    lines = lines[size_y[lines] > _CLEAR * np.sqrt(y.noise[lines])]
    if lines.size < 2:
        return None
    last = min(_BEYOND * int(excited[-1]), int(orders[-1]))
    silent = orders_off_mains(periods, np.setdiff1d(orders[:last], excited))
    inverse = u.mean[lines] / y.mean[lines]
    spread = np.sqrt(y.noise[lines]) / size_y[lines]
    omega = 2.0 * np.pi * periods.frequency_hz * lines.astype(np.float64)
    lag, kappa, misfit, highest = _series(omega, inverse / inverse[0], spread)
    strong, _ = y.rms(excited)
    other, noise = y.rms(silent)
    distortion = max((other / strong, noise / strong), misfit)
    return SmallSignal(lag, kappa, distortion, highest / (2.0 * np.pi), record.ts_s, record.name)


Pair = tuple[float, float]


def _series(omega: Array, inverse: Complexes, spread: Array) -> tuple[Pair, Pair, Pair, float]:
    """Lag, κ and misfit (relative) from 1 / G = h_0 (1 + h_1 s + h_2 s² + ...); the highest ω used."""
    log = np.log(np.abs(inverse)) + 1j * np.unwrap(np.angle(inverse))
    far = np.flatnonzero(np.abs(log - log[0]) > _FAR)
    band = slice(0, max(int(far[0]), 2) if far.size else log.size)
    log, inverse, omega, top = log[band], inverse[band], omega[band], float(omega[band][-1])
    weight = 1.0 / (np.abs(inverse) * np.maximum(spread[band], 1e-6))
    x = omega / top
    higher = np.max(np.abs(log - log[0])) > _NEAR and x.size >= 4
    even = np.column_stack([np.ones_like(x), x**2, *([x**4] if higher else [])])
    odd = np.column_stack(
        [x, *([x**3] if higher else []), *([np.ones_like(x)] if x.size > 3 else [])]
    )
    real, real_error, misfit_real = _fit(even, inverse.real, weight)
    imaginary, imaginary_error, misfit_imaginary = _fit(odd, inverse.imag, weight)
    lag, lag_error = imaginary[0] / real[0] / top, imaginary_error[0] / abs(real[0]) / top
    h2, h2_error = -real[1] / real[0] / top**2, real_error[1] / abs(real[0]) / top**2
    kappa = 2.0 * h2 - lag**2
    kappa_error = float(np.hypot(2.0 * h2_error, 2.0 * lag * lag_error))
    # of a misfit that noise would leave too, nothing is certain
    excess = max(misfit_real**2 + misfit_imaginary**2 - 2.0, 0.0)
    typical = float(np.median(spread[band]))
    misfit = (float(np.sqrt(excess)) * typical, typical)
    return (lag, lag_error), (kappa, kappa_error), misfit, top


def _fit(columns: Array, y: Array, weight: Array) -> tuple[Array, Array, float]:
    """Weighted least squares: solution, standard errors, root mean square of the weighted misfit."""
    rows = columns * weight[:, None]
    inverse = np.linalg.pinv(rows.T @ rows)
    solution = inverse @ (rows.T @ (y * weight))
    left = rows @ solution - y * weight
    freedom = len(y) - columns.shape[1]
    misfit = float(np.sqrt(left @ left / freedom)) if freedom > 0 else 1.0
    # lines that do not lie on the series make the result less certain
    return solution, np.sqrt(np.diag(inverse)) * max(1.0, misfit), misfit
