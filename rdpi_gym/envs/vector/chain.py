"""The plant's chain over one block of lanes and one sample, by the kernels that effects and cores declare.

Compiled code calls a kernel by its address: one compiled step serves every effect and every core, a
user's own too, and each kernel is compiled and cached once, by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numba import jit, njit, types
from numba.core import cgutils
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError
from numba.extending import intrinsic
from numpy.typing import NDArray

from rdpi_gym.plant.effects.base import SLOTS
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

Table: TypeAlias = NDArray[np.int64]
"""One row a stage, in the chain's order: address of its kernel, slot, first row and end of its
parameters, first row and end of its state."""

_INPUT, _RATE = SLOTS.index("input"), SLOTS.index("rate")
_ROWS, _NUMBER = types.float64[:, ::1], types.float64
_STAGE = (_ROWS, _ROWS, _ROWS, _ROWS, _NUMBER, _ROWS)  # x, u, p, state, ts, y
_CORE = (_ROWS, _ROWS, _ROWS, _ROWS, _ROWS)  # u, v, p, state, y


def stage_address(block: Callable[..., None], name: str) -> int:
    """Address of an effect's kernel in this process."""
    return _address(block, _STAGE, name)


def core_address(block: Callable[..., None], name: str) -> int:
    """Address of a core's kernel in this process."""
    return _address(block, _CORE, name)


@cache  # what is compiled lives as long as its address is in use
def _recompiled(block: Callable[..., None]) -> Any:
    if isinstance(block, Dispatcher):
        return jit(**block.targetoptions)(block.py_func)
    return njit(block)


def _compile(block: Callable[..., None], arguments: tuple[Any, ...]) -> Any:
    if isinstance(block, Dispatcher):
        try:
            return _compiled(block, arguments)
        except (
            NumbaError,
            RuntimeError,
        ):  # declared for strided arrays alone, it may compile for these
            pass
    return _compiled(_recompiled(block), arguments)


def _compiled(kernel: Any, arguments: tuple[Any, ...]) -> Any:
    # by its arguments, as a call compiles it: what is kept on disk serves both
    kernel.compile(arguments)
    return kernel.get_compile_result(types.none(*arguments))


def _address(block: Callable[..., None], arguments: tuple[Any, ...], name: str) -> int:
    try:
        compiled = _compile(block, arguments)
    except (NumbaError, TypeError) as error:
        reason = next(line for line in f"{error}\nno reason".splitlines() if line[:6] != "Failed")
        raise InputError(f"the kernel of {name} cannot be compiled: {reason}") from None
    # Releases of numba look a compiled kernel up by its arguments alone.
    returned = compiled.signature.return_type
    if not isinstance(returned, types.NoneType):
        raise InputError(f"the kernel of {name} returns {returned}; let it write y, return nothing")
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


def _call(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    """Code that calls the function at the address, with the other arguments."""
    convention, arguments = context.call_conv, signature.args[1:]
    kind = convention.get_function_type(types.none, arguments)
    kernel = builder.inttoptr(values[0], kind.as_pointer())
    status, _ = convention.call_function(builder, kernel, types.none, arguments, values[1:])
    with cgutils.if_unlikely(builder, status.is_error):
        convention.return_status_propagate(builder, status)
    return context.get_dummy_value()


@intrinsic
def _run_kernel(
    typing: Any, address: Any, x: Any, u: Any, p: Any, state: Any, ts: Any, y: Any
) -> tuple[Any, Any]:
    """Call of an effect's kernel at an address."""
    assert (x, u, p, state, ts, y) == _STAGE
    return types.none(types.int64, *_STAGE), _call


@intrinsic
def _run_core(
    typing: Any, address: Any, u: Any, v: Any, p: Any, state: Any, y: Any
) -> tuple[Any, Any]:
    """Call of a core's kernel at an address."""
    assert (u, v, p, state, y) == _CORE
    return types.none(types.int64, *_CORE), _call


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
    """Advance the plants of a block by one sample, as ``Plant.step`` does; `core` is an address."""
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
