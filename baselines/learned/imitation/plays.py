"""Steps of rate-dependent plays, and of the search for a command along their chords, with gradients.

Of torch's own operations every step would take sixty, forth and back; as kernels a fit takes a third of the time.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import torch
from numba import njit
from torch import Tensor

from baselines.core_bank import TRIES
from baselines.learned.imitation.policy import Float32
from baselines.learned.imitation.teacher import Chords, Plays

# Columns of the numbers of a lane before its weights and thresholds, and of its state before the plays:
# a_0, δ2, pole and gain of the rate's low-pass, what a lag keeps; command behind the lag, rate, displacement.
_NUMBERS, _STATE = 5, 3


class TruePlays:
    """The true hysteresis of every lane, moved along."""

    def __init__(self, plays: Plays, rest_V: float) -> None:
        gain, no_lag = plays.gain, np.zeros_like(plays.gain)
        firsts = (gain, plays.delta2_s, plays.pole, plays.per_V, no_lag)
        self._numbers = _packed(firsts, plays.weights, plays.thresholds_V)
        self._state = _at_rest(rest_V, self._numbers, plays.memory_V)

    def step(self, command_V: Tensor) -> Tensor:
        """Return what a command behind the lag gives (µm)."""
        self._state = _moved(command_V, self._state, self._numbers)
        return self._state[:, 2]


class SearchedCore:
    """The belief's core behind its lag, moved along by what a search on it finds."""

    def __init__(self, chords: Chords, lanes: int, rest_V: float) -> None:
        firsts = (chords.gain, chords.delta2_s, chords.pole, chords.per_V, chords.kept)

        def each(values: Any) -> Float32:
            return np.tile(np.asarray(values, dtype=np.float32), (lanes, 1))

        self._numbers = _packed(each(firsts).T, each(chords.weights), each(chords.thresholds_V))
        self._bounds = (*chords.slopes, *chords.range_V)
        self._state = _at_rest(rest_V, self._numbers, each(chords.memory_V))

    def take(self, command_V: Tensor) -> tuple[Tensor, Tensor]:
        """Move on by a command; return what the core gives (µm), and what is besides the one found for it (V)."""
        before, self._state = self._state, _moved(command_V, self._state, self._numbers)
        gives = self._state[:, 2]
        found, _ = _searched(gives, torch.zeros_like(gives), before, self._numbers, self._bounds)
        return gives, command_V - found

    def drive(self, wanted_um: Tensor, besides_V: Tensor) -> Tensor:
        """Move on by what is found and something besides; return that command (V)."""
        command, self._state = _searched(
            wanted_um, besides_V, self._state, self._numbers, self._bounds
        )
        return command


def _packed(firsts: Iterable[Float32], weights: Float32, thresholds_V: Float32) -> Float32:
    """Return the numbers of lanes, a row each."""
    return np.ascontiguousarray(np.hstack([np.stack(list(firsts), axis=1), weights, thresholds_V]))


def _at_rest(rest_V: float, numbers: Float32, plays_V: Float32) -> Tensor:
    """Return the state of lanes at rest."""
    state = np.zeros((len(plays_V), _STATE + plays_V.shape[1]), dtype=np.float32)
    state[:, 0] = rest_V
    weights = numbers[:, _NUMBERS : _NUMBERS + plays_V.shape[1]]
    state[:, 2] = numbers[:, 0] * rest_V + (weights * plays_V).sum(axis=1)
    state[:, _STATE:] = plays_V
    return torch.from_numpy(state)


class _Moved(torch.autograd.Function):
    """State after a command."""

    @staticmethod
    def forward(ctx: Any, command: Tensor, state: Tensor, numbers: Float32) -> Tensor:
        after = torch.empty_like(state)
        _move_all(numbers, state.numpy(), command.numpy(), after.numpy())
        ctx.save_for_backward(state, after)
        ctx.numbers = numbers
        return after

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, Tensor, None]:
        state, after = ctx.saved_tensors
        by_state = torch.zeros_like(state)
        by_command = torch.empty(len(state))
        _move_all_back(
            ctx.numbers, state.numpy(), after.numpy(), grads[0].contiguous().numpy(),
            by_state.numpy(), by_command.numpy(),
        )  # fmt: skip
        return by_command, by_state, None


class _Searched(torch.autograd.Function):
    """Command that is found, with something besides, and the state after it; slopes count as given."""

    @staticmethod
    def forward(
        ctx: Any,
        wanted: Tensor,
        besides: Tensor,
        state: Tensor,
        numbers: Float32,
        bounds: tuple[float, ...],
    ) -> tuple[Tensor, Tensor]:
        command, after = torch.empty_like(wanted), torch.empty_like(state)
        _search_all(
            numbers, bounds, state.numpy(), wanted.numpy(), besides.numpy(), command.numpy(), after.numpy()
        )  # fmt: skip
        ctx.save_for_backward(wanted, state, after)
        ctx.numbers, ctx.bounds = numbers, bounds
        return command, after

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None, Tensor, None, None]:
        wanted, state, after = ctx.saved_tensors
        by_command, by_after = (each.contiguous().numpy() for each in grads)
        by_state, by_wanted = torch.zeros_like(state), torch.empty_like(wanted)
        _search_all_back(
            ctx.numbers, ctx.bounds, state.numpy(), after.numpy(), wanted.numpy(), by_command, by_after,
            by_state.numpy(), by_wanted.numpy(),
        )  # fmt: skip
        return by_wanted, None, by_state, None, None


def _moved(command_V: Tensor, state: Tensor, numbers: Float32) -> Tensor:
    after: Tensor = _Moved.apply(command_V, state, numbers)  # type: ignore[no-untyped-call]
    return after


