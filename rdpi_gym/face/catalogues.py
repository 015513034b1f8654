"""`plants`, `effects`, `controllers`: what there is, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, runtime_checkable

from rdpi_gym.measurement import stated_quantities
from rdpi_gym.plant import PLANTS, RDPI, PlantModel, find_plant, named_plant
from rdpi_gym.plant.effects import CATALOGUE, Effect, description, load_effect
from rdpi_gym.support.checks import unknown_name
from rdpi_gym.support.files import write_atomic, write_json

if TYPE_CHECKING:
    import pandas as pd

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
    """Return the plant that is meant: itself, that of a result, of a file, or by name."""
    if isinstance(model, PlantModel):
        return model
    return model.plant if isinstance(model, HasPlant) else find_plant(str(model))


class Catalogue(Mapping[str, T], Generic[T]):
    """Things by name, each with a line that says what it is; nothing is made before it is asked for."""

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


class Effects(Catalogue[type[Effect]]):
    """The classes of physical effects by name, with what each declares."""

    def __init__(self) -> None:
        super().__init__("effect", lambda: CATALOGUE, CATALOGUE.__getitem__, _effect_line)

    def table(self) -> pd.DataFrame:
        """Return one row an effect: equation and trace in a residual, parameters."""
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "effect": kind.name,
                    "equation, and what it leaves in a residual": f"{kind.equation}\n{kind.signature}",
                    "parameters, typical values": "\n".join(
                        f"{p.name}: {description.typical(p)}" for p in kind.parameters
                    ),
                }
                for kind in CATALOGUE.values()
            ]
        )

    def parameters(self, name: str) -> pd.DataFrame:
        """Return one row a parameter of an effect: meaning, default, typical range, bounds.

        Raises
        ------
        InputError
            No effect has that name; ``module:Class`` is one of your own.
        """
        import pandas as pd

        kind = load_effect(name)
        return pd.DataFrame(
            [
                {
                    "parameter": p.name,
                    "meaning": p.meaning,
                    "default": f"{kind().values[p.name]:.6g}",
                    "typical": description.typical(p),
                    "bounds": "chosen, not fitted" if p.fixed else f"{p.low:.6g} to {p.high:.6g}",
                }
                for p in kind.parameters
            ]
        )

    def describe(self, name: str) -> list[str]:
        """Describe an effect in paragraphs: its cause, its signature, its remedy.

        Raises
        ------
        InputError
            No effect has that name; ``module:Class`` is one of your own.

        Examples
        --------
        >>> import rdpi_gym as rg
        >>> rg.effects.describe("backlash")[0].splitlines()[0]
        'backlash: Play operator on the displacement, in the middle of its gap at the first sample.'
        """
        kind = load_effect(name)
        first = f"{kind.name}: {description.summary(kind)}"
        forms = description.further_forms(kind)
        return [
            f"{first}\nIt acts {description.PLACES[kind.slot]}.\n\n    {kind.equation}",
            *(["\n- ".join(["Further forms:", *forms])] if forms else []),
            *(f"{heading}: {text}" for heading, text in description.paragraphs(kind).items()),
        ]

    def write(self, folder: PathLike[str] | str, *names: str) -> list[Path]:
        """Write what effects declare as ``effects.json`` and ``effects.md``.

        Parameters
        ----------
        folder
            Where to.
        *names
            Of the effects; by default all.

        Returns
        -------
        list of Path
            The two files.

        Raises
        ------
        InputError
            No effect has one of the names, or the folder cannot be written.
        """
        kinds = [load_effect(name) for name in names] or list(CATALOGUE.values())
        document = {
            "format": "rdpi-effects",
            "version": 1,
            "effects": [description.describe(kind) for kind in kinds],
        }
        return [
            write_json(Path(folder) / "effects.json", document),
            write_atomic(Path(folder) / "effects.md", description.pages(kinds)),
        ]


def _plant_line(name: str) -> str:
    plant = named_plant(name)
    low, high = plant.command_range_V
    core = plant.hysteresis
    what = f"{core.n} play operators" if isinstance(core, RDPI) else core.title
    size = f"{what}, {low:.4g} to {high:.4g} {stated_quantities(plant.identification).input.unit}"
    return f"{size}; {plant.note}" if plant.note else size


def _effect_line(name: str) -> str:
    return description.summary(CATALOGUE[name])


def _factory(name: str) -> ControllerFactory:
    from baselines import CONTROLLERS

    return CONTROLLERS[name]


def _factories() -> Mapping[str, Any]:
    from baselines import CONTROLLERS

    return CONTROLLERS


plants: Catalogue[PlantModel] = Catalogue("plant", lambda: PLANTS, named_plant, _plant_line)
"""The plants that ship, by name: ``rg.plants["P10"]``."""
effects = Effects()
"""The classes of physical effects, by name: ``rg.effects["creep"]``."""
controllers: Catalogue[ControllerFactory] = Catalogue(
    "controller", _factories, _factory, lambda name: ""
)
"""What makes the controllers that ship, by name; see :func:`rdpi_gym.make_controller`."""
