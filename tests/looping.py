"""Loops inside one test: a law that holds for many cases is one test, and a failure names its case."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable
from typing import Any


def over(names: str, cases: Iterable[Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that runs a test for every case, as ``pytest.mark.parametrize`` does in as many tests.

    Parameters
    ----------
    names
        Arguments of the test that a case fills, separated by commas.
    cases
        One value each, or as many as there are names. Fixtures are shared by the cases.
    """
    filled, listed = [name.strip() for name in names.split(",")], list(cases)
    assert listed, f"no case of {names}"

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def run_all(**fixtures: Any) -> None:
            for case in listed:
                values = case if len(filled) > 1 else (case,)
                try:
                    test(**dict(zip(filled, values, strict=True)), **fixtures)
                except BaseException as error:
                    error.add_note(f"case {names} = {_shown(case)}")
                    raise

        signature = inspect.signature(test)
        others = [p for name, p in signature.parameters.items() if name not in filled]
        run_all.__signature__ = signature.replace(parameters=others)  # type: ignore[attr-defined]
        return run_all

    return decorate


def _shown(case: Any) -> str:
    full_name = getattr(case, "full_name", None)
    return str(full_name()) if callable(full_name) else repr(case)[:300]
