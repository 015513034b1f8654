"""Views of records, models and residuals as numbers for the page, and cards of candidates."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rdpi_gym import face
from rdpi_gym.laboratory.session import Ranking, Step
from rdpi_gym.measurement import Quantities, Record
from rdpi_gym.plant import RDPI, Plant, PlantModel
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.parameters import Parameter
from rdpi_gym.report.traces import thin_index
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import digits, quoted

POINTS = 3000
"""Samples of a trace that the page is given, about."""
_THUMBNAIL, _SKETCH = 80, 60
_WINDOW = 10.0  # times and over a value: what a slider reaches
_TITLES = {"unknown": "learned block"}
_SYMBOLS = {"delta2_s": "δ2", "delta1_V": "δ1"}


def numbers(values: Array) -> list[float | None]:
    """Return numbers as JSON has them, short: four figures are more than a screen shows."""
    return [float(f"{v:.6g}") if math.isfinite(v) else None for v in values.tolist()]


def number(value: float | None) -> float | None:
    """Return a number, or None where it is not finite."""
    return None if value is None or not math.isfinite(value) else value


def errors_of(errors: Any) -> dict[str, Any]:
    """Return the errors of a model on records (µm rms)."""
    return {
        "train_um": number(errors.train_rmse_um),
        "validation_um": number(errors.validation_rmse_um),
        "by_record_um": {name: number(um) for name, um in errors.by_record_um.items()},
    }


def record_row(record: Record, file: str, said: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of the table of records."""
    at = thin_index(record.u_V, record.y_um, samples=_THUMBNAIL)
    return {
        "name": record.name,
        "file": file,
        "role": "quiet" if record.is_quiet else record.role,
        "rows": record.t_s.size,
        "ts_s": record.ts_s,
        "duration_s": float(record.t_s[-1] - record.t_s[0]),
        "u": [float(record.u_V.min()), float(record.u_V.max())],
        "y": list(record.y_range_um),
        "skip_s": said.get("skip_s"),
        "masked_s": said.get("mask_s", []),
        "remarks": list(record.remarks),
        "thumbnail": {"u": numbers(record.u_V[at]), "y": numbers(record.y_um[at])},
    }


def quantities_of(quantities: Quantities) -> dict[str, Any]:
    """Return name, symbol and unit of input and output."""
    return {"input": vars(quantities.input), "output": vars(quantities.output)}


def record_named(data: face.Dataset, name: str) -> Record:
    """Return a record."""
    for record in data.records:
        if record.name == name:
            return record
    names = ", ".join(r.name for r in data.records)
    raise InputError(f"there is no record {name!r}; there are {names}")


def stretch(record: Record, from_s: float | None, to_s: float | None) -> slice:
    """Return the samples of a stretch of time (s), a sample more on either side."""
    first, last = 0, record.t_s.size
    if from_s is not None:
        first = max(int(np.searchsorted(record.t_s, from_s)) - 1, 0)
    if to_s is not None:
        last = min(int(np.searchsorted(record.t_s, to_s, side="right")) + 1, last)
    first = min(first, record.t_s.size - 2)
    return slice(first, max(last, first + 2))


def trace(
    record: Record,
    model_um: Array | None,
    other_um: Array | None,
    part: slice,
    points: int = POINTS,
) -> dict[str, Any]:
    """Return a record beside its model, the lowest and the highest of every stretch kept."""
    u, y = record.u_V[part], record.y_um[part]
    model, other = (None if m is None else m[part] for m in (model_um, other_um))
    lines = [y, u] + [y - m for m in (model, other) if m is not None]
    at = thin_index(*lines, samples=points)
    return {
        "record": record.name,
        "t_s": [float(f"{t:.9g}") for t in record.t_s[part][at].tolist()],
        "u": numbers(u[at]),
        "y_um": numbers(y[at]),
        "model_um": None if model is None else numbers(model[at]),
        "residual_um": None if model is None else numbers((y - model)[at]),
        "other_um": None if other is None else numbers((y - other)[at]),
        "counted": spans_s(record, ~record.error_mask),
    }


def spans_s(record: Record, chosen: NDArray[np.bool_]) -> list[list[float]]:
    """Return the stretches of time (s), first and last, that are made of chosen samples, ``(T,)``."""
    at = np.flatnonzero(chosen)
    if not at.size:
        return []
    breaks = np.flatnonzero(np.diff(at) > 1)
    starts, ends = at[np.concatenate([[0], breaks + 1])], at[np.concatenate([breaks, [-1]])]
    return [[float(record.t_s[a]), float(record.t_s[b])] for a, b in zip(starts, ends, strict=True)]


