"""PPO on the native vector environment: rollouts in threads, updates, as one learner."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from baselines.learned.native.lanes import Lanes
from baselines.learned.native.loop import PPOLoop, refuse_logs, room_for
from baselines.learned.native.networks import ACTOR, CRITIC, ActorCritic, Workspace
from baselines.learned.native.ppo import NativePPO
from baselines.learned.native.update import Batch, Updater
from baselines.learned.run import Run
from rdpi_gym.envs.layout import ObservationLayout

_ROWS = 1024  # of a pass of the critic over a rollout


class NativeLearner(PPOLoop):
    """PPO in lanes of plants, without a wrapper or autograd between environment and network.

    Parameters
    ----------
    run
        The training.

    Raises
    ------
    InputError
        Hyper-parameters or options that nothing can be trained with.
    """

    kind = "NativePPO"

    def __init__(self, run: Run) -> None:
        options = run.options
        refuse_logs(run)
        torch.set_num_threads(1)  # what it shares among threads it divides itself
        ppo = NativePPO(**run.settings.arguments())
        count = options.lanes or run.settings.lanes
        self._lanes = Lanes(options, run.settings, count, options.threads)
        inputs = self._lanes.scaling.history.size
        widths = (inputs, *ppo.net_arch, 1)
        both = ActorCritic(widths, ppo.log_std_init, options.seed)
        self._native = Updater(both, options.threads)
        super().__init__(run, ppo, both, self._native, torch.Generator())
        self._works = [Workspace(widths) for _ in range(options.threads)]
        self._rows = room_for(ppo.n_steps + 1, count, inputs, "cpu")
        self._actions, self._rewards = (torch.zeros(ppo.n_steps, count) for _ in range(2))

    @property
    def layout(self) -> ObservationLayout:
        """What the environment shows."""
        return self._lanes.layout

    def begin(self, seed: int) -> None:
        """Seed every generator, and begin an episode in all lanes."""
        self._generator.manual_seed(seed)
        self._lanes.begin(seed, self._rows[-1].numpy())

    def rollout(self) -> tuple[Batch, Tensor]:
        """Run all lanes on; return what the update learns from, and the rewards ``(T, B)``."""
        steps, lanes, _ = self._rows.shape
        steps -= 1
        self._rows[0] = self._rows[-1]
        noise = torch.randn(steps, lanes, generator=self._generator)
        # What the lanes whose episode ends would have shown next.
        finals: list[list[tuple[int, np.ndarray[Any, Any], Tensor]]] = [
            [] for _ in self._lanes.parts
        ]
        self._native.each(lambda i: self._run(i, noise, finals[i]), len(self._lanes.parts))
        values = self._values(self._rows.flatten(0, 1)).view(steps + 1, lanes)
        nexts, goes_on = values[1:].clone(), torch.ones(steps, lanes)
        for k, ended, rows in (each for part in finals for each in part):
            nexts[k, ended], goes_on[k, ended] = self._values(rows), 0.0
        batch = self._learnt_from(
            self._rows[:-1], self._actions, self._rewards, noise, values[:-1], nexts, goes_on
        )
        return batch, self._rewards

    def _run(
        self, number: int, noise: Tensor, finals: list[tuple[int, np.ndarray[Any, Any], Tensor]]
    ) -> None:
        """Run one part of the lanes through a rollout."""
        part, work = self._lanes.parts[number], self._works[number]
        own = slice(part.first, part.end)
        deviations = noise[:, own] * self.both.log_std.exp()
        for k in range(len(noise)):
            before, after = self._rows[k, own], self._rows[k + 1, own]
            actions = self._actions[k, own]
            torch.add(self.both.forward(before, work, ACTOR)[0, :, 0], deviations[k], out=actions)
            written = after.numpy()
            part.step(
                actions.numpy().astype(np.float64), before.numpy(), written,
                self._rewards[k, own].numpy(),
            )  # fmt: skip
            ended = part.ended()
            if len(ended):
                finals.append((k, ended + part.first, after[ended]))
                part.restart(ended, written)

    def _values(self, rows: Tensor) -> Tensor:
        """Return the critic's values ``(n,)`` of rows, in its own units."""
        values = torch.empty(len(rows))
        parts = list(zip(torch.split(rows, _ROWS), torch.split(values, _ROWS), strict=True))
        count = len(self._works)

        def run(number: int) -> None:
            for some, out in parts[number::count]:
                out.copy_(self.both.forward(some, self._works[number], CRITIC)[0, :, 0])

        self._native.each(run, count)
        return values
