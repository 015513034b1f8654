"""The RDPI model on tensors, Eq. 2 to 5 and 8: the functions of rdpi_gym.plant.cores.play for one sample.

What a lane has n of, its play states with their thresholds and weights, is in the plant's dtype:
a play does not gather rounding errors, since Eq. 4 is a contraction. What a lane has one of, its
command and its rate, is float64: the rate is a difference over Ts, and a command rounded to
float32 would move the thresholds by up to δ2 / Ts times its rounding error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from rdpi_gym.plant import RDPI, pack
from rdpi_gym.support.errors import InputError


class RDPITensors(NamedTuple):
    """RDPI parameters on a device; the last axis is B, or 1 where all lanes share them.

    Parameters
    ----------
    a0
        a_0 (µm/V), ``float64[1 or B]``.
    weights
        a_1 ... a_n (µm/V), ``[n, 1 or B]`` in the plant's dtype.
    thresholds_V
        r_1 ... r_n at rest (V), as `weights`.
    delta2_s
        δ2 (s), ``float64[1 or B]``.
    rate_pole
        Pole of the low-pass on the rate, exp(-2π f_c Ts); 0: literal Eq. 5.
    offset_um
        Added to the displacement (µm), ``float64[1 or B]``.

    Examples
    --------
    >>> p = RDPITensors.of([RDPI.from_law([1.0, 0.5], 2.0, 0.0)], 1e-4, [0.0])
    >>> p.weights.tolist(), p.thresholds_V.tolist()
    ([[0.5]], [[2.0]])
    """

    a0: Tensor
    weights: Tensor
    thresholds_V: Tensor
    delta2_s: Tensor
    rate_pole: Tensor
    offset_um: Tensor

    @classmethod
    def of(
        cls,
        models: Sequence[RDPI],
        ts_s: float,
        offsets_um: Sequence[float],
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
    ) -> RDPITensors:
        """Pack models, one a lane or one for all; arguments as :func:`rdpi_gym.plant.pack`."""
        p = torch.from_numpy(pack(models, ts_s, offsets_um)).to(device)
        n = models[0].n
        weights, thresholds = p[1 : n + 1].to(dtype), p[n + 1 : 2 * n + 1].to(dtype)
        return cls(p[0], weights, thresholds, p[2 * n + 1], p[2 * n + 2], p[2 * n + 3])

    def randomised(
        self, half_width: float, lanes: int, generator: torch.Generator | None = None
    ) -> RDPITensors:
        """Draw parameters of `lanes` plants about these, on the device.

        Every weight, every gap between neighbouring thresholds and δ2 is multiplied by a number of
        its own, uniform over ``1 - half_width`` to ``1 + half_width``, as
        :func:`rdpi_gym.envs.truth.randomise_plant` does.

        Parameters
        ----------
        half_width
            Relative half-width, 0 or more and below 1.
        lanes
            Number of lanes B.
        generator
            Of the tensors' device; torch's own by default.

        Raises
        ------
        InputError
            The half-width is out of range.

        Examples
        --------
        >>> p = RDPITensors.of([RDPI.from_law([1.0, 0.5], 2.0, 0.0)], 1e-4, [0.0])
        >>> p.randomised(0.1, lanes=3).weights.shape
        torch.Size([1, 3])
        """
        if not 0.0 <= half_width < 1.0:
            raise InputError(
                f"half_width is {half_width}; give a relative half-width of 0 to below 1"
            )

        def scaled(values: Tensor) -> Tensor:
            shape = (*values.shape[:-1], lanes)
            factors = torch.empty(shape, dtype=values.dtype, device=values.device)
            return values * factors.uniform_(
                1.0 - half_width, 1.0 + half_width, generator=generator
            )

        gaps = self.thresholds_V.diff(dim=0, prepend=torch.zeros_like(self.thresholds_V[:1]))
        return self._replace(
            a0=scaled(self.a0),
            weights=scaled(self.weights),
            thresholds_V=scaled(gaps).cumsum(0),
            delta2_s=scaled(self.delta2_s),
        )


def known(x: Tensor) -> Tensor:
    """Whether values are there, and not NaN: ``isnan`` compiled for a CPU goes lane by lane."""
    return x == x


def rate(u: Tensor, last: Tensor, v: Tensor, p: RDPITensors, ts_s: float) -> Tensor:
    """Rate of the command, Eq. 5, after the low-pass of the plant."""
    step = u - torch.where(known(last), last, u)
    return p.rate_pole * v + (1.0 - p.rate_pole) * (step / ts_s)


def play_sum(
    u: Tensor, v: Tensor, p: RDPITensors, xi: Sequence[Tensor]
) -> tuple[Tensor, tuple[Tensor, ...]]:
    """RDPI sum of one sample, Eq. 3, 4 and 8, without the offset."""
    command = u.to(p.weights.dtype)
    shift = (p.delta2_s * v.abs()).to(p.weights.dtype)  # Eq. 8
    total, states = torch.zeros_like(command), []
    for x, a, rest in zip(xi, p.weights.unbind(), p.thresholds_V.unbind(), strict=True):
        r = rest + shift
        state = torch.clamp(x, command - r, command + r)  # Eq. 4
        total = total + a * state  # Eq. 3
        states.append(state)
    return p.a0 * u + total.to(u.dtype), tuple(states)