def step_row(step: Step, say: Callable[[str], str]) -> dict[str, Any]:
    """Return a step as the page is told of it."""
    return {
        "id": step.id,
        "parent": step.parent,
        "label": step.label,
        "effect": step.made.get("effect"),
        "kind": step.made.get("kind"),
        "errors": {
            "train_um": step.train_um,
            "validation_um": step.validation_um,
            "by_record_um": dict(step.by_record_um),
        },
        "model": model_of(step.plant, step.held, say),
    }


def model_of(
    plant: PlantModel, held: Iterable[str], say: Callable[[str], str] = str
) -> dict[str, Any]:
    """Return core and effects of a model, each parameter with what a slider needs."""
    errors = plant.identification.get("standard_errors", {})
    core = plant.hysteresis
    shape = [
        _parameter(p, float(getattr(core, p.name)), errors.get(p.name), p.name in held, say)
        for p in type(core).shape
        if not p.fixed
    ]
    return {
        "core": core.name,
        "core_title": core.title,
        "core_parameters": shape,
        "plays": len(core.gains) - 1 if isinstance(core, RDPI) else len(core.gains),
        "effects": [
            {
                "name": effect.name,
                "title": title_of(effect.name),
                "form": effect.form,
                "parameters": [
                    _parameter(
                        p,
                        effect.values[p.name],
                        errors.get(f"{effect.name}.{p.name}"),
                        f"{effect.name}.{p.name}" in held,
                        say,
                    )
                    for p in effect.parameters
                ],
            }
            for effect in plant.effects
        ],
    }


def _parameter(
    p: Parameter, value: float, error: float | None, held: bool, say: Callable[[str], str]
) -> dict[str, Any]:
    log = p.low > 0
    if log:
        low, high = value / _WINDOW, value * _WINDOW
    else:
        reach = max(2.0 * abs(value), abs(p.typical[1]), 1e-12)
        low, high = value - reach, value + reach
    return {
        "name": p.name,
        "symbol": _SYMBOLS.get(p.name, p.meaning),
        "meaning": p.meaning,
        "unit": "" if p.unit == "1" else say(p.unit),
        "value": value,
        "standard_error": number(error),
        "low": max(low, p.low),
        "high": min(high, p.high),
        "log": log,
        "held": held,
        "fixed": p.fixed,
    }


def title_of(effect: str) -> str:
    """Return the name of an effect for a heading."""
    words = _TITLES.get(effect, effect.replace("_", " "))
    return words[:1].upper() + words[1:]


def cards(
    ranking: Ranking,
    base_um: float | None,
    noise_um: float | None,
    core: type[Any],
    present: set[str],
    pictures: Mapping[str, Any],
    say: Callable[[str], str] = str,
) -> list[dict[str, Any]]:
    """Return the candidates as cards, the best first."""
    said = {c["effect"]: c for c in ranking.candidates}
    chosen = set(ranking.result.get("chosen", [])) if ranking.result else set()
    found = []
    waiting = 0
    for name, kind in face.effects.items():
        if name in present or not kind.fits_in(core):
            continue
        refit = ranking.refit_of(name)
        tried = any(effect == name for effect, _ in ranking.refits)
        card: dict[str, Any] = {
            "effect": name,
            "title": title_of(name),
            "mechanism": _first_sentence(kind.cause or kind.signature),
            "signature": kind.signature,
            "picture": pictures.get(name),
            "state": "waiting",
            "form": "",
            "validation_um": None,
            "train_um": None,
            "share": None,
            "probability": None,
            "confidence": None,
            "rivals": [],
            "parameters": [],
            "remarks": [],
            "recommended": name in chosen,
            "added": False,
        }
        if refit is not None:
            card |= {
                "state": "tried",
                "form": refit["form"],
                "validation_um": refit["validation_um"],
                "train_um": refit["train_um"],
                "share": _share(base_um, refit["validation_um"], noise_um),
                "parameters": _values(kind, refit, say),
                "remarks": [f"{bound} at its bound" for bound in refit["at_bound"]],
            }
        elif tried:
            card["state"] = "failed"
        elif ranking.status == "running" and waiting < 2:
            card["state"], waiting = "refitting", waiting + 1
        if (candidate := said.get(name)) is not None:
            card |= {
                "state": "failed" if refit is None else "final",
                "confidence": candidate["confidence"],
                "rivals": list(candidate["indistinguishable"]),
                "remarks": list(candidate["remarks"]),
            }
        found.append(card)
    order = list(said)
    return sorted(
        found,
        key=lambda c: (
            order.index(c["effect"]) if c["effect"] in order else len(order),
            math.inf if c["validation_um"] is None else c["validation_um"],
        ),
    )


def _values(
    kind: type[Effect], refit: Mapping[str, Any], say: Callable[[str], str]
) -> list[dict[str, str]]:
    form = next((f for f in (kind, *kind.forms) if f.form == refit["form"]), kind)
    return [
        {
            "name": p.name,
            "symbol": p.meaning,
            "value_text": f"{digits(refit['parameters'][p.name], 3)} {say(p.unit)}".removesuffix(
                " 1"
            ),
        }
        for p in form.parameters
        if p.name in refit["parameters"]
    ]


