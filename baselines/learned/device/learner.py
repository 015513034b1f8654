"""PPO on a torch device, as one learner."""

from __future__ import annotations

import torch
from torch import Tensor

from baselines.learned.device.lanes import DeviceLanes
from baselines.learned.device.networks import DeviceActorCritic
from baselines.learned.device.replay import Replay
from baselines.learned.device.update import DeviceUpdater
from baselines.learned.native.loop import PPOLoop, refuse_logs, room_for
from baselines.learned.native.networks import CRITIC, Workspace
from baselines.learned.native.ppo import NativePPO
from baselines.learned.native.update import Batch
from baselines.learned.run import Run
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.torch_plant.device import checked_device


class DeviceLearner(PPOLoop):
    """PPO whose plants, networks, rollouts and updates stay on one device.

    Parameters
    ----------
    run
        The training.
    device
        ``"cuda"`` or ``"cpu"``.

    Raises
    ------
    InputError
        A device that is not there, or hyper-parameters or options that nothing can be trained with.
    """

    kind = "DevicePPO"

    def __init__(self, run: Run, device: str) -> None:
        options = run.options
        refuse_logs(run)
        where = checked_device(device)
        torch.set_num_threads(options.threads)
        ppo = NativePPO(**run.settings.arguments())
        steps, count = ppo.n_steps, options.lanes or run.settings.lanes
        self._lanes = DeviceLanes(options, run.settings, count, where)
        inputs = self._lanes.scaling.history.size
        widths = (inputs, *ppo.net_arch, 1)
        both = DeviceActorCritic(widths, ppo.log_std_init, options.seed, where)
        generator = torch.Generator(where) if where.type != "meta" else torch.Generator()
        super().__init__(run, ppo, both, DeviceUpdater(both), generator)
        self._work = Workspace(widths, where)
        self._rows = room_for(steps, count, inputs, where)
        # Exploration and sensors, drawn ahead: what is replayed draws nothing.
        self._noise = torch.zeros(2, steps, count, device=where)
        self._actions, self._rewards, self._values, self._nexts, self._goes_on = (
            torch.zeros(steps, count, device=where) for _ in range(5)
        )
        self._k = torch.zeros(1, dtype=torch.int64, device=where)
        self._replay = Replay(self.step, where)

    @property
    def layout(self) -> ObservationLayout:
        """What the environment shows."""
        return self._lanes.scaling.history.layout

    def begin(self, seed: int) -> None:
        """Seed the generator, and begin an episode in all lanes."""
        self._generator.manual_seed(seed)
        self._lanes.begin(self._generator)

    @torch.no_grad()
    def rollout(self) -> tuple[Batch, Tensor]:
        """Run all lanes on; return what the update learns from, and the rewards ``(T, B)``."""
        self._noise.normal_(generator=self._generator)
        self._k.zero_()
        self._goes_on.fill_(1.0)
        for k in range(len(self._rows)):
            self._replay()
            ended = self._lanes.ended()
            if ended is not None:
                # What their last observation is worth stands for what would have come.
                worth = self._worth(self._lanes.rows.index_select(0, ended))
                self._nexts[k].index_copy_(0, ended, worth)
                self._goes_on[k].index_fill_(0, ended, 0.0)
                self._lanes.restart(self._generator)
        following = torch.cat([self._values[1:], self._worth(self._lanes.rows)[None]])
        nexts = torch.where(self._goes_on > 0.0, following, self._nexts)
        batch = self._learnt_from(
            self._rows, self._actions, self._rewards, self._noise[0],
            self._values, nexts, self._goes_on,
        )  # fmt: skip
        return batch, self._rewards

    @torch.no_grad()
    def step(self) -> None:
        """Take step k of the rollout in all lanes: what is replayed."""
        k, rows = self._k, self._lanes.rows
        explored, sensed = self._noise.index_select(1, k)[:, 0]
        self._rows.index_copy_(0, k, rows[None])
        mean, value = self.both.forward(rows, self._work)[:, :, 0]
        actions = mean + self.both.log_std.exp() * explored
        self._actions.index_copy_(0, k, actions[None])
        self._values.index_copy_(0, k, value[None])
        self._lanes.step(actions, sensed)
        self._rewards.index_copy_(0, k, self._lanes.rewards[None])
        k.add_(1)

    def _worth(self, rows: Tensor) -> Tensor:
        """Return the critic's values ``(n,)`` of rows, in its own units."""
        return self.both.forward(rows, self._work, CRITIC)[0, :, 0].clone()
