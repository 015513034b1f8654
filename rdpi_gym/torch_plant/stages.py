"""The effects' kernels on tensors: one sample of every lane at a time.

Each function is the twin of a kernel of :mod:`rdpi_gym.plant.effects` and reads the same rows of
parameters; rows of the state are the kernel's, fewer, or (:func:`delay`) filled in another order.
All are float64: their poles are close to one, and creep's slowest element gains less in a sample
than float32 resolves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TypeAlias

import torch
from torch import Tensor

from rdpi_gym.plant.effects.asymmetry import (
    asymmetry_block,
    command_polynomial_block,
    polynomial_block,
    unlike_branches_block,
    unlike_envelopes_block,
)
from rdpi_gym.plant.effects.backlash import backlash_block
from rdpi_gym.plant.effects.base import Block, Effect
from rdpi_gym.plant.effects.congruency import (
    congruency_block,
    congruency_centred_block,
    congruency_curve_block,
    congruency_polynomial_block,
)
from rdpi_gym.plant.effects.creep import creep_block, weighted_creep_block
from rdpi_gym.plant.effects.delay import delay_block
from rdpi_gym.plant.effects.gain_drift import (
    gain_curve_block,
    gain_drift_block,
    gain_knots_block,
    gain_to_limit_block,
)
from rdpi_gym.plant.effects.linear import linear_block
from rdpi_gym.plant.effects.mains_hum import hum_harmonics_block, mains_hum_block
from rdpi_gym.plant.effects.rate_law import (
    logarithmic_rate_block,
    piecewise_rate_block,
    rate_law_block,
)
from rdpi_gym.plant.effects.saturation import hard_rails_block, knee_block, saturation_block
from rdpi_gym.plant.effects.slew_limit import slew_limit_block, unlike_slew_block
from rdpi_gym.plant.effects.thermal_drift import (
    curve_block,
    knots_block,
    thermal_drift_block,
    two_warmings_block,
)
from rdpi_gym.torch_plant.hysteresis import known

Twin: TypeAlias = Callable[[Tensor, Tensor, Tensor, Tensor, float], tuple[Tensor, Tensor]]
"""``twin(x, u, p, state, ts_s) -> (y, state)``: input and command ``float64[B]``, parameters
``float64[P, 1 or B]``, state ``float64[S, B]`` with NaN in row 0 of a lane without a past."""

# Below it a rate is as good as none; a power of zero would have no derivative.
_SLOWEST_V_S = 1e-200


def _begun(state: Tensor, values: Tensor) -> Tensor:
    """State, with `values` in the lanes that have no past."""
    return torch.where(known(state[0]), state, values)


def _clock(state: Tensor) -> Tensor:
    """Samples since the beginning, ``float64[1, B]``."""
    return torch.where(known(state[:1]), state[:1], 0.0)


def linear(x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.linear.linear_block`: lags and resonances."""
    m = round(math.sqrt(p.shape[0] + 3.0)) - 2
    f, g0, g1, c, d, rest = p.tensor_split(
        (m * m, m * m + m, m * m + 2 * m, m * m + 3 * m, m * m + 3 * m + 1)
    )
    state = _begun(state[: m + 1], torch.cat([torch.ones_like(d), rest]) * x)
    moved = (f.view(m, m, -1) * state[1:]).sum(1) + g0 * state[0] + g1 * x
    return (c * moved).sum(0) + d[0] * x, torch.cat([x[None], moved])


