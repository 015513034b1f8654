"""Fit of a student: back-propagation through the student and the true plants, cut into stretches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from baselines.adaptive_feedforward import HALF, SPLINE
from baselines.learned.imitation.plays import SearchedCore, TruePlays
from baselines.learned.imitation.policy import (
    CORRECTIONS,
    ERRORS,
    KNOWN,
    MOST_UM,
    UNIT_UM,
    Float32,
    Student,
)
from baselines.learned.imitation.teacher import RENEWED, BankModel, LoopModel, Rollout, Systems
from rdpi_gym.support.arrays import Array

WINDOW = 2 * HALF + 1
"""Samples of the derivatives that the estimate learns from."""


class Loop:
    """A student that drives again where another drove, from the begin of an episode.

    What it sees is what was seen, changed by what its own corrections change: errors, the estimate,
    what that leaves, and the base's own correction.
    """

    def __init__(self, tensors: Mapping[str, Tensor], weighted: int, visited: Rollout) -> None:
        self._p, self._weighted = tensors, weighted
        self._seen = torch.from_numpy(visited.seen).transpose(1, 2)
        self._error, self._before, self._left = map(
            torch.from_numpy, (visited.error, visited.correction, visited.left)
        )
        lanes = visited.left.shape[1]
        self._h = torch.zeros(lanes, tensors["hidden"].shape[1])
        self._errors = torch.zeros(lanes, ERRORS)
        self._corrections = torch.zeros(lanes, CORRECTIONS)
        self._ones = torch.ones(lanes, 1)
        self._around = _around(visited)

    def run(self, begin: int, end: int) -> Tensor:
        """Return the errors that are left after the decisions of a stretch, ``[K, B]``."""
        p, width, around = self._p, self._h.shape[1], self._around
        most, rows = MOST_UM / UNIT_UM, []
        per_spread = 1.0 / p["spread"]
        scaled = (self._seen[begin:end] - p["middle"]) * per_spread
        for i, k in enumerate(range(begin, end)):
            error = self._error[k] - around.moved_um / UNIT_UM
            seen = scaled[i] + around.answer(k) * per_spread
            self._errors = torch.cat([error[:, None], self._errors[:, :-1]], dim=1)
            past = torch.cat([self._errors, self._corrections], dim=1)
            given = torch.addmm(p["bias"], torch.arcsinh(seen), p["into"].T)
            from_seen = torch.addmm(given, torch.arcsinh(past), p["past"].T)
            back = torch.addmm(p["hidden_bias"], self._h, p["hidden"].T)
            gates = torch.sigmoid(from_seen[:, : 2 * width] + back[:, : 2 * width])
            reset, keep = gates.chunk(2, dim=1)
            fresh = torch.tanh(from_seen[:, 2 * width :] + reset * back[:, 2 * width :])
            self._h = fresh + keep * (self._h - fresh)
            weights = torch.addmm(p["head_bias"], self._h, p["head"].T)
            phi = torch.cat([seen[:, : self._weighted], self._ones, self._errors], dim=1)
            correction = most * torch.tanh((weights * phi).sum(dim=1) / most)
            self._corrections = torch.cat([correction[:, None], self._corrections[:, :-1]], dim=1)
            around.follow(k, UNIT_UM * (correction - self._before[k]))
            rows.append(self._left[k] - around.moved_um / UNIT_UM)
        return torch.stack(rows)


class _Systems:
    """Linear systems of all lanes with their states."""

    def __init__(self, systems: Systems) -> None:
        self._a, self._b, self._c, self._d = (
            torch.from_numpy(getattr(systems, each.name)) for each in fields(systems)
        )
        self._x = torch.zeros_like(self._b)

    def step(self, given: Tensor) -> Tensor:
        if not self._b.shape[1]:
            return self._d * given
        found = torch.addcmul((self._c * self._x).sum(dim=1), self._d, given)
        moved = torch.bmm(self._a, self._x[:, :, None])[:, :, 0]
        self._x = torch.addcmul(moved, self._b, given[:, None])
        return found


class _LoopModel:
    """Loop model on tensors, in µm and V: absolute where they are not linear, and else what has changed."""

    def __init__(self, given: LoopModel, inputs: int) -> None:
        self._given, lanes = given, given.wanted_um.shape[1]
        self._wanted, self._gave = map(torch.from_numpy, (given.wanted_um, given.given_um))
        self._inverse, self._estimate = _tensors(given.inverse), _tensors(given.estimate)
        self._plays = TruePlays(given.plays, given.rest_V)
        self._before, self._behind, self._feedback = map(
            _Systems, (given.before, given.behind, given.feedback)
        )
        self._last = torch.from_numpy(given.start_um)
        self._eta = self._inverse["plays_um"].expand(lanes, -1)
        self.moved_um = torch.zeros(lanes)
        """Change of the displacement at the present sample."""
        estimate = given.estimate
        size = estimate.theta.shape[2]
        self._gradient, self._theta = torch.zeros(lanes, size), torch.zeros(lanes, size)
        self._own = self._fed = torch.zeros(lanes)
        self._measured = [torch.zeros(lanes)] * WINDOW
        self._entered = [torch.zeros(lanes)] * (estimate.late + WINDOW)
        self._spline = torch.tensor(SPLINE, dtype=torch.float32)
        self._first = torch.zeros(lanes, KNOWN)
        self._last_seen = torch.zeros(lanes, inputs - KNOWN - size - 2)

    def answer(self, k: int) -> Tensor:
        """Let feedback and estimate answer what was measured; return what is seen otherwise, ``[B, inputs]``."""
        given, of = self._given.estimate, self._estimate
        self._fed = self._feedback.step(-self.moved_um)
        self._measured = [*self._measured[1:], self.moved_um]
        measured = self._spline @ torch.stack(self._measured)
        entered = self._spline[0] @ torch.stack(self._entered[:WINDOW])
        theta, phi = of["theta"][k], of["phi"][k]
        derivatives = measured[1:].T
        change = entered - measured[0] - (theta[:, :3] * derivatives).sum(dim=1)
        if k >= given.begins:
            gradient = given.kept * self._gradient + phi * change[:, None]
            turned = torch.addcmul(gradient[:, :3], derivatives, of["left_um"][k][:, None])
            self._gradient = torch.cat([turned, gradient[:, 3:]], dim=1)
            if given.solves(k):
                covariance = of["covariance"][k // RENEWED]
                self._theta = torch.bmm(covariance, self._gradient[:, :, None])[:, :, 0]
        self._own = (self._theta * of["answered"][k]).sum(dim=1)
        left = change - (self._theta * phi).sum(dim=1)
        known = self._theta / of["spread"]
        own = self._own / given.scale_um
        parts = [self._first, known, (left / UNIT_UM)[:, None], own[:, None], self._last_seen]
        return torch.cat(parts, dim=1)

    def follow(self, k: int, more_um: Tensor) -> None:
        """Drive the true plants with a correction that is larger by ``(B,)`` than the one that was."""
        inverse = self._inverse
        changed = self._own + self._fed + more_um
        self._entered = [*self._entered[1:], changed]
        wanted = self._wanted[k] + changed
        grown = self._given.inverse.per_um * (wanted - self._last).abs()
        self._last = wanted
        thresholds, w = inverse["thresholds_um"] + grown[:, None], wanted[:, None]
        self._eta = torch.maximum(w - thresholds, torch.minimum(w + thresholds, self._eta))
        command = self._given.inverse.gain * wanted + self._eta @ inverse["weights"]
        gives = self._plays.step(self._before.step(command))
        self.moved_um = self._behind.step(gives - self._gave[k])


class _BankModel:
    """Model of the bank on tensors; commands differ by what the search makes of another w."""

    def __init__(self, given: BankModel) -> None:
        self._given, lanes = given, given.given_um.shape[1]
        commands, self._gave = map(torch.from_numpy, (given.commands_V, given.given_um))
        self._plays = TruePlays(given.plays, given.rest_V)
        self._before, self._behind, self._feedback = map(
            _Systems, (given.before, given.behind, given.feedback)
        )
        visited = SearchedCore(given.chords, lanes, given.rest_V)
        # What was driven with differs from what the search on the belief's core alone finds.
        both = zip(*(visited.take(command) for command in commands), strict=True)
        self._wanted, self._besides = map(torch.stack, map(list, both))
        self._core = SearchedCore(given.chords, lanes, given.rest_V)
        self._fed = self._passed = torch.zeros(lanes)
        self.moved_um = torch.zeros(lanes)
        """Change of the displacement at the present sample."""

    def answer(self, k: int) -> Tensor:
        """Let the feedback answer what was measured; nothing but errors and corrections is seen otherwise."""
        self._fed = self._feedback.step(-self.moved_um)
        return torch.zeros(())

    def follow(self, k: int, more_um: Tensor) -> None:
        """Drive the true plants with a correction that is larger by ``(B,)`` than the one that was."""
        kept = self._given.chords.kept
        self._passed = kept * self._passed + (1.0 - kept) * (self._fed + more_um)
        command = self._core.drive(self._wanted[k] + self._passed, self._besides[k])
        gives = self._plays.step(self._before.step(command))
        self.moved_um = self._behind.step(gives - self._gave[k])


class _CorrectionLoops:
    """Systems from a correction to the displacement; what the estimate makes of it is seen in the next round."""

    def __init__(self, systems: Systems) -> None:
        self._systems = _Systems(systems)
        self.moved_um = torch.zeros(len(systems.d))
        """Change of the displacement at the present sample."""

    def answer(self, k: int) -> Tensor:
        """Return that nothing but errors and corrections is seen otherwise."""
        return torch.zeros(())

    def follow(self, k: int, more_um: Tensor) -> None:
        """Answer a correction that is larger by ``(B,)`` than the one that was."""
        self.moved_um = self._systems.step(more_um)


_Around = _LoopModel | _BankModel | _CorrectionLoops


def _around(visited: Rollout) -> _Around:
    """Return the loop of a rollout on tensors."""
    given = visited.loop_model
    if isinstance(given, Systems):
        return _CorrectionLoops(given)
    if isinstance(given, BankModel):
        return _BankModel(given)
    return _LoopModel(given, visited.seen.shape[1])


_States = _LoopModel | _BankModel | _CorrectionLoops | _Systems | TruePlays | SearchedCore


def _cut_gradients(state: Loop | _States) -> None:
    """Detach every tensor of a state: what comes next does not go back beyond here."""
    for name, value in list(vars(state).items()):
        if isinstance(value, Tensor):
            setattr(state, name, value.detach())
        elif isinstance(value, list):
            setattr(state, name, [each.detach() for each in value])
        elif isinstance(value, _States):
            _cut_gradients(value)


def _tensors(given: Any) -> dict[str, Any]:
    """Return the arrays of a dataclass as tensors, and its numbers."""
    found = {each.name: getattr(given, each.name) for each in fields(given)}
    return {
        name: torch.from_numpy(value) if isinstance(value, np.ndarray) else value
        for name, value in found.items()
    }


STRETCH = 250
"""Samples over which gradients go back: half the memory of the estimate."""
WARM_UP = 500
"""Samples at an episode's begin that do not count: little is known of the plant yet."""
BEFORE = 0.3
"""Weight of samples before those that are scored."""
STEEPEST = 1.0
"""Norm that gradients are clipped to."""
FLOOR = 0.1
"""Error (units of :data:`~baselines.learned.imitation.policy.UNIT_UM`) below which none is sought."""
FIXED = ("middle", "spread")
"""Arrays that are measured once and not learned."""


