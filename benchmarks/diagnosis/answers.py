"""Answer of a diagnoser to a data set, and its checks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import unknown_name
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


@dataclass(frozen=True)
class Answer:
    """Answer of a diagnoser for one data set.

    Parameters
    ----------
    effects
        Probability (0 to 1) that an effect of the catalogue is there, by name; 0 where none is given.
        They are no shares of a whole.
    other
        Probability that something is there that the catalogue does not have.
    predict
        Called with a record whose displacement is withheld (zeros): returns the displacement (µm),
        (T,). An offset is free. `Record.before_V` has the command before the record, if any.

    Examples
    --------
    >>> import numpy as np
    >>> Answer({"creep": 0.9}, 0.05, lambda record: 0.1 * record.u_V).effects["creep"]
    0.9
    """

    effects: Mapping[str, float]
    other: float
    predict: Callable[[Record], Array]


class Diagnoser(Protocol):
    """A callable that diagnoses records."""

    def __call__(self, dataset: Dataset) -> Answer:
        """Return what is missing of the base model on a data set, all of whose records are for it."""


def checked_answer(answer: object) -> Answer:
    """Return the answer of a diagnoser, or say what is wrong with it."""
    if not isinstance(answer, Answer):
        raise InputError(
            f"a diagnoser returns benchmarks.diagnosis.answers.Answer, not {type(answer).__name__}"
        )
    for name in answer.effects:
        if name not in CATALOGUE:
            raise unknown_name("effects", str(name), list(CATALOGUE))
    for name, p in {**answer.effects, "other": answer.other}.items():
        if not (isinstance(p, float | int) and math.isfinite(p) and 0.0 <= p <= 1.0):
            raise InputError(f"the probability of {name} is {quoted(p)}; give a number from 0 to 1")
    if not callable(answer.predict):
        raise InputError("predict of the answer is no function of a record; give one")
    return answer


def checked_prediction(answer: Answer, record: Record) -> Array:
    """Return the predicted displacement (µm) of a record, or say what is wrong with it."""
    y = np.asarray(answer.predict(record), dtype=np.float64)
    if y.shape != record.u_V.shape or not np.isfinite(y).all():
        raise InputError(
            f"predict of the answer returns shape {y.shape}; give one finite number for each of "
            f"the {record.u_V.size} samples of record {record.name}"
        )
    return y