def _searched(
    wanted_um: Tensor,
    besides_V: Tensor,
    state: Tensor,
    numbers: Float32,
    bounds: tuple[float, ...],
) -> tuple[Tensor, Tensor]:
    found: tuple[Tensor, Tensor] = _Searched.apply(  # type: ignore[no-untyped-call]
        wanted_um, besides_V, state, numbers, bounds
    )
    return found


@njit(cache=True)
def _move(p: Float32, state: Float32, command: float, after: Float32) -> float:
    """Write the state of one lane after a command, and return its displacement."""
    n = len(state) - _STATE
    u = p[4] * state[0] + (1.0 - p[4]) * command
    rate = p[2] * state[1] + p[3] * (u - state[0])
    grown = p[1] * abs(rate)
    y = p[0] * u
    for i in range(n):
        threshold = p[_NUMBERS + n + i] + grown
        after[_STATE + i] = max(u - threshold, min(u + threshold, state[_STATE + i]))
        y += p[_NUMBERS + i] * after[_STATE + i]
    after[0], after[1], after[2] = u, rate, y
    given: float = y
    return given


@njit(cache=True)
def _move_back(
    p: Float32, state: Float32, after: Float32, by_after: Float32, by_y: float, by_state: Float32
) -> float:
    """Add the gradient by the state before, and return that by the command; `by_y` counts besides `by_after`."""
    n = len(state) - _STATE
    u, rate = after[0], after[1]
    grown = p[1] * abs(rate)
    by_y += by_after[2]
    by_u, by_grown = by_after[0] + p[0] * by_y, 0.0
    for i in range(n):
        threshold = p[_NUMBERS + n + i] + grown
        held, by_play = state[_STATE + i], by_after[_STATE + i] + p[_NUMBERS + i] * by_y
        if held < u - threshold:
            by_u += by_play
            by_grown -= by_play
        elif held > u + threshold:
            by_u += by_play
            by_grown += by_play
        else:
            by_state[_STATE + i] += by_play
    by_rate = by_after[1] + p[1] * np.sign(rate) * by_grown
    by_u += p[3] * by_rate
    by_state[0] += p[4] * by_u - p[3] * by_rate
    by_state[1] += p[2] * by_rate
    by_command: float = (1.0 - p[4]) * by_u
    return by_command


@njit(cache=True)
def _move_all(numbers: Float32, state: Float32, command: Float32, after: Float32) -> None:
    """Move all lanes on."""
    for b in range(len(command)):
        _move(numbers[b], state[b], command[b], after[b])


@njit(cache=True)
def _move_all_back(
    numbers: Float32,
    state: Float32,
    after: Float32,
    by_after: Float32,
    by_state: Float32,
    by_command: Float32,
) -> None:
    """Take gradients of all lanes back."""
    for b in range(len(state)):
        by_command[b] = _move_back(numbers[b], state[b], after[b], by_after[b], 0.0, by_state[b])


@njit(cache=True)
def _search(
    p: Float32,
    bounds: tuple[float, ...],
    state: Float32,
    wanted: float,
    tried: Float32,
    slopes: Float32,
    after: Float32,
) -> None:
    """Write the commands of one lane's search, the last of them found, the slopes and the states tried."""
    least, usual, largest, low, high = bounds
    command, y, slopes[0] = state[0], state[2], usual
    tried[0] = min(max(command + (wanted - y) / usual, low), high)
    for t in range(TRIES):
        given = _move(p, state, tried[t], after[t])
        way = tried[t] - command
        slopes[1 + t] = slopes[t]
        if way != 0.0:
            slopes[1 + t] = min(max((given - y) / way, least), largest)
        command, y = tried[t], given
        tried[1 + t] = min(max(command + (wanted - y) / slopes[1 + t], low), high)


@njit(cache=True)
def _search_all(
    numbers: Float32,
    bounds: tuple[float, ...],
    state: Float32,
    wanted: Float32,
    besides: Float32,
    command: Float32,
    after: Float32,
) -> None:
    """Search for all lanes, and move them on."""
    tried, slopes = np.empty(1 + TRIES), np.empty(1 + TRIES)
    states = np.empty((TRIES, state.shape[1]), dtype=np.float32)
    for b in range(len(wanted)):
        _search(numbers[b], bounds, state[b], wanted[b], tried, slopes, states)
        command[b] = tried[TRIES] + besides[b]
        _move(numbers[b], state[b], command[b], after[b])


@njit(cache=True)
def _search_all_back(
    numbers: Float32,
    bounds: tuple[float, ...],
    state: Float32,
    after: Float32,
    wanted: Float32,
    by_command: Float32,
    by_after: Float32,
    by_state: Float32,
    by_wanted: Float32,
) -> None:
    """Take gradients of all lanes back through the command's step and each try."""
    low, high = bounds[3], bounds[4]
    tried, slopes = np.empty(1 + TRIES), np.empty(1 + TRIES)
    states = np.empty((TRIES, state.shape[1]), dtype=np.float32)
    nothing = np.zeros(state.shape[1], dtype=np.float32)
    for b in range(len(wanted)):
        p, before, gained = numbers[b], state[b], by_state[b]
        _search(p, bounds, before, wanted[b], tried, slopes, states)
        by = by_command[b] + _move_back(p, before, after[b], by_after[b], 0.0, gained)
        asked = 0.0
        for t in range(TRIES, -1, -1):
            if not low < tried[t] < high:
                by = 0.0
            share = by / slopes[t]
            asked += share
            if t > 0:
                by += _move_back(p, before, states[t - 1], nothing, -share, gained)
            else:
                gained[0] += by
                gained[2] -= share
        by_wanted[b] = asked
