"""The portrait drawn: the best block's place, memory, parity, powers and drift, each with its error."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rdpi_gym.diagnosis.portrait.kin import Character, character
from rdpi_gym.diagnosis.portrait.learning import SAMPLES, learn
from rdpi_gym.diagnosis.portrait.portrait import Kin, Portrait, Value
from rdpi_gym.diagnosis.portrait.power_law import POWER_LAWS
from rdpi_gym.diagnosis.portrait.sentences import experiment_for, sentences_of
from rdpi_gym.diagnosis.portrait.trials import Tried, shares, try_all
from rdpi_gym.diagnosis.search.candidates import Outcome, Setting, assess
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.support.progress import Progress

# Share of the draws below which it is not said where, or what, the effect is.
SURE = 0.8
# The same of the error of the model without it, for the block to be drawn at all.
_TAKES = 0.1
# A single power describes what loses no more than this of the logarithm of the block's error.
_AS_WELL = 0.5
_NO_LAG_S = 1e-6
_FEWEST_RECORDS, _PIECES = 3, 8
_Term = tuple[float, float, float, float, tuple[str, ...]]


def draw(
    setting: Setting,
    hysteresis: Core,
    present: Sequence[Effect],
    forms: Sequence[Outcome],
    nearest: Mapping[str, Effect],
    seed: int,
    progress: Progress,
) -> Portrait | None:
    """Draw the portrait of what a model misses."""
    base = assess(setting, "", setting.fit(hysteresis, present, samples=SAMPLES))
    tried = try_all(setting, hysteresis, present, forms, progress)
    best = tried[0]
    before, after = (o.errors.validation_rmse_um for o in (base, best.outcome))
    if after > (1.0 - _TAKES) * before:
        return None
    places = shares(tried, _by(tried, lambda t: _said(t.place)), seed)
    natures = shares(tried, _by(tried, lambda t: str(bool(t.time_constants_s))), seed)
    parities = shares(tried, _by(_like(tried, best), lambda t: t.parity), seed)
    place, parity = (max(each, key=lambda name: each[name]) for each in (places, parities))
    memories = natures.get("True", 0.0)
    taus = _time_constants(setting, hysteresis, present, best)
    power, rate_power = _powers(setting, hysteresis, present, best)
    here = Character(
        place if places[place] >= SURE else None,
        None if 1.0 - SURE < memories < SURE else memories >= SURE,
        parity if parities[parity] >= SURE else None,
        None if best.time_constants_s else best.nature == "of the rate",
    )
    span_V, longest_s = setting.scale.span_V, setting.scale.longest_s
    kin = tuple(
        Kin(name, here.differs(character(effect, span_V, longest_s)))
        for name, effect in nearest.items()
    )
    drawn = Portrait(
        place=here.place,
        places=places,
        memory=here.memory,
        memories=memories,
        time_constants_s=taus,
        parity=here.parity,
        parities=parities,
        power=power,
        rate_power=rate_power,
        drift_percent=_drift(setting, best),
        before_um=before,
        after_um=after,
        form=type(best.block).form,
        nearest=kin,
        experiment="",
        sentences=(),
    )
    drawn = replace(drawn, experiment=experiment_for(drawn))
    return replace(drawn, sentences=sentences_of(drawn))


def _said(place: str) -> str:
    return "behind" if place == "beside" else place


def _by(tried: Sequence[Tried], name: Callable[[Tried], str]) -> dict[str, list[Tried]]:
    groups: dict[str, list[Tried]] = {}
    for one in tried:
        groups.setdefault(name(one), []).append(one)
    return groups


def _like(tried: Sequence[Tried], best: Tried) -> list[Tried]:
    """Blocks of the best one's place and nature; one memory beside two."""
    return [
        t
        for t in tried
        if t.place == best.place
        and (t.nature == best.nature or t.nature == "with memory")
        and bool(t.time_constants_s) == bool(best.time_constants_s)
    ]


def _time_constants(
    setting: Setting, hysteresis: Core, present: Sequence[Effect], best: Tried
) -> tuple[Value, ...]:
    """Of the best block, with the records held out as a second opinion."""
    taus = best.time_constants_s
    if not taus:
        return ()
    names = {v: n for n, v in best.block.values.items() if n.startswith("time_constant")}
    other = _exchanged(setting, hysteresis, present, best.block, best.held).fitted.values
    fit = best.outcome.fit
    assert fit is not None
    return tuple(
        _value(tau, fit.standard_errors.get(f"{Unknown.name}.{names[tau]}"), other[names[tau]])
        for tau in taus
    )


def _exchanged(
    setting: Setting,
    hysteresis: Core,
    present: Sequence[Effect],
    start: Effect,
    held: frozenset[str],
) -> Outcome:
    return learn(setting.exchanged(), hysteresis, present, [start], held)


