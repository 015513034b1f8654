"""Search space of a sweep: ranges and choices of hyper-parameters, applied to a file of these."""

from __future__ import annotations

import json
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from baselines.learned.settings import read_yaml
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted, short

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution

SPACES = Path(__file__).parent / "search_spaces"
"""One file an algorithm."""
_DIGITS = 4
Values = Mapping[str, Any]


@dataclass(frozen=True)
class Range:
    """Numbers between two, ends included."""

    low: float
    high: float
    # Whole both, or not.
    log: bool = False
    # Whether evenly in the logarithm.

    @property
    def distribution(self) -> BaseDistribution:
        """Optuna's name for it."""
        from optuna.distributions import FloatDistribution, IntDistribution

        if isinstance(self.low, int) and isinstance(self.high, int):
            return IntDistribution(self.low, self.high, log=self.log)
        return FloatDistribution(self.low, self.high, log=self.log)

    def value(self, drawn: Any) -> Any:
        """Return a number as files have it, of four digits."""
        if isinstance(drawn, int):
            return drawn
        return min(max(float(f"{drawn:.{_DIGITS}g}"), self.low), self.high)

    def nearest(self, value: Any) -> Any:
        """Return the number that is nearest a value of a file; the lowest where that is none."""
        near = min(max(value, self.low), self.high) if is_finite(value) else self.low
        return round(near) if isinstance(self.low, int) and isinstance(self.high, int) else near


@dataclass(frozen=True)
class Choice:
    """One of several values of any kind."""

    values: tuple[str, ...]
    # As JSON, which Optuna can keep.

    @property
    def distribution(self) -> BaseDistribution:
        """Optuna's name for it."""
        from optuna.distributions import CategoricalDistribution

        return CategoricalDistribution(self.values)

    def value(self, drawn: Any) -> Any:
        """Return a value as files have it."""
        return json.loads(drawn)

    def nearest(self, value: Any) -> Any:
        """Return a value of a file; the first where it is not among them."""
        text = json.dumps(value)
        return text if text in self.values else self.values[0]


@dataclass(frozen=True)
class SearchSpace:
    """Hyper-parameters by name, and what each may be.

    Examples
    --------
    >>> space = SearchSpace({"learning_rate": Range(1e-4, 1e-2, log=True), "gamma": Choice(("0.9",))})
    >>> shipped = {"learning_rate": "lin_1e-3", "gamma": 0.95}
    >>> space.beginning(shipped)
    {'learning_rate': 0.001, 'gamma': '0.9'}
    >>> space.applied({"learning_rate": 0.00123456, "gamma": "0.9"}, shipped)
    {'learning_rate': 'lin_0.001235', 'gamma': 0.9}
    """

    axes: Mapping[str, Range | Choice]
    # A name with dots leads into mappings, as ``policy_kwargs.net_arch``.

    @property
    def distributions(self) -> dict[str, BaseDistribution]:
        """As Optuna takes them."""
        return {name: axis.distribution for name, axis in self.axes.items()}

    def beginning(self, values: Values) -> dict[str, Any]:
        """Return what is tried first: the values of a file, brought into the space."""
        return {name: axis.nearest(_stated(values, name)[1]) for name, axis in self.axes.items()}

    def readable(self, drawn: Values) -> dict[str, Any]:
        """Return what Optuna drew as files have it."""
        return {name: axis.value(drawn[name]) for name, axis in self.axes.items()}

    def applied(self, drawn: Values, values: Values) -> dict[str, Any]:
        """Return hyper-parameters with what was drawn in place of what a file states.

        A word before a number, as of a schedule, ``lin_1e-3``, stays.
        """
        changed = deepcopy(dict(values))
        for name, value in self.readable(drawn).items():
            word, _ = _stated(values, name)
            place = changed
            *folders, last = name.split(".")
            for folder in folders:
                inner = place.get(folder)
                place[folder] = inner if isinstance(inner, dict) else {}
                place = place[folder]
            place[last] = f"{word}_{value}" if word else value
        return changed


def read_space(path: Path) -> SearchSpace:
    """Read a search space: a mapping of names to a list of values or to ``{low, high, log}``."""
    document = read_yaml(path)
    if not isinstance(document, dict) or not document:
        raise InputError(f"{path} is no search space; give names with a list, or with low and high")
    return SearchSpace({str(name): _axis(path, name, given) for name, given in document.items()})


def _axis(path: Path, name: Any, given: Any) -> Range | Choice:
    if isinstance(given, list) and given:
        return Choice(tuple(dict.fromkeys(json.dumps(value) for value in given)))
    if isinstance(given, dict) and {"low", "high"} <= set(given) <= {"low", "high", "log"}:
        low, high, log = given["low"], given["high"], given.get("log", False)
        numbers = all(is_finite(each) and not isinstance(each, bool) for each in (low, high))
        if numbers and isinstance(log, bool) and low < high and (low > 0 or not log):
            return Range(low, high, log)
    raise InputError(
        f"{path}: {short(str(name))} is {quoted(given)}; give a list of values, or low below high, "
        "above 0 with log: true"
    )


def _stated(values: Values, name: str) -> tuple[str, Any]:
    """Return the word before a value of a file, and the value: ``lin``, 0.001; None: not stated."""
    found: Any = values
    for part in name.split("."):
        found = found.get(part) if isinstance(found, Mapping) else None
    if isinstance(found, str):
        word, _, number = found.partition("_")
        try:
            return word, float(number)
        except ValueError:
            return "", found
    return "", found
