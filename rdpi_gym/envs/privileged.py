"""Latent parameters of a plant, for a critic that may know what its controller may not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array


class Latent(NamedTuple):
    """One latent parameter: its name and its unit (``1`` of a pure number)."""

    name: str
    unit: str


def latents_of(nominals: Sequence[PlantModel]) -> tuple[Latent, ...]:
    """Return the latent parameters of plants about nominal ones, in the order of :func:`latent_values`.

    Gains, thresholds and shape of the core, then the parameters of each effect. Of several nominal
    plants the number of the plant's comes first, then those of each, zero of all but its own.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> latents_of([named_plant("P5")])[-2:]
    (Latent(name='thresholds_V[4]', unit='V'), Latent(name='delta2_s', unit='s'))
    """
    if len(nominals) == 1:
        return tuple(_own(nominals[0], ""))
    kind = Latent("nominal plant", "1")
    parts = (_own(model, f"{model.name}: ") for model in nominals)
    return kind, *(each for part in parts for each in part)


def latent_values(model: PlantModel) -> list[float]:
    """Return the values of a plant's latent parameters."""
    return [
        *core_values(model.hysteresis),
        *(value for effect in model.effects for value in effect.values.values()),
    ]


def core_values(core: Core) -> list[float]:
    """Return gains, thresholds and shape of a core."""
    thresholds = np.cumsum(core.gaps_V).tolist()
    return [*core.gains, *thresholds, *(getattr(core, p.name) for p in core.shape)]


def in_place(values: Array, kind: int, nominals: Sequence[PlantModel]) -> Array:
    """Return values ``(..., K)`` of a kind's plants among the latent parameters of all kinds."""
    if len(nominals) == 1:
        return values
    sizes = [len(latent_values(model)) for model in nominals]
    found = np.zeros((*values.shape[:-1], 1 + sum(sizes)))
    begin = 1 + sum(sizes[:kind])
    found[..., 0], found[..., begin : begin + sizes[kind]] = kind, values
    return found


def _own(model: PlantModel, before: str) -> list[Latent]:
    core = model.hysteresis
    found = []
    for name in core.linear:
        value = getattr(core, name)
        unit = "µm" if name.endswith("_um") else "µm/V"
        listed = range(len(value)) if isinstance(value, tuple) else (None,)
        found += [Latent(name if i is None else f"{name}[{i}]", unit) for i in listed]
    found += [Latent(f"thresholds_V[{i}]", "V") for i in range(len(core.gaps_V))]
    found += [Latent(p.name, p.unit) for p in core.shape]
    found += [Latent(f"{e.name} {p.name}", p.unit) for e in model.effects for p in e.parameters]
    return [Latent(before + each.name, each.unit) for each in found]
