"""Entries of a task's table: what a controller may know, and those beside the ranking that know more."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from baselines import HORIZON_BOUND, Controller, TrueHorizon, make_controller
from benchmarks.stages.information import FullInformation
from rdpi_gym.envs.tasks import Lanes, StageTask
from rdpi_gym.plant import PlantModel

NEUTRAL = "stage"
"""Name of every belief that a controller is given."""
RIGHT_KIND = "right-kind-nominal"
"""``adaptive-dual-loop`` whose belief is the nominal plant itself where others believe another kind."""
INFORMATION = "full-information"
"""The information bound: :class:`~benchmarks.stages.information.FullInformation`."""


def told(belief: PlantModel[Any]) -> PlantModel[Any]:
    """Return what a controller is told of a belief: its numbers, no name and no origin."""
    return replace(belief, name=NEUTRAL, note="", identification={})


@dataclass(frozen=True)
class Beside:
    """An entry that knows more than a controller may: it is listed without a rank.

    Parameters
    ----------
    label
        What stands in place of its rank.
    make
        Makes it for lanes.
    enters
        Whether it is scored on a task beside controllers that are asked for.
    """

    label: str
    make: Callable[[Lanes], Controller]
    enters: Callable[[StageTask], bool]


def _right_kind(lanes: Lanes) -> Controller:
    nominal = lanes.task.nominal(lanes.draws[0].number)
    return make_controller("adaptive-dual-loop", told(nominal), lanes.layout())


BESIDE: Mapping[str, Beside] = {
    HORIZON_BOUND: Beside(
        "bound", lambda lanes: TrueHorizon(lanes.plant(), lanes.layout()), lambda task: True
    ),
    INFORMATION: Beside(
        "information bound",
        lambda lanes: FullInformation(lanes.task, lanes.layout()),
        lambda task: False,  # it takes minutes: it is scored where it is asked for
    ),
    RIGHT_KIND: Beside("told the kind", _right_kind, lambda task: bool(task.beliefs)),
}
"""Entries beside the ranking by name, the bound first."""
