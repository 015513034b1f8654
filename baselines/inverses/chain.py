"""The inverses of a belief's effects in a row, and how a short preview is shared among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from baselines.inverses.base import Inverse, Setting, inverse_of, without_inverse
from baselines.inverses.congruency import UNDONE
from rdpi_gym.plant import RDPI, Plant, PlantModel
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array


@dataclass(frozen=True)
class Inverses:
    """Invertible effects of a belief, in the order of inversion.

    Parameters
    ----------
    output, command
        Stages behind and before the plays, outermost first and innermost first: as the reference
        passes through them.
    congruency, rate
        Effects that are dealt with together with the plays.
    passed_over
        Effects that are not inverted, by name and form.
    short
        Names of effects that would make use of more preview.
    wanted_ahead
        Samples after the next one that all of them make use of.
    rest_V
        Voltage (V) that the plays see while the plant rests.
    """

    output: tuple[Inverse, ...]
    command: tuple[Inverse, ...]
    congruency: Effect | None
    rate: tuple[Effect, ...]
    passed_over: tuple[str, ...]
    short: tuple[str, ...]
    wanted_ahead: int
    rest_V: float

    @property
    def ahead(self) -> int:
        """Samples after the next one that the stages look at."""
        return sum(stage.ahead for stage in (*self.output, *self.command))

    @property
    def changes_nothing(self) -> bool:
        """Whether only the classical inverse remains."""
        return not (self.output or self.command or self.congruency or self.rate)


def inverses_of(
    belief: PlantModel, ts_s: float, scale_um: float, rest_V: float, shown_ahead: int
) -> Inverses:
    """Build the inverses of a belief's effects.

    Parameters
    ----------
    belief
        The plant with its effects.
    ts_s
        Sampling time (s).
    scale_um
        Unit of displacements (µm).
    rest_V
        Command (V) at which the plant rests.
    shown_ahead
        Samples of the reference that are shown after the next one.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> from rdpi_gym.plant.effects import load_effect
    >>> effects = tuple(load_effect(name)() for name in ("delay", "creep", "mains_hum"))
    >>> found = inverses_of(replace(P10, effects=effects), 5e-5, 40.0, 0.0, shown_ahead=9)
    >>> [stage.effect for stage in found.output], found.passed_over, found.ahead
    (['delay', 'creep'], ('mains_hum',), 2)
    """
    kinds = {e.name: kind for e in belief.effects if (kind := inverse_of(e)) is not None}
    wanted = {
        e.name: kinds[e.name].wanted_ahead(e, ts_s) for e in belief.effects if e.name in kinds
    }
    urgent = sorted(wanted, key=lambda name: -kinds[name].urgency)
    granted = _share({name: wanted[name] for name in urgent}, shown_ahead)
    stages: dict[str, list[Inverse]] = {"input": [], "output": []}
    for effect in reversed(belief.effects):
        if effect.name in kinds:
            rest = _rest_before(belief, effect, ts_s, rest_V)
            setting = Setting(ts_s, belief.hysteresis, scale_um, rest)
            place = "input" if effect.slot == "input" else "output"
            stage = kinds[effect.name](effect, setting, granted[effect.name])
            stages[place].append(stage)
    followed = tuple(e for e in belief.effects if e.slot == "rate" and not e.state_rows(ts_s))
    congruency = next((e for e in belief.effects if type(e).block in UNDONE), None)
    dealt_with = {*kinds, *(e.name for e in (*followed, congruency) if e is not None)}
    return Inverses(
        output=tuple(stages["output"]),
        command=tuple(stages["input"]),
        congruency=congruency,
        rate=followed,
        passed_over=tuple(
            without_inverse(e)
            for e in belief.effects
            if e.name not in dealt_with and e.slot != "memory"
        ),
        short=tuple(name for name in urgent if granted[name] < wanted[name]),
        wanted_ahead=sum(wanted.values()),
        rest_V=_rest_input([e for e in belief.effects if e.slot == "input"], ts_s, rest_V),
    )


def _share(wanted: dict[str, int], available: int) -> dict[str, int]:
    granted = {}
    for name, samples in wanted.items():  # the most urgent first
        granted[name] = min(samples, available)
        available -= granted[name]
    return granted


def _rest_before(belief: PlantModel, effect: Effect, ts_s: float, rest_V: float) -> float:
    """Input of an effect while the plant rests at a command (V)."""
    before = belief.effects[: belief.effects.index(effect)]
    if effect.slot == "input":
        return _rest_input(before, ts_s, rest_V)
    plant = Plant(replace(belief, effects=before, offset_um=0.0), ts_s)
    plant.reset(u0_V=rest_V)
    return float(plant.simulate(np.array([rest_V]))[0])


def _rest_input(effects: Sequence[Effect], ts_s: float, rest_V: float) -> float:
    for effect in effects:
        rest_V = float(effect.run([rest_V], ts_s)[0])
    return rest_V


def followed(law: Effect, rate_V_s: Array, ts_s: float) -> Array:
    """Return the rate (V/s) that sets the thresholds by a law without memory, ``float64[T, B]``."""
    column = np.array(law.coefficients(ts_s, RDPI((1.0,), (), 0.0)))
    parameters = np.repeat(column[:, None], rate_V_s.shape[1], axis=1)
    out = np.empty_like(rate_V_s)
    no_state = np.empty((0, rate_V_s.shape[1]))
    type(law).block(rate_V_s, rate_V_s, parameters, no_state, ts_s, out)
    return out


def start_stages(stages: Sequence[Inverse], y: Array) -> tuple[list[Array], Array]:
    """Return the memories of stages where an output has been held, and what leaves the last one."""
    states = []
    for stage in stages:
        state, y = stage.start(y)
        states.append(state)
    return states, y


def run_stages(
    stages: Sequence[tuple[Inverse, slice]], y: Array, state: Array, begins: bool
) -> Array:
    """Run stages one after the other."""
    for stage, rows in stages:
        y = stage.run(y, state[rows])
        if begins:
            y = y[stage.ahead :]
    return y
