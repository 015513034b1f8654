"""Random effects of a size that suits a plant, and that can be seen there."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rdpi_gym.measurement import Record
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import CATALOGUE, SLOTS, Effect, Parameter
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab.dataset import clock, plant_displacement
from rdpi_gym.virtual_lab.independent import twins
from rdpi_gym.virtual_lab.truth import Truth
from rdpi_gym.virtual_lab.visibility import left_over

HIDEABLE: tuple[str, ...] = tuple(twins())
"""Effects that the independent formulation knows."""

VISIBLE = 3.0
"""Noise floors (rms) that an effect leaves at least, after a refit, on one record."""

_TYPICAL_SPAN = 40.0  # V and µm: the size of the plants that the typical ranges are written for
_POSITIONS = ("centre_V", "extremum_V")  # commands, and no differences of commands
_MAINS_HZ = (50.0, 60.0)
_PATIENCE, _WIDER, _ATTEMPTS = 4, 1.5, 40
_COARSE_S = 1e-4  # grid on which visibility is judged: no data are made on it


class MaskedError(InputError):
    """No draw shows an effect: noise or another effect masks it."""


def draw_effect(name: str, truth: Truth, rng: np.random.Generator, widened: float = 1.0) -> Effect:
    """Draw the parameters of an effect.

    Parameters
    ----------
    name
        One of :data:`HIDEABLE`.
    truth
        The plant: its span, its stroke and the centre of its command.
    rng
        Where from.
    widened
        Factor by which the typical ranges reach further at both ends.

    Returns
    -------
    Effect
        Each parameter from its typical range: uniform, or uniform in its logarithm where the range
        spans a factor of three or more. Typical ranges are those of a stage of 40 V and 40 µm:
        voltages and their rates are scaled with the span of the experiments, lengths and their
        rates with the stroke, times and shares stay. The sign is random where the bounds are
        symmetric. The mains has 50 or 60 Hz.

    Examples
    --------
    >>> from rdpi_gym.plant import P5
    >>> small = Truth(P5, (), noise_um=0.0, seed=0)
    >>> limits = [draw_effect("saturation", small, np.random.default_rng(k)) for k in range(20)]
    >>> all(1.5 <= e.limit_V / small.span_V <= 4.0 for e in limits)
    True
    """
    kind = CATALOGUE[name]
    values = {p.name: _draw(p, truth, rng, widened) for p in kind.parameters}
    return kind(**values)


def _draw(parameter: Parameter, truth: Truth, rng: np.random.Generator, widened: float) -> float:
    p = parameter
    if p.name == "frequency_hz":
        return float(rng.choice(_MAINS_HZ))
    size = {"V": truth.span_V, "V/s": truth.span_V, "µm": truth.stroke_um, "µm/s": truth.stroke_um}
    scale = size.get(p.unit, _TYPICAL_SPAN) / _TYPICAL_SPAN
    low, high = (scale * end for end in p.typical)
    if high > low > 0:
        low, high = low / widened, high * widened
    low, high = min(max(low, p.low), p.high), min(max(high, p.low), p.high)
    if low > 0 and high >= 3.0 * low:
        value = math.exp(rng.uniform(math.log(low), math.log(high)))
    else:
        value = rng.uniform(low, high)
    if p.low == -p.high and low > 0:
        value *= rng.choice((-1.0, 1.0))
    if p.name in _POSITIONS:
        value += truth.centre_V
    return float(min(max(value, p.low), p.high))


def hide(names: Sequence[str], truth: Truth, rng: np.random.Generator) -> Truth:
    """Draw effects until each of them can be seen, and hide them.

    An effect can be seen where it leaves :data:`VISIBLE` noise floors rms on one record at least,
    after all that a refit of the base model and of the other effects can take up of it
    (:func:`~rdpi_gym.virtual_lab.visibility.left_over`). Where a few draws in a row cannot, the
    typical ranges are widened. This is judged on a coarser grid than the data are made on.

    Parameters
    ----------
    names
        Of :data:`HIDEABLE`, each once.
    truth
        The plant, with nothing hidden yet.
    rng
        Where the draws come from.

    Returns
    -------
    Truth
        The same plant with the effects hidden.

    Raises
    ------
    MaskedError
        No draw shows each of the effects: noise hides one, or they mask each other.
    """
    if not names:
        return truth
    core: Core = truth.plant.hysteresis
    if not isinstance(core, RDPI):
        raise InputError(
            f"effects are hidden in plants of the core {RDPI.name}, and plant {truth.plant.name} has "
            f"the core {core.name}; give the plant its effects in its file, and hide nothing"
        )
    view = View(truth)
    for attempt in range(_ATTEMPTS):
        widened = _WIDER ** (attempt // _PATIENCE)
        effects = [draw_effect(name, truth, rng, widened) for name in names]
        if view.shows(effects):
            return truth.with_hidden(effects)
    raise MaskedError(
        f"{' and '.join(names)} cannot be seen on {truth.plant.name} with {truth.noise_um} µm of noise "
        f"in {_ATTEMPTS} draws; hide something else, or give less noise"
    )


def hide_one(names: Sequence[str], truth: Truth, rng: np.random.Generator) -> Truth:
    """Hide one effect, chosen at random among those that can be seen.

    Parameters
    ----------
    names, truth, rng
        As :func:`hide`.

    Raises
    ------
    MaskedError
        None can be seen.
    """
    for name in rng.permutation(list(names)):
        try:
            return hide([str(name)], truth, rng)
        except MaskedError:
            continue
    raise MaskedError(
        f"no effect can be seen on {truth.plant.name} with {truth.noise_um} µm of noise; give less noise"
    )


class View:
    """What the experiments on a plant show of effects.

    Parameters
    ----------
    truth
        The plant; what is hidden in it is not looked at.

    Attributes
    ----------
    records
        Commands and times; the displacement is a placeholder.
    """

    def __init__(self, truth: Truth) -> None:
        self._truth = truth
        experiments = truth.experiments()
        self.records = [
            Record(e.name, t, u := e.command_V(), u, ts_s=e.ts_s)
            for e, t in zip(experiments, clock(experiments), strict=True)
        ]
        self._simulated: dict[tuple[Effect, ...], list[Array]] = {}

    def shows(self, effects: Sequence[Effect]) -> bool:
        """Whether each of the effects is seen by one who knows the others."""
        return all(self._shows(e, [o for o in effects if o is not e]) for e in effects)

    def _shows(self, effect: Effect, others: Sequence[Effect]) -> bool:
        known = sorted([*self._truth.plant.effects, *others], key=_place)
        full, less = self.displacements([*known, effect]), self.displacements(known)
        differences = [a - b for a, b in zip(full, less, strict=True)]
        # without noise every difference can be seen; a billionth of the stroke is none
        least = max(VISIBLE * self._truth.noise_um, 1e-9 * self._truth.stroke_um)
        if max(float(np.std(d)) for d in differences) < least:
            return False  # too small even before a refit
        found = left_over(self._truth.plant, known, self._truth.span_V, self.records, differences)
        return max(found.values()) >= least

    def displacements(self, effects: Sequence[Effect]) -> list[Array]:
        """Displacement of each record (µm) with these effects, without noise."""
        key = tuple(sorted(effects, key=_place))
        if key not in self._simulated:
            self._simulated[key] = [
                plant_displacement(self._truth.plant, list(key), r.t_s, r.u_V, _COARSE_S)
                for r in self.records
            ]
        return self._simulated[key]


def _place(effect: Effect) -> tuple[int, int]:
    return SLOTS.index(effect.slot), effect.order
