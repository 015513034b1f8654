"""`plants`, `effects`, `controllers`: what there is, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, runtime_checkable

from rdpi_gym.measurement.options import unknown_name
from rdpi_gym.plant import PLANTS, PlantModel, find_plant, named_plant
from rdpi_gym.plant.effects import CATALOGUE, Effect

if TYPE_CHECKING:
    from baselines import ControllerFactory

T = TypeVar("T")


@runtime_checkable
class HasPlant(Protocol):
    """A result that ends in a plant: of a fit, of a search."""

    @property
    def plant(self) -> PlantModel:
        """The plant."""
        ...


def as_plant(model: PlantModel | HasPlant | PathLike[str] | str) -> PlantModel:
    """Return the plant that is meant: itself, that of a result, of a file, or by name.

    Raises
    ------
    InputError
        Neither a plant's name nor a readable plant file.

    Examples
    --------
    >>> as_plant("P5").name
    'P5'
    """
    if isinstance(model, PlantModel):
        return model
    return model.plant if isinstance(model, HasPlant) else find_plant(str(model))


class Catalogue(Mapping[str, T], Generic[T]):
    """Things by name, each with a line that says what it is; nothing is made before it is asked for.

    Parameters
    ----------
    what
        One of them in words.
    listed
        Returns the names, in order.
    made
        Returns the thing of a name.
    line
        Says in a line what a name stands for.

    Raises
    ------
    InputError
        On a name that is not there, with the close match.
    """

    def __init__(
        self,
        what: str,
        listed: Callable[[], Mapping[str, Any] | tuple[str, ...]],
        made: Callable[[str], T],
        line: Callable[[str], str],
    ) -> None:
        self._what, self._listed, self._made, self._line = what, listed, made, line

    def __getitem__(self, name: str) -> T:
        if name not in self:
            raise unknown_name(self._what, name, self)
        return self._made(name)

    def __contains__(self, name: object) -> bool:
        return name in self._listed()

    def __iter__(self) -> Iterator[str]:
        return iter(self._listed())

    def __len__(self) -> int:
        return len(self._listed())

    def __repr__(self) -> str:
        width = max(map(len, self))
        return "\n".join(f"{name:{width}}  {self._line(name)}".rstrip() for name in self)


def _plant_line(name: str) -> str:
    plant = named_plant(name)
    low, high = plant.command_range_V
    size = f"{plant.hysteresis.n} play operators, {low:g} to {high:g} V"
    return f"{size}; {plant.note}" if plant.note else size


def _effect_line(name: str) -> str:
    from rdpi_gym.plant.effects.description import summary

    return summary(CATALOGUE[name])


def _factory(name: str) -> ControllerFactory:
    from baselines import CONTROLLERS

    return CONTROLLERS[name]


def _factories() -> Mapping[str, Any]:
    from baselines import CONTROLLERS

    return CONTROLLERS


plants: Catalogue[PlantModel] = Catalogue("plant", lambda: PLANTS, named_plant, _plant_line)
"""The plants that ship, by name: ``rg.plants["P10"]``."""
effects: Catalogue[type[Effect]] = Catalogue(
    "effect", lambda: CATALOGUE, CATALOGUE.__getitem__, _effect_line
)
"""The classes of physical effects, by name: ``rg.effects["creep"]``."""
controllers: Catalogue[ControllerFactory] = Catalogue(
    "controller", _factories, _factory, lambda name: ""
)
"""What makes the controllers that ship, by name; see :func:`rdpi_gym.make_controller`."""
