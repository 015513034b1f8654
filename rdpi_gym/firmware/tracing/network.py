"""The networks of learned policies on traced numbers: linear layers and what stands between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from torch.nn import functional

from rdpi_gym.firmware.tracing.arrays import Traced, compute, here
from rdpi_gym.firmware.tracing.functions import METHODS, apply_ufunc
from rdpi_gym.support.errors import InputError


class TracedTensor:
    """A tensor whose numbers are known only as the code runs; PyTorch's modules run on it.

    Parameters
    ----------
    array
        Its numbers, ``(B, size)``.
    """

    def __init__(self, array: Traced) -> None:
        self.array = array

    def numpy(self) -> Traced:
        """Return its numbers."""
        return self.array

    @classmethod
    def __torch_function__(
        cls,
        function: Callable[..., Any],
        types: Any,
        given: tuple[Any, ...] = (),
        options: Mapping[str, Any] | None = None,
    ) -> TracedTensor:
        known = _FUNCTIONS.get(function)
        if known is None:
            raise InputError(f"{here()}: torch.{function.__name__} has no C")
        return cls(known(*(x.array if isinstance(x, cls) else x for x in given), **(options or {})))


def _linear(x: Traced, weight: torch.Tensor, bias: torch.Tensor | None = None) -> Traced:
    found: Traced = x @ weight.detach().numpy().astype(np.float64).T
    if bias is not None:
        found = found + bias.detach().numpy().astype(np.float64)
    return found


def _tanh(x: Traced) -> Traced:
    return apply_ufunc(np.tanh, "__call__", (x,), {})


def _relu(x: Traced, inplace: bool = False) -> Traced:
    return apply_ufunc(np.maximum, "__call__", (x, 0.0), {})


def _elu(x: Traced, alpha: float = 1.0, inplace: bool = False) -> Traced:
    below = x.recording.uses("EXPM1")
    return compute(
        "real", lambda v, a: f"({v} > RDPI_C(0.0)) ? {v} : ({a} * {below}({v}))", x, alpha
    )


def _silu(x: Traced, inplace: bool = False) -> Traced:
    grown: Traced = apply_ufunc(np.exp, "__call__", (-x,), {})
    found: Traced = x / (1.0 + grown)
    return found


def _hardtanh(
    x: Traced, min_val: float = -1.0, max_val: float = 1.0, inplace: bool = False
) -> Traced:
    found: Traced = METHODS["clip"](x, min_val, max_val)
    return found


_FUNCTIONS: dict[Callable[..., Any], Callable[..., Traced]] = {
    functional.linear: _linear,
    torch.tanh: _tanh,
    functional.tanh: _tanh,
    functional.relu: _relu,
    functional.elu: _elu,
    functional.silu: _silu,
    functional.hardtanh: _hardtanh,
}
