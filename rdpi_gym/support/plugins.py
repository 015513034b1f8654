"""Code by name: a user's own, that of installed packages, and what a room above provides."""

from __future__ import annotations

import ast
import inspect
import pkgutil
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeVar

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


def load_attribute(name: str, wanted: str) -> Any:
    """Import ``module:attribute``."""
    module_name, colon, attribute = name.partition(":")
    if not (colon and module_name and attribute):
        raise InputError(f"{quoted(name)} names no {wanted}; write module:attribute")
    try:
        find_here(module_name)
        module = import_module(module_name)
    except (ImportError, TypeError, ValueError) as error:  # also of ".", ".." and the like
        raise InputError(
            f"module {quoted(module_name)} of {quoted(name)} cannot be imported ({error})"
        ) from error
    try:
        return getattr(module, attribute)
    except AttributeError:
        raise InputError(
            f"module {module_name!r} has no {attribute!r}; after the colon of {name!r} stands the name of the {wanted}"
        ) from None


def find_here(module_name: str) -> None:
    """Let a module be imported from the current folder, last of all, where no other place has it."""
    top, here = module_name.partition(".")[0], str(Path.cwd())
    if top and here not in sys.path and find_spec(top) is None:
        sys.path.append(here)


def installed(group: str, name: str, wanted: str) -> Any:
    """Return what an installed package names in an entry-point group; None where none does."""
    for entry in entry_points(group=group, name=name):
        try:
            return entry.load()
        except (ImportError, AttributeError) as error:
            raise InputError(
                f"installed {wanted} {name!r} ({entry.value}) cannot be imported ({error}); repair or uninstall its package"
            ) from error
    return None


def installed_names(group: str) -> list[str]:
    """Return the names in an entry-point group; nothing is imported."""
    return sorted({entry.name for entry in entry_points(group=group)})


_PROVIDERS: dict[str, str] = {}


def provide(group: str, lookup: str) -> None:
    """Say which function finds the members of a group; it is imported when it is first asked for.

    So a lower room uses what a higher one makes without knowing of it.
    """
    _PROVIDERS[group] = lookup


def provided(group: str) -> Any:
    """Return the function that :func:`provide` named for a group."""
    if group not in _PROVIDERS:
        raise InputError(f"nothing here knows the names of {group}")
    module_name, _, function = _PROVIDERS[group].partition(":")
    return getattr(import_module(module_name), function)


def attach(package: str, stub: Path) -> tuple[list[str], Callable[[str], Any]]:
    """Return the names that a stub imports, sorted, and the ``__getattr__`` that loads them.

    ``from package import name`` names a module of the package itself; ``from module import *`` stands
    for all that ``__all__`` of the module lists.
    """
    homes: dict[str, str] = {}
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                names = import_module(node.module).__all__ if alias.name == "*" else [alias.name]
                homes.update(dict.fromkeys(names, node.module))

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home = homes[name]
        found = (
            import_module(f"{home}.{name}")
            if home == package
            else getattr(import_module(home), name)
        )
        setattr(sys.modules[package], name, found)
        return found

    return sorted(homes), load


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
