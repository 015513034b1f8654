"""`simulate`: records as if they had been measured, from a plant that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import ClassVar, Literal

import numpy as np

from rdpi_gym import virtual_lab
from rdpi_gym.face.catalogues import HasPlant, as_plant
from rdpi_gym.face.data import Dataset
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.checks import checked, unknown_name
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress, silent
from rdpi_gym.virtual_lab import HIDEABLE, Truth


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(Dataset):
    """Simulated records, and the truth behind them; as :func:`rdpi_gym.simulate` returns them.

    A data set like a measured one; only `truth` knows what is hidden in it.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)
    >>> [effect.name for effect in data.truth.hidden]
    ['creep']
    """

    saved_as: ClassVar[str] = "simulation"

    truth: Truth = field(kw_only=True)


@checked
def simulate(
    model: PlantModel | HasPlant | PathLike[str] | str = "P10",
    hide: Sequence[str] | str | None = None,
    *,
    seed: int = 0,
    noise_um: float = 0.012,
    ts_factor: float = 1.0,
    progress: Progress | None = None,
) -> Simulation:
    """Simulate the standard protocol of experiments on a plant, as if it had been measured.

    Parameters
    ----------
    model
        A plant, a result that has one, the path of a plant file, or a name of
        :data:`rdpi_gym.plants`.
    hide
        Names of effects to hide, sized at random so that they show, or ``random``: one that is
        drawn; nothing by default, or of an empty list.
    seed
        Of every random draw.
    noise_um
        White noise of the sensor (µm rms).
    ts_factor
        Factor on the protocol's sampling times.
    progress
        Called as ``progress(stage, done, total)``.

    Returns
    -------
    Simulation
        The records; `truth` holds what is hidden.

    Raises
    ------
    InputError
        No such plant or effect, an effect that the plant has already, an argument of another type.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> len(rg.simulate("P5", seed=1, ts_factor=4.0).records)
    16
    """
    say = progress or silent
    plant = as_plant(model)
    names = _names(hide)
    if seed < 0:
        raise InputError(f"seed is {seed}; give 0 or above")
    truth = Truth(plant, (), noise_um, seed, ts_factor)
    known = [effect.name for effect in plant.effects]
    if taken := [name for name in names if name in known]:
        raise InputError(f"hide: {plant.name} has {taken[0]} already; hide another effect")
    rng = np.random.default_rng([seed, 1])
    say("drawing", 0, 0)
    if hide == "random":
        free = [name for name in HIDEABLE if name not in known]
        truth = virtual_lab.hide_one(free, truth, rng)
    else:
        truth = virtual_lab.hide(names, truth, rng)
    found = virtual_lab.simulate_dataset(truth, progress=say)
    return Simulation(found.title, found.records, found.remarks, truth=truth)


def _names(hide: Sequence[str] | Literal["random"] | str | None) -> list[str]:
    if hide is None or hide == "random":
        return []
    names = [hide] if isinstance(hide, str) else list(hide)
    for name in names:
        if name == "random":
            raise InputError("hide: random stands alone; give it without other effects")
        if name not in HIDEABLE:
            raise unknown_name("hide", name, [*HIDEABLE, "random"])
        if names.count(name) > 1:
            raise InputError(f"hide: {name} is there twice; a plant has each effect once")
    return names
