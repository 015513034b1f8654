"""One round of fitting: back-propagation through the student and the true plants, cut into stretches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import nn

from baselines.learned.imitation.loop import Loop
from baselines.learned.imitation.student import Float32, Student
from baselines.learned.imitation.teacher import Visited
from rdpi_gym.support.arrays import Array

STRETCH = 250
"""Samples over which gradients go back: half the memory of the estimate."""
WARM_UP = 500
"""Samples at an episode's begin that do not count: little is known of the plant yet."""
BEFORE = 0.3
"""Weight of samples before those that are scored."""
STEEPEST = 1.0
"""Norm that gradients are clipped to."""
FLOOR = 0.1
"""Error (units of :data:`~baselines.learned.imitation.student.UNIT_UM`) below which none is sought."""
FIXED = ("middle", "spread")
"""Arrays that are measured once and not learned."""


@dataclass
class Learner:
    """A network that is being fitted, with its optimiser.

    Parameters
    ----------
    arrays
        As :class:`~baselines.learned.imitation.student.Student` has them; a copy is learned.
    weighted
        As there.
    """

    arrays: Mapping[str, Float32]
    weighted: int

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

    def fit(self, visited: Visited, weights: Array, rate: float) -> float:
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
            loop.forget()
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
