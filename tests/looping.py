"""Loops inside one test: a law that holds for many cases is one test, and a failure names its case."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable
from typing import Any

import pytest


def over(names: str, cases: Iterable[Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that runs a test for every case, as ``pytest.mark.parametrize`` does in as many tests.

    Every case is run: several failures are raised together, one as itself. A test without a failure
    one of whose cases was skipped is skipped, with the reasons.

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
            __tracebackhide__ = _of_one  # whose own lines are in the test
            failures: list[BaseException] = []
            skips: list[Any] = []
            for case in listed:
                values = case if len(filled) > 1 else (case,)
                said = f"case {names} = {_shown(case)}"
                try:
                    test(**dict(zip(filled, values, strict=True)), **fixtures)
                except pytest.skip.Exception as skip:
                    skip.msg = f"{said}: {skip.msg}"
                    skips.append(skip)
                # what `pytest.fail` and `pytest.raises` raise is no Exception
                except (Exception, pytest.fail.Exception) as error:
                    error.add_note(said)
                    failures.append(error)
                except BaseException as error:  # an interrupt, which ends the tests
                    error.add_note(said)
                    raise
            if len(failures) == 1:
                raise failures[0]
            if failures:
                raise BaseExceptionGroup(f"{len(failures)} of {len(listed)} cases", failures)
            if skips:  # the first, which knows its place in the test
                reasons = "; ".join(str(skip.msg) for skip in skips)
                skips[0].msg = f"{len(skips)} of {len(listed)} cases: {reasons}"
                raise skips[0]

        signature = inspect.signature(test)
        others = [p for name, p in signature.parameters.items() if name not in filled]
        run_all.__signature__ = signature.replace(parameters=others)  # type: ignore[attr-defined]
        return run_all

    return decorate


def _of_one(found: pytest.ExceptionInfo[BaseException]) -> bool:
    return not isinstance(found.value, BaseExceptionGroup)


def _shown(case: Any) -> str:
    full_name = getattr(case, "full_name", None)
    return str(full_name()) if callable(full_name) else repr(case)[:300]
