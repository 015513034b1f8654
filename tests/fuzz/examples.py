"""Small values of any annotated type: an instance of every kind of result in milliseconds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.notices import Statement
from rdpi_gym.measurement.record import Record
from rdpi_gym.plant import P5, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.support.checks import unaliased
from rdpi_gym.virtual_lab.dataset import Truth

T_S = 0.02 * np.arange(40)
RECORD = Record("run", T_S, np.sin(3 * T_S), 8 * np.sin(3 * T_S - 0.1), ts_s=0.02)
TABLE = pd.DataFrame({"rmse_um": [0.1, 0.2], "seed": [1, 2], "controller": ["none", "pi"]})
TABLES = (TABLE, TABLE[["controller"]], TABLE[[]][:0])
"""Numbers and texts, texts alone, nothing."""


@cache
def _made() -> dict[Any, Any]:
    creep = CATALOGUE["creep"]()
    return {
        str: "a", int: 3, float: 0.5, bool: False, NoneType: None, Any: 0.5, object: "a", type: float,
        PlantModel: P5, Effect: creep, Record: RECORD,
        Statement: Statement("as written", {"text": "a"}),
        type(P5.hysteresis): P5.hysteresis, Truth: Truth(P5, (creep,), noise_um=0.01, seed=3),
    }  # fmt: skip


def example(hint: Any, turn: int = 0) -> Any:
    """Make a small value of an annotated type, its optional parts there, a table in turn."""
    hint = unaliased(hint)
    kind, inner = get_origin(hint), get_args(hint)  # a user's own code is not saved: empty
    if hint is pd.DataFrame:
        return TABLES[turn % len(TABLES)]
    if kind is np.ndarray:
        (number,) = get_args(inner[1]) or (None,)
        return T_S[:5].astype(number if isinstance(number, type) else float)
    if (known := kind if kind in _made() else hint) in _made():
        return _made()[known]
    if kind is Literal:
        return inner[0]
    if kind in (Union, UnionType):
        return example(next(each for each in inner if each is not NoneType), turn)
    if kind is tuple:
        if get_origin(inner[0]) is type:
            return ()
        return (example(inner[0]),) if inner[1:] == (...,) else tuple(map(example, inner))
    if isinstance(kind, type) and issubclass(kind, Mapping):
        is_code = get_origin(inner[1]) is Callable
        return {} if is_code else {example(inner[0]): example(inner[1])}
    if isinstance(hint, type) and issubclass(hint, Enum):
        return next(iter(hint))
    if is_dataclass(hint):
        return _instance(hint)
    raise TypeError(f"no example of {hint}")


def _instance(kind: Any) -> Any:
    hints = get_type_hints(kind)
    found = {}
    for each in fields(kind):
        if each.init:
            found[each.name] = example(hints[each.name], len(each.name))
    return kind(**found)
