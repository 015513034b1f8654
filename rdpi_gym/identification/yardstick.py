"""The paper's own identification: constrained least squares over all parameters at once (Eq. 10)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rdpi_gym.identification.bounds import data_scales
from rdpi_gym.identification.stack import Stack, stack_records
from rdpi_gym.measurement import Record
from rdpi_gym.plant import RDPI, empty_state
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

Method = Literal["trf", "SLSQP"]


@dataclass(frozen=True)
class Yardstick:
    """What the yardstick found.

    Parameters
    ----------
    hysteresis
        The model.
    train_rmse_um
        Its error (µm) on the records, one offset free in each.
    seconds
        Time taken (s).
    evaluations
        Simulations of all records.
    """

    hysteresis: RDPI
    train_rmse_um: float
    seconds: float
    evaluations: int


def yardstick(records: Sequence[Record], n: int = 10, method: Method = "trf") -> Yardstick:
    """Identify δ1, δ2, a_0 ... a_n as the paper did: all at once, with finite differences.

    The paper used MATLAB's constrained optimisation with δ1, δ2 > 0. Here the same problem goes to
    SciPy's trust-region least squares, which sees the errors one by one, or to its sequential
    quadratic programming, which MATLAB's toolbox is closer to; with the plant's compiled kernel, bounds on every parameter, parameters
    scaled by the start, offsets taken out exactly, and a start from the data: equal weights, half
    of the mean slope in a_0, thresholds over the whole excursion.
    """
    from scipy.optimize import least_squares, minimize

    if n < 1:
        raise InputError(f"{n} play operators; give 1 or more, for example 10")
    started = time.perf_counter()
    stack, _ = stack_records(records, None)
    start = _start(stack, n)
    lowest = np.concatenate([[1e-6, 0.0, 1e-6], np.zeros(n)])
    counted = np.count_nonzero(stack.root_weight)
    evaluations = 0

    def errors(scaled: Array) -> Array:
        nonlocal evaluations
        evaluations += 1
        return _errors(stack, scaled * start)

    def cost(scaled: Array) -> float:
        left = errors(scaled)
        return float(left @ left) / counted

    if method == "SLSQP":
        found = minimize(
            cost,
            np.ones(n + 3),
            method="SLSQP",
            bounds=[(low, None) for low in lowest],
            options={"ftol": 1e-10, "maxiter": 1000},
        ).x
    elif method == "trf":
        found = least_squares(errors, np.ones(n + 3), bounds=(lowest, np.inf), x_scale="jac").x
    else:
        raise InputError(f"method {method!r} is unknown; give trf or SLSQP")
    delta1, delta2, *weights = (found * start).tolist()
    return Yardstick(
        hysteresis=RDPI.from_law(weights, delta1, delta2),
        train_rmse_um=float(np.sqrt(cost(found))),
        seconds=time.perf_counter() - started,
        evaluations=evaluations,
    )


def _start(stack: Stack, n: int) -> Array:
    excursion, _, fastest = data_scales(stack)
    slope = float(stack.u_V @ stack.y_um) / float(stack.u_V @ stack.u_V)
    weights = np.full(n, 0.5 * slope / n)
    return np.concatenate([[excursion / (n + 1), 0.1 * excursion / fastest, 0.5 * slope], weights])


def _errors(stack: Stack, values: Array) -> Array:
    n = values.size - 3
    rows = np.concatenate([values[2:], values[0] * np.arange(1, n + 1), [values[1], 0.0, 0.0]])
    parts = []
    for r in range(stack.edges.size - 1):
        part = stack.record(r)
        y = np.empty((part.stop - part.start, 1))
        given_rate_block(
            stack.u_V[part, None], stack.rate_V_s[part, None], rows[:, None], empty_state(n, 1), y
        )
        error = (y[:, 0] - stack.y_um[part])[stack.root_weight[part] > 0]
        parts.append(error - error.mean())
    return np.concatenate(parts)