def _share(base_um: float | None, with_um: float | None, noise_um: float | None) -> float | None:
    """Return the share of the squared error above the noise that a candidate removes."""
    if base_um is None or with_um is None:
        return None
    excess = base_um**2 - (noise_um or 0.0) ** 2
    return None if excess <= 0 else (base_um**2 - with_um**2) / excess


def _first_sentence(text: str) -> str:
    # "Eq. 8" ends none
    return f"{re.split(r'(?<!Eq)[.] ', text)[0].rstrip('.')}."


def pictures() -> dict[str, dict[str, Any]]:
    """Sketch what each effect does to a displacement, by name: the work of about a second."""
    ts_s = 1e-3
    t_s = np.arange(800, dtype=np.float64) * ts_s
    u_V = np.where(
        t_s < 0.4, 10.0 * np.sin(2.0 * np.pi * 5.0 * t_s), np.where(t_s < 0.5, 0.0, 10.0)
    )
    bare = replace(face.plants["P5"], effects=())
    without = Plant(bare, ts_s).simulate(u_V)
    found = {}
    for name, kind in face.effects.items():
        picture = kind.picture
        effect = kind(**(picture.values if picture is not None else {}))
        gone = Plant(replace(bare, effects=(effect,)), ts_s).simulate(u_V) - without
        over_command = (  # what changes with time or rate is seen over time
            picture is not None
            and picture.right.kind == "left_over_command"
            and not (kind.clocked or kind.slot == "rate")
        )
        at = np.arange(200, 401, 4) if over_command else thin_index(gone, samples=_SKETCH)
        x = u_V if over_command else t_s
        kept = {"x": numbers(x[at]), "y": numbers(gone[at])}
        found[name] = {"kind": "command" if over_command else "time", **kept}
    return found


Mask = NDArray[np.bool_]
_LOOP, _STRETCH = 1500, 1000
_BINS, _FEWEST = 30, 8
_SEGMENT = 4096
_AT_REST = 1e-6  # of the widest swing, from sample to sample
_SHORTEST_REST = 10  # samples
_MOST_SPANS = 400  # more are no stretches that an eye tells apart


def residual_views(record: Record, model_um: Array, noise_um: float | None) -> dict[str, Any]:
    """Return what a model leaves of a record over time, command, rate, frequency, time at rest."""
    counted = record.error_mask
    residual = record.y_um - model_um
    at = thin_index(record.y_um, model_um, samples=_LOOP)
    whole = thin_index(residual, samples=_LOOP)
    return {
        "record": record.name,
        "time": {"t_s": numbers(record.t_s[whole]), "residual_um": numbers(residual[whole])},
        "command": _profile("u", record.u_V[counted], residual[counted]),
        "rate": _profile("rate", _rate_V_s(record)[counted], residual[counted]),
        "frequency": _spectrum(record, residual, counted),
        "rest": _at_rest(record, residual, counted),
        "loop": {
            "u": numbers(record.u_V[at]),
            "y_um": numbers(record.y_um[at]),
            "model_um": numbers(model_um[at]),
        },
        "noise_um": noise_um,
    }


def brushed(
    record: Record, model_um: Array, by: str, low: float | None, high: float | None
) -> dict[str, Any]:
    """Return the samples of a stretch in every view, so that it is seen in all."""
    if by not in _OVER:
        raise InputError(f"by is {quoted(by)}; give one of {', '.join(_OVER)}")
    over = _OVER[by](record)
    above = -math.inf if low is None else low
    chosen = (over >= above) & (over <= (math.inf if high is None else high))
    residual, rate = record.y_um - model_um, _rate_V_s(record)
    at = np.flatnonzero(chosen)
    if at.size:
        at = at[thin_index(record.y_um[at], residual[at], samples=_STRETCH)]
    left = numbers(residual[at])
    counted = chosen & record.error_mask
    spans = spans_s(record, chosen)
    whole = (
        counted if len(spans) == 1 else np.zeros_like(counted)
    )  # cuts have a spectrum of their own
    return {
        "record": record.name,
        "spans_s": spans[:_MOST_SPANS],
        "rms_um": float(np.sqrt(np.mean(residual[counted] ** 2))) if counted.any() else None,
        "time": {"t_s": numbers(record.t_s[at]), "residual_um": left},
        "command": {"u": numbers(record.u_V[at]), "residual_um": left},
        "rate": {"rate": numbers(rate[at]), "residual_um": left},
        "frequency": _spectrum(record, residual, whole),
        "rest": _at_rest(record, residual, counted),
        "loop": _pieces(record, at, chosen),
    }


