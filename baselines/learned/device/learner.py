"""PPO on a torch device, as one learner."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from baselines.learned.device.lanes import DeviceLanes
from baselines.learned.device.replay import Replay
from baselines.learned.native.loop import PPOLoop, refuse_logs, room_for
from baselines.learned.native.networks import CRITIC, ActorCritic, Workspace
from baselines.learned.native.ppo import NativePPO
from baselines.learned.native.update import LOG_SQRT_2_PI, Batch, Law, Losses
from baselines.learned.run import Run
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.torch_plant.device import checked_device

_FIRST, _SECOND, _LEAST = 0.9, 0.999, 1e-5  # of Adam: betas and epsilon, as the native learner's


class DeviceUpdater:
    """Makes the updates of :class:`~baselines.learned.native.update.Updater` on a device.

    Where that one ends an update because it led too far, this one goes on without effect: to end, the
    host would have to wait for each minibatch.

    Parameters
    ----------
    both
        The networks.
    """

    def __init__(self, both: ActorCritic) -> None:
        self.both, self._device = both, both.parameters.device
        self._gradient = torch.zeros_like(both.parameters)
        self._weights, self._biases, self._log_std = both.views(self._gradient)
        self._work = Workspace(both.widths, self._device)
        self._moments = [torch.zeros_like(both.parameters) for _ in range(2)]
        self._age = self._number()  # steps that Adam has made
        # The numbers of a law, the learning rate, and how far an update may lead.
        self._rate, self._clip, self._farthest = (self._number() for _ in range(3))
        self._entropy, self._value, self._largest = (self._number() for _ in range(3))
        self._goes_on = torch.ones((), dtype=torch.bool, device=self._device)
        # Policy, value, divergence, clipped: summed over minibatches; then how many, and of steps.
        self._sums, self._last = self._number(6), self._number()
        self._batch: Batch | None = None
        self._minibatches: dict[int, tuple[Tensor, Replay]] = {}

    def update(self, batch: Batch, law: Law, rate: float, orders: Sequence[Tensor]) -> Losses:
        """Go through a batch, minibatch by minibatch."""
        self.take(batch, law, rate)
        for order in orders:
            for chosen in torch.split(order, law.batch_size):
                own, replay = self._minibatch_of(len(chosen))
                own.copy_(chosen)
                replay()
        policy, value, _, clipped, count, steps, last = torch.cat(
            [self._sums, self._last[None]]
        ).tolist()
        return Losses(policy / count, value / count, last, clipped / count, int(steps))

    @torch.no_grad()
    def take(self, batch: Batch, law: Law, rate: float) -> None:
        """Begin an update: put what its minibatches read where they read it."""
        if self._batch is None:
            # Rows are the learner's own, and stay where they are.
            self._batch = Batch(batch.rows, *(torch.empty_like(each) for each in batch[1:]))
        for kept, new in zip(self._batch, batch, strict=True):
            if kept.data_ptr() != new.data_ptr():
                kept.copy_(new)
        farthest = math.inf if law.target_kl is None else 1.5 * law.target_kl
        numbers = (rate, law.clip_range, farthest, law.ent_coef, law.vf_coef, law.max_grad_norm)
        places = (
            self._rate, self._clip, self._farthest, self._entropy, self._value, self._largest,
        )  # fmt: skip
        for place, number in zip(places, numbers, strict=True):
            place.fill_(number)
        self._goes_on.fill_(True)
        self._sums.zero_()

    def state(self) -> Mapping[str, Any]:
        """Return what its next step depends on."""
        first, second = self._moments
        return {"first": first, "second": second, "age": self._age}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from what :meth:`state` returned."""
        for name, kept in self.state().items():
            kept.copy_(state[name])

    @torch.no_grad()
    def minibatch(self, chosen: Tensor) -> None:
        """Take a step along the gradient over some rows ``int64[n]`` of the batch: what is replayed."""
        assert self._batch is not None
        found = self._slope(self._batch, chosen)
        goes_on = self._goes_on.clone()
        self._sums[:4].add_(torch.where(goes_on, found, 0.0))
        self._sums[4].add_(goes_on)
        self._last.copy_(torch.where(goes_on, found[2], self._last))
        self._goes_on.logical_and_((found[2] > self._farthest).logical_not())
        self._sums[5].add_(self._goes_on)
        self._step()

    def _minibatch_of(self, rows: int) -> tuple[Tensor, Replay]:
        if rows not in self._minibatches:
            chosen = torch.zeros(rows, dtype=torch.int64, device=self._device)
            replay = Replay(lambda: self.minibatch(chosen), self._device)
            self._minibatches[rows] = chosen, replay
        return self._minibatches[rows]

    def _slope(self, batch: Batch, chosen: Tensor) -> Tensor:
        """Work the gradient out; return losses, divergence, and share of rows that were clipped."""
        both, work, count = self.both, self._work, len(chosen)
        rows = work.gather(batch.rows, chosen)
        mean, value = both.forward(rows, work)[:, :, 0]
        actions, densities, wanted, returns = (each[chosen] for each in batch[1:])
        if count > 1:
            wanted = (wanted - wanted.mean()) / (wanted.std() + 1e-8)
        narrow = torch.exp(-both.log_std)
        away = (actions - mean) * narrow
        squares = away * away
        change = -both.log_std - LOG_SQRT_2_PI - 0.5 * squares - densities
        ratio = change.exp()
        moved = ratio - 1.0
        gain = ratio * wanted
        bounded = ratio.clamp(1.0 - self._clip, 1.0 + self._clip) * wanted
        missed = value - returns
        # The loss falls with the smaller of both: where that is the bounded one, it has no slope.
        pull = torch.where(gain <= bounded, gain, 0.0) / -count
        self._gradient.zero_()
        slopes = work.layers(count, 2)[1][-1]
        slopes[0, :, 0] = pull * away * narrow
        slopes[1, :, 0] = missed * (2.0 * self._value / count)
        self._log_std.copy_(pull @ (squares - 1.0) - self._entropy)
        both.backward(rows, work, (self._weights, self._biases))
        clipped = (moved.abs() > self._clip).to(moved.dtype)
        losses = -torch.minimum(gain, bounded), missed * missed, moved - change, clipped
        return torch.stack([each.mean() for each in losses]).double()

    def _step(self) -> None:
        """Step Adam along the gradient, its norm bounded; without effect where the update is over."""
        goes_on, gradient = self._goes_on, self._gradient
        norm = gradient.norm()
        gradient.mul_(torch.where(norm > self._largest, self._largest / (norm + 1e-6), 1.0))
        first, second = self._moments
        self._age.add_(goes_on)
        first.copy_(torch.where(goes_on, torch.lerp(gradient, first, _FIRST), first))
        squared = torch.lerp(gradient * gradient, second, _SECOND)
        second.copy_(torch.where(goes_on, squared, second))
        rate = self._rate / (1.0 - _FIRST**self._age)
        deviation = second.sqrt() / (1.0 - _SECOND**self._age).sqrt() + _LEAST
        moved = torch.addcdiv(self.both.parameters, -rate * first, deviation)
        self.both.parameters.copy_(torch.where(goes_on, moved, self.both.parameters))

    def _number(self, *shape: int) -> Tensor:
        return torch.zeros(shape, dtype=torch.float64, device=self._device)


class DeviceActorCritic(ActorCritic):
    """:class:`~baselines.learned.native.networks.ActorCritic` on a device, of the same first weights.

    Parameters
    ----------
    widths, log_std, seed
        As there.
    device
        Where the parameters live.

    Examples
    --------
    >>> from baselines.learned.native.networks import Workspace
    >>> both = DeviceActorCritic((3, 8, 1), log_std=-1.0, seed=0, device="cpu")
    >>> both.forward(torch.zeros(5, 3), Workspace(both.widths)).shape
    torch.Size([2, 5, 1])
    """

    def __init__(
        self, widths: Sequence[int], log_std: float, seed: int, device: torch.device | str
    ) -> None:
        super().__init__(widths, log_std, seed)
        self._point(self.parameters.to(device))

    def _bend(self, layer: Tensor) -> None:
        layer.tanh_()


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
