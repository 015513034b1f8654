"""The plant's chain over one block of lanes and one sample, by the stage kernels of the plant."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.plant.cores.base import CoreBlock
from rdpi_gym.plant.cores.bouc_wen_kernel import bouc_wen_block
from rdpi_gym.plant.cores.dahl import dahl_block
from rdpi_gym.plant.cores.duhem import duhem_block
from rdpi_gym.plant.cores.generalised import generalised_block
from rdpi_gym.plant.cores.lugre import lugre_block
from rdpi_gym.plant.cores.pinched_stop import pinched_block
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.plant.cores.preisach import preisach_block
from rdpi_gym.plant.effects.asymmetry import asymmetry_block
from rdpi_gym.plant.effects.backlash import backlash_block
from rdpi_gym.plant.effects.base import SLOTS, Block
from rdpi_gym.plant.effects.congruency import congruency_block
from rdpi_gym.plant.effects.creep import creep_block
from rdpi_gym.plant.effects.delay import delay_block
from rdpi_gym.plant.effects.gain_drift import gain_drift_block
from rdpi_gym.plant.effects.linear import linear_block
from rdpi_gym.plant.effects.mains_hum import mains_hum_block
from rdpi_gym.plant.effects.rate_law import rate_law_block
from rdpi_gym.plant.effects.saturation import saturation_block
from rdpi_gym.plant.effects.slew_limit import slew_limit_block
from rdpi_gym.plant.effects.thermal_drift import thermal_drift_block
from rdpi_gym.plant.effects.unknown_places import unknown_block
from rdpi_gym.support.arrays import Array

Table: TypeAlias = NDArray[np.int64]
"""One row a stage, in the chain's order: number of its kernel, slot, first row and end of its
parameters, first row and end of its state."""

KERNELS: tuple[Block, ...] = (
    linear_block, creep_block, delay_block, saturation_block, slew_limit_block, rate_law_block,
    congruency_block, asymmetry_block, backlash_block, gain_drift_block, thermal_drift_block,
    mains_hum_block, unknown_block,
)  # fmt: skip
"""The catalogue's kernels by their number. A stage with another kernel runs through Python."""

CORE_KERNELS: tuple[CoreBlock, ...] = (
    given_rate_block, generalised_block, pinched_block, preisach_block, bouc_wen_block, duhem_block,
    dahl_block, lugre_block,
)  # fmt: skip
"""The cores' kernels by their number; a core with another one runs through Python, too."""

_INPUT, _RATE = SLOTS.index("input"), SLOTS.index("rate")


@njit(inline="always")
def _run_kernel(
    number: int, x: Array, u: Array, p: Array, state: Array, ts: float, y: Array
) -> None:
    # Called by number, all kernels compile into one function that never returns to Python.
    if number == 0:
        linear_block(x, u, p, state, ts, y)
    elif number == 1:
        creep_block(x, u, p, state, ts, y)
    elif number == 2:
        delay_block(x, u, p, state, ts, y)
    elif number == 3:
        saturation_block(x, u, p, state, ts, y)
    elif number == 4:
        slew_limit_block(x, u, p, state, ts, y)
    elif number == 5:
        rate_law_block(x, u, p, state, ts, y)
    elif number == 6:
        congruency_block(x, u, p, state, ts, y)
    elif number == 7:
        asymmetry_block(x, u, p, state, ts, y)
    elif number == 8:
        backlash_block(x, u, p, state, ts, y)
    elif number == 9:
        gain_drift_block(x, u, p, state, ts, y)
    elif number == 10:
        thermal_drift_block(x, u, p, state, ts, y)
    elif number == 11:
        mains_hum_block(x, u, p, state, ts, y)
    else:
        unknown_block(x, u, p, state, ts, y)


@njit(inline="always")
def _run_core(number: int, u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    if number == 0:
        given_rate_block(u, v, p, state, y)
    elif number == 1:
        generalised_block(u, v, p, state, y)
    elif number == 2:
        pinched_block(u, v, p, state, y)
    elif number == 3:
        preisach_block(u, v, p, state, y)
    elif number == 4:
        bouc_wen_block(u, v, p, state, y)
    elif number == 5:
        duhem_block(u, v, p, state, y)
    elif number == 6:
        dahl_block(u, v, p, state, y)
    else:
        lugre_block(u, v, p, state, y)


@njit(cache=True)
def _rate(u: Array, pole: Array, last: Array, rate: Array, per_s: float, v: Array) -> None:
    # rate_block for one sample, in loops that compile to vector instructions.
    for b in range(len(u)):
        change = u[b] - last[b]
        change = change if last[b] == last[b] else 0.0  # NaN: a record begins here, v(0) = 0
        rate[b] = pole[b] * rate[b] + (1.0 - pole[b]) * (change * per_s)
    for b in range(len(u)):
        last[b] = u[b]
        v[b] = rate[b]


@njit(inline="always")
def _run_stage(
    stage: Table, x: int, u: int, y: int, p: Array, state: Array, ts: float, work: Array
) -> None:
    """Run a stage from row `x` of `work` to row `y`, beside the command in row `u`."""
    _run_kernel(
        stage[0], work[x : x + 1], work[u : u + 1], p[stage[2] : stage[3]],
        state[stage[4] : stage[5]], ts, work[y : y + 1],
    )  # fmt: skip


@njit(cache=True)
def run_chain(
    core: int,
    p: Array,
    state: Array,
    stages: Table,
    stage_p: Array,
    stage_state: Array,
    ts: float,
    work: Array,
) -> int:
    """Advance the plants of a block by one sample, as ``Plant.step`` does."""
    u, i = 0, 0
    while i < len(stages) and stages[i, 1] == _INPUT:
        _run_stage(stages[i], u, u, 1 - u, stage_p, stage_state, ts, work)
        u, i = 1 - u, i + 1
    v = 2
    _rate(work[u], p[len(p) - 2], state[0], state[1], 1.0 / ts, work[v])
    while i < len(stages) and stages[i, 1] == _RATE:
        _run_stage(stages[i], v, u, 5 - v, stage_p, stage_state, ts, work)
        v, i = 5 - v, i + 1
    y = 4
    _run_core(core, work[u : u + 1], work[v : v + 1], p, state, work[y : y + 1])
    while i < len(stages):
        _run_stage(stages[i], y, u, 9 - y, stage_p, stage_state, ts, work)
        y, i = 9 - y, i + 1
    return y