@dataclass
class Learner:
    """A network that is being fitted, with its optimiser."""

    arrays: Mapping[str, Float32]
    # As :class:`~baselines.learned.imitation.policy.Student` has them; a copy is learned.
    weighted: int  # as there

    def __post_init__(self) -> None:
        tensors = {name: torch.tensor(each) for name, each in self.arrays.items()}
        self.tensors = tensors
        self.learned = [tensors[name].requires_grad_() for name in self.arrays if name not in FIXED]
        self.optimiser = torch.optim.Adam(self.learned)

    @property
    def student(self) -> Student:
        """The network as it is now."""
        arrays = {name: each.detach().numpy().copy() for name, each in self.tensors.items()}
        return Student(arrays, self.weighted)

    def fit(self, visited: Rollout, weights: Array, rate: float) -> float:
        """Go once through what was visited, a step of the optimiser a stretch.

        At decision k the student would have seen what was seen, but for its errors and corrections,
        which are what they would have become with its corrections as they are now. What is made
        small is the RMS error of each stretch that is left then.
        """
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        loop = Loop(self.tensors, self.weighted, visited)
        weighting = torch.tensor(weights, dtype=torch.float32)
        samples = len(visited.seen)
        squares, count = torch.zeros(len(weights)), 0
        for begin in range(0, samples, STRETCH):
            with torch.set_grad_enabled(begin >= WARM_UP):
                left = loop.run(begin, min(begin + STRETCH, samples))
            mean = left.square().mean(dim=0)
            if begin >= visited.first:
                squares += left.detach().square().sum(dim=0)
                count += len(left)
            if begin >= WARM_UP:
                share = 1.0 if begin >= visited.first else BEFORE
                loss = share * ((mean + FLOOR**2).sqrt() * weighting).mean()
                self.optimiser.zero_grad()
                torch.autograd.backward(loss)
                nn.utils.clip_grad_norm_(self.learned, STEEPEST)
                self.optimiser.step()
            _cut_gradients(loop)
        return float(((squares / max(count, 1)).sqrt() * weighting).mean())

    def moments(self) -> dict[str, Any]:
        """Return what the optimiser remembers, as tensors by name."""
        found: dict[str, Any] = {}
        for i, state in self.optimiser.state_dict()["state"].items():
            found |= {f"{i}.{name}": torch.as_tensor(value) for name, value in state.items()}
        return found

    def remember(self, moments: Mapping[str, Any]) -> None:
        """Take up what :meth:`moments` returned."""
        document = self.optimiser.state_dict()
        for name, value in moments.items():
            i, _, key = name.partition(".")
            document["state"].setdefault(int(i), {})[key] = value.clone()
        self.optimiser.load_state_dict(document)
