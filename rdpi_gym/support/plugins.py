"""A user's own code by name: ``module:attribute``, imported from where the command is run."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from rdpi_gym.support.errors import InputError


def load_attribute(name: str, wanted: str) -> Any:
    """Import ``module:attribute``.

    Parameters
    ----------
    name
        For example ``my_controllers:Repetitive``; the current folder is searched too.
    wanted
        What it should be, for the error message.

    Raises
    ------
    InputError
        The name has no colon, the module cannot be imported, or it lacks the attribute.

    Examples
    --------
    >>> load_attribute("math:pi", "number")
    3.141592653589793
    """
    module_name, colon, attribute = name.partition(":")
    if not (colon and module_name and attribute):
        raise InputError(f"{name!r} names no {wanted}; write module:attribute")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    try:
        module = import_module(module_name)
    except ImportError as error:
        raise InputError(
            f"module {module_name!r} of {name!r} cannot be imported ({error})"
        ) from error
    try:
        return getattr(module, attribute)
    except AttributeError:
        raise InputError(
            f"module {module_name!r} has no {attribute!r}; after the colon of {name!r} stands the name of the {wanted}"
        ) from None
