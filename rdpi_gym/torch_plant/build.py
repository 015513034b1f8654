"""What a plant on a device is built of: whether its parts run there, and what they need."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.plant import CORES, RDPI, PlantModel
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.plant.effects.base import Effect, Slot
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.torch_plant.stages import TWINS, Twin, has_twin


def check_core(model: PlantModel) -> None:
    """Refuse a plant whose core runs on another kernel than that of the plays."""
    if type(model.hysteresis).block is given_rate_block:
        return
    known = " or ".join(n for n, kind in CORES.items() if kind.block is given_rate_block)
    raise InputError(
        f"plant {model.name} has the core {model.hysteresis.name}, and in torch there are plays, the core "
        f"{known}; run it by rdpi_gym.plant.Plant"
    )


def memory_rows(effects: Sequence[Effect], hysteresis: Sequence[RDPI], ts_s: float) -> int:
    """Rows of the state of one effect, at its size in each lane."""
    pairs = zip(effects, hysteresis, strict=True)
    return max(effect.state_rows_with(ts_s, core) for effect, core in pairs)


def stage_of(
    effects: Sequence[Effect], hysteresis: Sequence[RDPI], ts_s: float
) -> tuple[Slot, Twin, Array]:
    """Slot, twin and parameters ``float64[P, B]`` of one effect, at its size in each lane."""
    kind = type(effects[0])
    if not has_twin(kind):
        raise InputError(
            f"effect {kind.full_name()} cannot be run in torch; run it with rdpi_gym.plant.Plant"
        )
    pairs = zip(effects, hysteresis, strict=True)
    columns = np.array([effect.coefficients(ts_s, model) for effect, model in pairs])
    return kind.slot, TWINS[kind.block], np.ascontiguousarray(columns.T)