def _pieces(record: Record, at: NDArray[np.intp], chosen: Mask) -> dict[str, Any]:
    """Return samples of the loop; None lifts the pen where one stretch ends."""
    piece = np.cumsum(np.diff(chosen.astype(np.int8), prepend=0) > 0)[at]
    gaps = np.flatnonzero(np.diff(piece)) + 1
    lifted = np.insert(np.stack([record.u_V[at], record.y_um[at]]), gaps, np.nan, axis=1)
    return {"u": numbers(lifted[0]), "y_um": numbers(lifted[1])}


def _rate_V_s(record: Record) -> Array:
    return np.gradient(record.u_V, record.ts_s)


def _rests(record: Record) -> Iterator[tuple[int, int, float]]:
    """Yield first and last sample of each rest of the command, and the sign of the move before it."""
    step = np.abs(np.diff(record.u_V, prepend=record.u_V[0]))
    still = step <= _AT_REST * max(float(np.ptp(record.u_V)), 1e-300)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    for first, last in edges.reshape(-1, 2).tolist():
        if first > 0 and last - first >= _SHORTEST_REST:
            yield first, last, float(np.sign(record.u_V[first] - record.u_V[max(first - 5, 0)]))


def _rested_s(record: Record) -> Array:
    """Return for every sample since when the command rests (s); NaN where it does not."""
    rested = np.full(record.t_s.size, np.nan)
    for first, last, _ in _rests(record):
        rested[first:last] = (np.arange(last - first) + 1) * record.ts_s
    return rested


_OVER: dict[str, Callable[[Record], Array]] = {
    "time": lambda record: record.t_s,
    "command": lambda record: record.u_V,
    "rate": _rate_V_s,
    "rest": _rested_s,
}


def _profile(name: str, x: Array, residual: Array) -> dict[str, Any]:
    """Return mean, rms and the middle nine tenths of a residual along a quantity."""
    if not x.size:
        return {key: [] for key in (name, "rms_um", "mean_um", "low_um", "high_um")}
    low, high = np.percentile(x, [0.25, 99.75])
    edges = np.linspace(low, high if high > low else low + 1.0, _BINS + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _BINS - 1)
    order = np.argsort(place, kind="stable")
    parts = np.split(residual[order], np.searchsorted(place[order], np.arange(1, _BINS)))
    known = [k for k, part in enumerate(parts) if part.size >= _FEWEST]
    some = [parts[k] for k in known]
    middle = 0.5 * (edges[1:] + edges[:-1])
    return {
        name: numbers(middle[known]),
        "rms_um": [float(np.sqrt(np.mean(p**2))) for p in some],
        "mean_um": [float(np.mean(p)) for p in some],
        "low_um": [float(np.percentile(p, 5)) for p in some],
        "high_um": [float(np.percentile(p, 95)) for p in some],
    }


def _spectrum(record: Record, residual: Array, counted: Mask) -> dict[str, Any]:
    """Return the rms of a residual in tenths of a decade of frequency, by Welch's method."""
    from scipy.signal import welch

    at = np.flatnonzero(counted)
    if at.size < 2 * _SHORTEST_REST:
        return {"hz": [], "um": []}
    within = slice(at[0], at[-1] + 1)
    left = np.where(counted, residual, 0.0)[within]
    share = at.size / left.size
    hz, power = welch(left, 1.0 / record.ts_s, nperseg=min(_SEGMENT, left.size), detrend="constant")
    hz, power = hz[1:], power[1:] / share
    band = np.round(10.0 * np.log10(hz)).astype(int)
    bands = np.unique(band)
    rms = np.array([math.sqrt(power[band == b].sum() * hz[0]) for b in bands])
    return {"hz": numbers(10.0 ** (bands / 10.0)), "um": numbers(rms)}


def _at_rest(record: Record, residual: Array, counted: Mask) -> dict[str, Any]:
    """Return how a residual goes on while the command rests, in the direction of the last move."""
    times: list[Array] = []
    gone: list[Array] = []
    for first, last, move in _rests(record):
        inside = np.arange(first, last)[counted[first:last]]
        if move and inside.size:
            start_um = float(residual[first : first + 4].mean())
            times.append(record.ts_s * (inside.astype(np.float64) - (first - 1)))
            gone.append(move * (residual[inside] - start_um))
    if not times:
        return {"s": [], "um": []}
    t_s, um = np.concatenate(times), np.concatenate(gone)
    bins = np.geomspace(record.ts_s, t_s.max() * 1.001, 25)
    place = np.clip(np.searchsorted(bins, t_s, side="right") - 1, 0, 23)
    count = np.bincount(place, minlength=24)
    known = count >= _FEWEST
    mean = np.bincount(place, weights=um, minlength=24)[known] / count[known]
    return {"s": numbers(np.sqrt(bins[1:] * bins[:-1])[known]), "um": numbers(mean)}
