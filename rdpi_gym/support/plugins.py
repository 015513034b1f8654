"""Code by name: a user's own, that of installed packages, and what a room above provides."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


def load_attribute(name: str, wanted: str) -> Any:
    """Import ``module:attribute``."""
    module_name, colon, attribute = name.partition(":")
    if not (colon and module_name and attribute):
        raise InputError(f"{quoted(name)} names no {wanted}; write module:attribute")
    try:
        _find_here(module_name)
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


def _find_here(module_name: str) -> None:
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
