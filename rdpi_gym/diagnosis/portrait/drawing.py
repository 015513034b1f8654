"""The portrait drawn: the best block's place, memory, parity, powers and drift, each with its error."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.diagnosis.notices import statement
from rdpi_gym.diagnosis.portrait import Kin, Portrait, Value, experiment_for, sentences_of
from rdpi_gym.diagnosis.portrait.trials import SAMPLES, Tried, learn, shares, try_all
from rdpi_gym.diagnosis.search.setting import Outcome, Setting, assess_refit
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.rdpi import RDPI
from rdpi_gym.plant.effects.base import Effect, parameter
from rdpi_gym.plant.effects.unknown import (
    Before,
    Behind,
    Beside,
    Block,
    In,
    Place,
    Terms,
    Unknown,
    weight,
)
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.progress import Progress


@dataclass(frozen=True)
class PowerLaw(Block):
    """One term w |s|^a |r|^b, lagging: it tells exponents, and is no form of the block."""

    weight: float = weight(0.02, "share w")
    power: float = parameter(2.0, "1", 0.0, 8.0, (1.0, 3.0), "exponent a of |s|")
    rate_power: float = parameter(0.0, "1", 0.0, 4.0, (0.0, 2.0), "exponent b of |r|")
    time_constant_s: float = parameter(
        1.0, "s", 1e-6, 1e9, (0.1, 10.0), "time constant τ of its lag"
    )
    signed: float = parameter(
        0.0, "1", 0.0, 1.0, (0.0, 1.0), "whether it has the sign of s", fixed=True
    )
    rate_signed: float = parameter(
        0.0, "1", 0.0, 1.0, (0.0, 1.0), "whether it has the sign of r", fixed=True
    )

    name = "unknown"
    form = "power law"
    on_request = True
    equation = "τ dz/dt + z = ±w |s|^a |r|^b, r the rate of s"
    source, signature, experiment = Unknown.source, Unknown.signature, Unknown.experiment
    mistaken_for = ()

    def memories(self) -> list[tuple[float, Terms]]:
        """One."""
        return [(self.time_constant_s, self.values)]


@dataclass(frozen=True)
class _PowerBefore(Before, PowerLaw):
    pass


@dataclass(frozen=True)
class _PowerIn(In, PowerLaw):
    pass


@dataclass(frozen=True)
class _PowerBeside(Beside, PowerLaw):
    pass


@dataclass(frozen=True)
class _PowerBehind(Behind, PowerLaw):
    pass


POWER_LAWS: Mapping[Place, type[PowerLaw]] = {
    "before": _PowerBefore,
    "in": _PowerIn,
    "behind": _PowerBehind,
    "beside": _PowerBeside,
}
"""Power laws by their place."""


# What a response does while the command rests, as a share of it, is a memory from here on.
_MOVES = 0.05
# What the same wave leaves otherwise at a fifth of the rate, as a share of it, is of the rate.
_RATED, _SLOWER = 0.2, 5.0
_SAMPLES, _TURNS = 2_000, 3.0
_CORES = RDPI((1.0, 0.5), (0.2,), 1e-4), RDPI((0.7, 0.5), (0.2,), 1e-4)


@dataclass(frozen=True)
class Character:
    """Properties in which a portrait and an effect are compared."""

    place: str | None  # ``before``, ``in`` or ``behind`` the hysteresis
    memory: bool | None  # whether it goes on while the command rests
    parity: str | None  # ``even`` or ``odd``; ``both`` where it is as much of either
    rated: bool | None = None  # without a memory: whether it is another at another rate
    clocked: bool = False  # whether it goes by the clock

    def differs(self, other: Character) -> str:
        """Say in what another one differs."""
        ways = []
        if other.clocked and not self.clocked:
            ways.append(statement("kin/clocked"))
        if other.place is not None and self.place not in (None, other.place):
            ways.append(statement(f"kin/{other.place}"))
        if None not in (self.memory, other.memory) and self.memory != other.memory:
            ways.append(statement("kin/memory" if other.memory else "kin/no memory"))
        if None not in (self.rated, other.rated) and self.rated != other.rated:
            ways.append(statement("kin/rated" if other.rated else "kin/not rated"))
        if {self.parity, other.parity} == {"even", "odd"}:
            ways.append(statement(f"kin/{other.parity}"))
        return template("kin", ways=tuple(ways)) if ways else template("kin/form")


def character(effect: Effect, span_V: float, longest_s: float) -> Character:
    """Read what an effect is like off its response to a wave, to its mirror image and to a rest."""
    if effect.clocked:
        return Character("behind", None, None, clocked=True)
    phase = np.linspace(0.0, 1.0, _SAMPLES)
    moving = np.minimum(phase / 0.5, 1.0)
    wave = span_V * np.sin(2.0 * np.pi * (_TURNS + 0.2) * moving)
    ts_s = longest_s / _SAMPLES
    core = RDPI((1.0, 0.5), (0.2 * span_V,), 0.02 * ts_s)
    up, down = (_added(effect, core, side * wave, ts_s) for side in (1.0, -1.0))
    even, odd = float(np.std(up + down)), float(np.std(up - down))
    rest = up[phase > 0.52]
    moves = float(np.ptp(rest)) > _MOVES * max(float(np.ptp(up)), 1e-300)
    parity = "even" if even > 2.0 * odd else "odd" if odd > 2.0 * even else "both"
    slower = _added(effect, core, wave, _SLOWER * ts_s)
    rated = float(np.std(slower - up)) > _RATED * float(np.std(up))
    return Character(_place(effect, ts_s), moves, parity, None if moves else rated)


def _place(effect: Effect, ts_s: float) -> str:
    if effect.slot == "input":
        return "before"
    if effect.slot in ("rate", "memory"):
        return "in"
    read = [effect.coefficients(ts_s, core) for core in _CORES]
    return "in" if effect.slot == "hysteresis" and read[0] != read[1] else "behind"


def _added(effect: Effect, core: RDPI, u_V: Array, ts_s: float) -> Array:
    t = ts_s * np.arange(len(u_V), dtype=np.float64)
    record = Record("wave", t, u_V, u_V, ts_s=ts_s)
    both = [simulate_effects([Variant(core, e)], record)[:, 0] for e in ((effect,), ())]
    return both[0] - both[1]


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
    fit = fit_joint(setting.train, hysteresis, present, samples=SAMPLES)
    base = assess_refit(setting, "", fit)
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
    advice = experiment_for(drawn)
    drawn = replace(drawn, experiment=template(advice.code, **advice.values))
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
    """Time constants of the best block, with those of the held-out records for their errors."""
    taus = best.time_constants_s
    if not taus:
        return ()
    names = {v: n for n, v in best.block.values.items() if n.startswith("time_constant")}
    other = _exchanged(setting, hysteresis, present, best.block, best.held).fitted.values
    fit = best.outcome.fit
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
    """Relative change of the block's size from the beginning to the end of the experiment (%)."""
    fit = best.outcome.fit
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