def creep(x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.creep.creep_block`."""
    state = _begun(state, x)
    z = p[1::3] * state[1:] + p[2::3] * state[0] + p[3::3] * x
    return x + p[0] * z.sum(0), torch.cat([x[None], z])


def weighted_creep(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.creep.weighted_creep_block`."""
    at_rest = torch.cat([torch.ones_like(state[:1]), torch.zeros_like(state[1:])]) * x
    state = _begun(state, at_rest)
    lack = p[1::2] * state[1:] + p[2::2] * (x - state[0])
    return p[0] * x - lack.sum(0), torch.cat([x[None], lack])


def delay(x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.delay.delay_block`.

    Row 0 of the state counts a lane's samples, the others are the ring. It is written in place
    (but where gradients need what it held), and what stands there from before the first sample is
    not read.
    """
    ring = state[1:]
    k = _clock(state)[0].to(torch.int64)
    whole = p[0].to(torch.int64)

    def past(samples: Tensor) -> Tensor:
        place = (k - samples).clamp(min=0) % len(ring)
        return torch.where((k == 0) | (samples == 0), x, ring.gather(0, place[None])[0])

    older, newer = past(whole + 1), past(whole)
    state = state.clone() if x.requires_grad else state
    state[1:].scatter_(0, (k % len(ring))[None], x[None])
    state[0] = k + 1
    return newer + p[1] * (older - newer), state


def saturation(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.saturation.saturation_block`."""
    limit, centre = p
    return centre + limit * torch.tanh((x - centre) / limit), state


def knee(x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.saturation.knee_block`."""
    limit, centre, power = p
    share = ((x - centre) / limit).abs()
    below = (1.0 + share.clamp(max=1.0) ** power) ** (-1.0 / power)
    above = (1.0 + share.clamp(min=1.0) ** -power) ** (-1.0 / power) / share.clamp(min=1.0)
    return centre + (x - centre) * torch.where(share <= 1.0, below, above), state


def hard_rails(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.saturation.hard_rails_block`."""
    return torch.minimum(torch.maximum(x, p[0]), p[1]), state


def slew_limit(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.slew_limit.slew_limit_block`."""
    return _follow(x, p, state, p[0], p[0])


def unlike_slew(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.slew_limit.unlike_slew_block`."""
    return _follow(x, p, state, p[0], p[1])


def _follow(x: Tensor, p: Tensor, state: Tensor, up: Tensor, down: Tensor) -> tuple[Tensor, Tensor]:
    """Follow the input by at most a step `up` or `down` a sample (V)."""
    last, out = _begun(state, x)
    change = x - last
    falls = change < 0.0
    ahead = torch.where(falls, last - out, out - last)
    towards, against = torch.where(falls, down, up), torch.where(falls, up, down)
    back = (ahead / (change.abs() + against)).clamp(max=1.0)
    turned = out + change.sign() * (towards * (1.0 - back) - against * back)
    followed = torch.minimum(torch.maximum(x, out - down), out + up)
    y = torch.where((change.abs() > towards) & (ahead > 0.0), turned, followed)
    return y, torch.stack([x, y])


def rate_law(x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.rate_law.rate_law_block`."""
    return x * (x.abs().clamp(min=_SLOWEST_V_S) / p[1]) ** p[0], state


def logarithmic_rate(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.rate_law.logarithmic_rate_block`."""
    return x.sign() * p[0] * torch.log1p(x.abs() / p[0]), state


def piecewise_rate(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.rate_law.piecewise_rate_block`."""
    below = -torch.log(x.abs().clamp(min=_SLOWEST_V_S) / p[0])
    power = torch.zeros_like(below)
    for excess in p[2:-1]:
        part = torch.minimum(below, p[1])
        power, below = power + excess * part, below - part
    return x * torch.exp(-(power + p[-1] * below)), state


def congruency(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.congruency.congruency_block`."""
    return x + p[1] * u * u * (x - p[0] * u), state


def congruency_centred(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.congruency.congruency_centred_block`."""
    away = u - p[2]
    return x + p[1] * away * away * (x - p[0] * u), state


def _powers(share: Tensor, p: Tensor) -> Tensor:
    """Σ p_k share^(k + 1), by Horner's rule."""
    total = torch.zeros_like(share)
    for factor in p.flip(0):
        total = (total + factor) * share
    return total


def congruency_polynomial(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.congruency.congruency_polynomial_block`."""
    return x + _powers(u * p[1], p[2:]) * (x - p[0] * u), state


def polynomial(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.asymmetry.polynomial_block`."""
    return x * (1.0 + _powers(x * p[0], p[1:])), state


def command_polynomial(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.asymmetry.command_polynomial_block`."""
    share = u * p[1]
    return x + p[0] * share * _powers(share, p[2:]), state


def unlike_branches(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.asymmetry.unlike_branches_block`."""
    last, stop = _begun(state, torch.stack([u, torch.zeros_like(u)]))
    stop = torch.clamp(stop + u - last, -p[2], p[2])
    return x + (p[0] + p[1] * stop / p[2]) * x * x, torch.stack([u, stop])


def unlike_envelopes(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.asymmetry.unlike_envelopes_block`."""
    n = (len(p) - 8) // 2
    begun = _begun(state, torch.cat([u[None], torch.zeros_like(state[1:])]))
    rate = p[7] * begun[1] + (1.0 - p[7]) * ((u - begun[0]) / ts_s)
    reach = p[8 + n :] + p[6] * rate.abs()
    s = (u - p[0]) / p[1]
    low = u + p[1] * s * s * (p[2] + p[3] * s)
    high = u + p[1] * s * s * (p[4] + p[5] * s)
    ordinary = torch.clamp(begun[2 : 2 + n], u - reach, u + reach)
    between = torch.maximum(torch.minimum(begun[2 + n :], high + reach), low - reach)
    more = (p[8 : 8 + n] * (between - ordinary)).sum(0)
    return x + more, torch.cat([u[None], rate[None], ordinary, between])


def asymmetry(x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.asymmetry.asymmetry_block`."""
    return x + p[0] * x * x, state


def backlash(x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.backlash.backlash_block`."""
    y = torch.clamp(_begun(state, x)[0], x - p[0], x + p[0])
    return y, y[None]


def gain_drift(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.gain_drift.gain_drift_block`."""
    clock = _clock(state)
    return x + p[0] * (clock[0] * ts_s) * x, clock + 1.0


def thermal_drift(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.thermal_drift.thermal_drift_block`."""
    clock = _clock(state)
    return x - p[0] * p[1] * torch.expm1(-clock[0] * ts_s / p[1]), clock + 1.0


def gain_to_limit(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.gain_drift.gain_to_limit_block`."""
    clock = _clock(state)
    return x - p[0] * p[1] * torch.expm1(-clock[0] * ts_s / p[1]) * x, clock + 1.0


def two_warmings(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.thermal_drift.two_warmings_block`."""
    clock = _clock(state)
    rate, tau = p[::2], p[1::2]
    return x - (rate * tau * torch.expm1(-clock * ts_s / tau)).sum(0), clock + 1.0


def _along_knots(time_s: Tensor, p: Tensor) -> Tensor:
    """Straight lines from 0 through p[1:] every p[0] s, at times ``float64[1, B]``."""
    steps = p[1:] - torch.cat([torch.zeros_like(p[:1]), p[1:-1]])
    before = torch.arange(len(steps), dtype=p.dtype, device=p.device)[:, None]
    return ((time_s / p[0] - before).clamp(0.0, 1.0) * steps).sum(0)


def _along_curve(time_s: Tensor, p: Tensor) -> Tensor:
    """Cubics of the share of an interval of p[0] s, at times ``float64[1, B]``."""
    slope, bend, twist = p[2::4], p[3::4], p[4::4]  # constants are what came before, added up
    before = torch.arange(len(slope), dtype=p.dtype, device=p.device)[:, None]
    share = (time_s / p[0] - before).clamp(0.0, 1.0)
    return (share * (slope + share * (bend + share * twist))).sum(0)


def _added(along: Callable[[Tensor, Tensor], Tensor]) -> Twin:
    """Twin of a drift of the displacement along a course over the clock."""

    def twin(x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float) -> tuple[Tensor, Tensor]:
        clock = _clock(state)
        return x + along(clock * ts_s, p), clock + 1.0

    return twin


def _multiplied(along: Callable[[Tensor, Tensor], Tensor]) -> Twin:
    """Twin of a drift of the gain along a course over the clock."""

    def twin(x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float) -> tuple[Tensor, Tensor]:
        clock = _clock(state)
        return x + along(clock * ts_s, p) * x, clock + 1.0

    return twin


def congruency_curve(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.congruency.congruency_curve_block`."""
    more = _along_curve((u - p[1])[None], p[2:])
    return x + more * (x - p[0] * u), state


def mains_hum(x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.mains_hum.mains_hum_block`."""
    clock = _clock(state)
    return x + p[0] * torch.sin(p[1] * (clock[0] * ts_s) + p[2]), clock + 1.0


def hum_harmonics(
    x: Tensor, u: Tensor, p: Tensor, state: Tensor, ts_s: float
) -> tuple[Tensor, Tensor]:
    """Twin of :func:`~rdpi_gym.plant.effects.mains_hum.hum_harmonics_block`."""
    clock = _clock(state)
    number = torch.arange(1, len(p) // 2 + 1, dtype=p.dtype, device=p.device)[:, None]
    angle = number * p[0] * (clock * ts_s)
    hum = p[1::2] * torch.sin(angle) + p[2::2] * torch.cos(angle)
    return x + hum.sum(0), clock + 1.0


TWINS: Mapping[Block, Twin] = {
    linear_block: linear,
    creep_block: creep,
    weighted_creep_block: weighted_creep,
    delay_block: delay,
    saturation_block: saturation,
    knee_block: knee,
    hard_rails_block: hard_rails,
    slew_limit_block: slew_limit,
    unlike_slew_block: unlike_slew,
    rate_law_block: rate_law,
    logarithmic_rate_block: logarithmic_rate,
    piecewise_rate_block: piecewise_rate,
    congruency_block: congruency,
    congruency_centred_block: congruency_centred,
    congruency_polynomial_block: congruency_polynomial,
    congruency_curve_block: congruency_curve,
    asymmetry_block: asymmetry,
    unlike_branches_block: unlike_branches,
    unlike_envelopes_block: unlike_envelopes,
    polynomial_block: polynomial,
    command_polynomial_block: command_polynomial,
    backlash_block: backlash,
    gain_drift_block: gain_drift,
    thermal_drift_block: thermal_drift,
    gain_to_limit_block: gain_to_limit,
    two_warmings_block: two_warmings,
    knots_block: _added(_along_knots),
    gain_knots_block: _multiplied(_along_knots),
    curve_block: _added(_along_curve),
    gain_curve_block: _multiplied(_along_curve),
    mains_hum_block: mains_hum,
    hum_harmonics_block: hum_harmonics,
}
"""The twin of each kernel; an effect, or a form of one, whose kernel is not among them cannot be run in torch."""


def has_twin(kind: type[Effect]) -> bool:
    """Whether an effect can be run in torch: its kernel has a twin, or no kernel is run."""
    return kind.slot == "memory" or kind.block in TWINS
