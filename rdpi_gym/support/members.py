"""What the files of a package declare: a new file is found, and stands in no list."""

from __future__ import annotations

import inspect
import pkgutil
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from importlib import import_module
from types import ModuleType
from typing import Any, Generic, TypeVar

T = TypeVar("T")


def modules_of(package: str) -> list[ModuleType]:
    """Import every file of a package, folders within it left out, sorted by name."""
    found = pkgutil.iter_modules(import_module(package).__path__)
    names = sorted(m.name for m in found if not m.ispkg and not m.name.startswith("_"))
    return [import_module(f"{package}.{name}") for name in names]


def classes_of(package: str, base: type[T]) -> list[type[T]]:
    """Return the subclasses of `base` that the files of a package define, abstract ones left out."""
    return [
        kind
        for module in modules_of(package)
        for kind in sorted(vars(module).values(), key=_name)
        if inspect.isclass(kind)
        and issubclass(kind, base)
        and kind.__module__ == module.__name__
        and not inspect.isabstract(kind)
    ]


class Members(Mapping[str, type[T]], Generic[T]):
    """Classes that the files of a package define, by name; the files are read when one is asked for.

    Parameters
    ----------
    package
        Dotted name.
    base
        What the classes inherit from.
    name
        Class attribute that holds the name; a class without it is none of them.
    order
        Key by which they are sorted; by name where none is given.
    counts
        Whether a class is one of them, where a file holds others beside the one of that name.

    Examples
    --------
    >>> from rdpi_gym.signals import Signal
    >>> list(Members("rdpi_gym.signals", Signal))[:3]
    ['chirp', 'constant', 'decaying-sine']
    """

    def __init__(
        self,
        package: str,
        base: type[T],
        name: str = "name",
        order: Callable[[type[T]], Any] | None = None,
        counts: Callable[[type[T]], bool] | None = None,
    ) -> None:
        self._package, self._base, self._name, self._order = package, base, name, order
        self._counts = counts

    @cached_property
    def _found(self) -> dict[str, type[T]]:
        found = filter(self._counts or bool, classes_of(self._package, self._base))
        kinds = {getattr(kind, self._name): kind for kind in found if hasattr(kind, self._name)}
        key = self._order
        return dict(sorted(kinds.items(), key=lambda item: key(item[1]) if key else item[0]))

    def __getitem__(self, name: str) -> type[T]:
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)


def _name(value: object) -> str:
    return getattr(value, "__name__", "")