def _value(value: float, error: float | None, other: float) -> Value:
    half = 0.5 * abs(value - other)
    return Value(value, half if error is None else max(error, half))


def _powers(
    setting: Setting, hysteresis: Core, present: Sequence[Effect], best: Tried
) -> tuple[Value | None, Value | None]:
    """Exponents of amplitude and rate of the one term that comes nearest to the best block."""
    kind = POWER_LAWS[best.place]
    tau = best.time_constants_s[0] if best.time_constants_s else _NO_LAG_S
    held_tau = () if best.time_constants_s else ("time_constant_s",)
    found: list[tuple[float, Outcome, frozenset[str]]] = []
    for signed, rate_signed, power, rate_power, kept in _terms(best):
        names = (*kept, *held_tau)
        held = frozenset(f"{Unknown.name}.{name}" for name in names)
        starts = [
            kind.within_bounds(
                weight=weight, power=power, rate_power=rate_power, time_constant_s=tau,
                signed=signed, rate_signed=rate_signed, **kind.scales(setting.scale),
            )
            for weight in (0.02, -0.02)
        ]  # fmt: skip
        outcome = learn(setting, hysteresis, present, starts, held)
        found.append((outcome.mean_square, outcome, held))
    square, outcome, held = min(found, key=lambda each: each[0])
    if math.log(square) > math.log(best.outcome.mean_square) + 2.0 * _AS_WELL:
        return None, None
    fit, law = outcome.fit, outcome.fitted
    assert fit is not None
    other = _exchanged(setting, hysteresis, present, law, held).fitted.values
    values = []
    for name in ("power", "rate_power"):
        key = f"{Unknown.name}.{name}"
        known = _value(law.values[name], fit.standard_errors.get(key), other[name])
        values.append(Value(law.values[name], 0.0) if key in held else known)
    return values[0], values[1]


def _terms(best: Tried) -> list[_Term]:
    """Signs of s and r, exponents to begin with, and those that are kept."""
    even, odd = best.drive != "odd", best.drive != "even"
    if best.nature == "static":
        evens: list[_Term] = [(0.0, 0.0, 2.0, 0.0, ("rate_power",))]
        odds: list[_Term] = [(1.0, 0.0, 2.5, 0.0, ("rate_power",))]
    elif best.nature == "of the rate":
        evens = [(0.0, 0.0, 0.0, 1.0, ("power",)), (1.0, 1.0, 1.0, 1.0, ())]
        odds = [(0.0, 1.0, 0.0, 2.0, ("power",))]
    else:
        evens = [(0.0, 0.0, 2.0, 0.0, ("rate_power",)), (0.0, 0.0, 0.0, 1.0, ("power",))]
        odds = [(1.0, 0.0, 1.0, 0.0, ("rate_power",))]
    return evens * even + odds * odd


def _drift(setting: Setting, best: Tried) -> Value | None:
    """How much stronger the block is at the end of the experiment than at its beginning (%)."""
    fit = best.outcome.fit
    assert fit is not None
    others = tuple(e for e in fit.variant.effects if e.name != Unknown.name)
    without = Variant(fit.variant.hysteresis, others)
    clocks, factors, errors = [], [], []
    for record in dict.fromkeys((*setting.train, *setting.validation)):
        counted = record.error_mask
        whole = simulate_effects([fit.variant], record)[counted, 0]
        own = whole - simulate_effects([without], record)[counted, 0]
        left = record.y_um[counted] - whole
        own, left = own - own.mean(), left - left.mean()
        if len(own) < _PIECES * _PIECES or not own.any():
            continue
        pieces = zip(np.array_split(own, _PIECES), np.array_split(left, _PIECES), strict=True)
        products = np.array([(float(a @ b), max(float(a @ a), 1e-300)) for a, b in pieces])
        stronger = products[:, 0] / products[:, 1]
        mean = float(np.average(stronger, weights=products[:, 1]))
        spread = float(np.average((stronger - mean) ** 2, weights=products[:, 1]))
        clocks.append(0.5 * float(record.t_s[0] + record.t_s[-1]))
        factors.append(mean)
        errors.append(math.sqrt(spread / (_PIECES - 1)) + 1e-4)
    length = np.ptp(clocks) if clocks else 0.0
    if len(clocks) < _FEWEST_RECORDS or length <= 0.0:
        return None
    weights = 1.0 / np.array(errors) ** 2
    t = np.array(clocks) - np.average(clocks, weights=weights)
    curvature = float(weights @ t**2)
    slope = float(weights @ (t * np.array(factors))) / curvature
    left = np.array(factors) - np.average(factors, weights=weights) - slope * t
    more = max(1.0, float(weights @ left**2) / (len(clocks) - 2))
    error = math.sqrt(more / curvature)
    return Value(100.0 * slope * float(length), 100.0 * error * float(length))
