"""PPO on the native vector environment: rows of the observation written in place, rollouts in threads, advantages, updates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from baselines.learned.checkpoint import CheckpointContent, TrainingHooks
from baselines.learned.environments import lanes_of_each
from baselines.learned.native_ppo import (
    ACTOR,
    CRITIC,
    LOG_SQRT_2_PI,
    ActorCritic,
    Batch,
    NativePPO,
    Updater,
    Workspace,
    at,
    estimate_advantages,
)
from baselines.learned.options import PHASES, DivergedError, Run, TrainingOptions
from baselines.learned.settings import Settings
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.envs.vector.lanes import Floats32, Integers
from rdpi_gym.envs.vector.task import VectorTask
from rdpi_gym.envs.wrappers.history import History
from rdpi_gym.envs.wrappers.scaling import Scaling
from rdpi_gym.envs.wrappers.side_by_side import SideBySideVectorEnv
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


class Lanes:
    """Lanes of plants whose episodes begin anew by themselves, not all at once.

    The plants are divided into parts, each run by a thread: as many as plants at most.
    """

    def __init__(
        self, options: TrainingOptions, settings: Settings, lanes: int, parts: int
    ) -> None:
        plants = options.models
        shares = lanes_of_each(plants, lanes)
        groups = [
            PiezoTrackingVectorEnv(
                share,
                max_episode_steps=options.episode,
                threads=1,
                plant=plant,
                **options.environment(),
            )
            for plant, share in zip(plants, shares, strict=True)
        ]
        self._env = SideBySideVectorEnv(groups)
        history = History(self._env.layout, settings.history)
        self.scaling = Scaling(history, settings.frequency_hz, settings.error)
        self.parts: tuple[Part, ...] = ()
        for some in np.array_split(np.arange(len(groups)), min(parts, len(groups))):
            first = self.parts[-1].end if self.parts else 0
            tasks = [groups[i].task for i in some]
            widths = [shares[i] for i in some]
            part = Part(self.scaling, tasks, widths, first, options.episode)
            self.parts = (*self.parts, part)

    @property
    def layout(self) -> ObservationLayout:
        """Observation layout of the environment."""
        return self._env.layout

    def begin(self, seed: int, rows: Floats32) -> None:
        """Begin an episode in every lane: seeded with `seed` and its number; `rows` are filled."""
        observation, _ = self._env.reset(seed=seed)
        rows[:] = _first_rows(self.scaling, observation)
        for part in self.parts:
            part.steps = 0


class Part:
    """Groups of lanes, ``first`` to ``end - 1``, that one thread steps; `steps` count since all began."""

    def __init__(
        self,
        scaling: Scaling,
        tasks: list[VectorTask],
        widths: list[int],
        first: int,
        episode: int,
    ) -> None:
        self.first, self.end, self.steps = first, first + sum(widths), 0
        self._scaling, self._episode = scaling, episode
        ends = np.cumsum(widths)
        self._groups = [
            (task, slice(int(end - width), int(end)))
            for task, width, end in zip(tasks, widths, ends, strict=True)
        ]
        layout, row = scaling.history.layout, 0
        self._reference = layout.columns["reference"].start
        # Scaling, first column of its row, and columns in an observation, of each field.
        self._fields: list[tuple[str, int, slice]] = []
        for field in layout.shown:
            columns = layout.columns[field.name]
            self._fields.append((field.scaling, row, columns))
            row += columns.stop - columns.start + scaling.history.steps
        self._past = layout.columns[layout.fields[0]].stop
        self._observed: Floats32 = np.empty((self.end - self.first, layout.size), np.float32)
        # An increment of one in a sample, and an error of one, in units of the layout's amplitude.
        self._moved = np.float32(2.0 * np.pi * scaling.frequency_hz * layout.ts_s)
        self._error = np.float32(scaling.error)

    def step(self, actions: Array, before: Floats32, after: Floats32, rewards: Floats32) -> None:
        """Take a step of every lane."""
        self.steps += 1
        for task, own in self._groups:
            shown = task.advance(actions[own])
            self._observed[own] = shown.observation.reshape(-1, self._observed.shape[1])
            rewards[own] = shown.reward
        self._write(before, after)

    def ended(self) -> Integers:
        """Return the lanes, counted within the part, whose episode is over after this step."""
        phase = ending_phase(self.steps, self._episode)
        if phase is None:
            return np.empty(0, dtype=np.int64)
        return np.arange(phase, len(self._observed), phases_of(self._episode))

    def restart(self, lanes: Integers, after: Floats32) -> None:
        """Begin new episodes in some lanes, and fill their rows."""
        for task, own in self._groups:
            inside = lanes[(lanes >= own.start) & (lanes < own.stop)]
            if len(inside):
                observation, _ = task.begin(inside - own.start, {})
                after[inside] = _first_rows(self._scaling, observation)

    def _write(self, before: Floats32, after: Floats32) -> None:
        """Write the rows that :class:`Scaling` makes: the past is that of the rows before, one on."""
        observed, steps = self._observed, self._scaling.history.steps
        if steps:
            after[:, self._past :] = before[:, self._past - 1 : -1]
        for scaling, row, columns in self._fields:
            now, end = observed[:, columns.start], row + columns.stop - columns.start
            if scaling == "error":
                np.divide(observed[:, self._reference] - now, self._error, out=after[:, row])
                continue
            after[:, row] = now
            if scaling == "value":
                continue
            if end - row > 1:  # what was ahead by one is now the newest increment of the past
                ahead = observed[:, columns.start + 1 : columns.stop]
                ahead = ahead - observed[:, columns.start : columns.stop - 1]
                np.divide(ahead, self._moved, out=after[:, row + 1 : end])
                if steps:
                    after[:, end] = before[:, row + 1]
            elif steps:
                np.divide(now - before[:, row], self._moved, out=after[:, end])


def phases_of(episode: int) -> int:
    """Groups of lanes whose episodes begin at other times: lane i is of group i modulo their number."""
    return min(PHASES, episode)


def ending_phase(steps: int, episode: int) -> int | None:
    """Return which group of lanes ends its episode with a step, counted from when all lanes began."""
    phases = phases_of(episode)
    phase, rest = divmod(steps % episode, max(1, episode // phases))
    return None if rest or phase >= phases else phase


def _first_rows(scaling: Scaling, observation: Any) -> Floats32:
    history = scaling.history
    rows: Floats32 = scaling(history.stack(observation, history.begin(observation)))
    return rows


_LEAST_SCALE = 1e-6
_TOLERANCE, _LEAST_SHARE = 1.5, 1e-3
_ROWS = 1024  # of a pass of the critic over a rollout


class NativeLearner:
    """PPO in lanes of plants, without a wrapper or autograd between environment and network."""

    kind = "NativePPO"

    def __init__(self, run: Run) -> None:
        options = run.options
        if options.tensorboard:
            raise InputError(
                f"{run.algorithm} writes no TensorBoard logs; leave --tensorboard out, training.csv has the curve"
            )
        torch.set_num_threads(1)  # what it shares among threads it divides itself
        ppo = NativePPO(**run.settings.arguments())
        count = options.lanes or run.settings.lanes
        self._lanes = Lanes(options, run.settings, count, options.threads)
        inputs = self._lanes.scaling.history.size
        widths = (inputs, *ppo.net_arch, 1)
        self.both = ActorCritic(widths, ppo.log_std_init, options.seed)
        self._updater = Updater(self.both, options.threads)
        self._generator = torch.Generator()  # of noise, and of the order of minibatches
        self._ppo, self._total = ppo, run.timesteps
        self._gamma = math.exp(-options.ts_s / ppo.horizon_s)
        self._lambda = math.exp(-options.ts_s / ppo.gae_horizon_s)
        # Mean and mean square of returns, and the weight that both have.
        self._moments = torch.zeros(3, dtype=torch.float64)
        self._share = 1.0  # of the learning rate
        self.timesteps, self.updates = 0, 0
        self._works = [Workspace(widths) for _ in range(options.threads)]
        try:
            self._rows = torch.zeros(ppo.n_steps + 1, count, inputs)
        except (RuntimeError, MemoryError) as error:
            raise InputError(
                f"a rollout of {ppo.n_steps + 1} samples of {count} lanes takes more memory than there is; "
                "take a smaller n_steps, or fewer lanes"
            ) from error
        self._actions, self._rewards = (torch.zeros(ppo.n_steps, count) for _ in range(2))

    @property
    def layout(self) -> ObservationLayout:
        """Observation layout of the environment."""
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
        self._updater.each(lambda i: self._run(i, noise, finals[i]), len(self._lanes.parts))
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

        self._updater.each(run, count)
        return values

    def actor(self) -> list[nn.Module]:
        """Return the deterministic actor."""
        return self.both.actor()

    def learn(self, timesteps: int, between: TrainingHooks) -> None:
        """Take so many steps more, whole rollouts."""
        end = self.timesteps + timesteps
        while self.timesteps < end:
            between.before_rollout()
            batch, rewards = self.rollout()
            left = 1.0 - self.timesteps / self._total
            orders = [
                torch.randperm(len(batch.rows), generator=self._generator)
                for _ in range(self._ppo.n_epochs)
            ]
            rate = self._share * at(self._ppo.learning_rate, left)
            clip = at(self._ppo.clip_range, left)
            divergence, steps = self._updater.update(batch, self._ppo, rate, clip, orders)
            self._adapt(divergence)
            between.rewarded(float(rewards.mean()))
            self.timesteps += len(batch.rows)
            self.updates += steps
            if not bool(torch.isfinite(self.both.parameters).all()):
                raise DivergedError(
                    f"the training diverged after {self.timesteps} steps: a weight is not finite; "
                    "take a lower learning_rate"
                )
        between.end()

    def tensors(self) -> Mapping[str, Any]:
        """Return the networks, the optimiser, and the moments of returns."""
        return {
            "parameters": self.both.parameters,
            "optimiser": self._updater.adam.state_dict(),
            "moments": self._moments,
            "share": torch.tensor(self._share, dtype=torch.float64),
        }

    def arrays(self) -> Mapping[str, Any]:
        """Return nothing: there is no replay buffer."""
        return {}

    def restore(self, kept: CheckpointContent) -> None:
        """Go on from what a checkpoint holds."""
        self.both.parameters.copy_(kept.tensors["parameters"])
        self._updater.adam.load_state_dict(dict(kept.tensors["optimiser"]))
        self._moments.copy_(kept.tensors["moments"])
        self._share = float(kept.tensors["share"])
        self.timesteps, self.updates = kept.timesteps, kept.updates

    def _learnt_from(
        self, rows: Tensor, actions: Tensor, rewards: Tensor, noise: Tensor,
        values: Tensor, nexts: Tensor, goes_on: Tensor,
    ) -> Batch:  # fmt: skip
        """Return what a rollout of T steps of B lanes leaves for an update."""
        mean, scale = self._scale()
        values, nexts = mean + scale * values, mean + scale * nexts
        advantages = estimate_advantages(rewards, values, nexts, goes_on, self._gamma, self._lambda)
        returns = advantages + values
        if self._ppo.normalise_returns:
            self._follow(returns)
        mean, scale = self._scale()
        densities = -0.5 * noise * noise - (self.both.log_std.double() + LOG_SQRT_2_PI)
        flat = [x.flatten() for x in (actions, densities, advantages, returns)]
        return Batch(rows.flatten(0, 1), flat[0], flat[1], flat[2], (flat[3] - mean) / scale)

    def _adapt(self, divergence: float) -> None:
        """Lower or raise the learning rate of the next update by how far this one led."""
        target = self._ppo.target_kl
        if target is None or not self._ppo.adaptive_rate:
            return
        if divergence > _TOLERANCE * target:
            self._share = max(self._share / _TOLERANCE, _LEAST_SHARE)
        elif divergence < target / _TOLERANCE:
            self._share = min(self._share * _TOLERANCE, 1.0)

    def _scale(self) -> tuple[Tensor, Tensor]:
        """Return the mean and the deviation that stand for 0 and 1 of the critic, ``float64[]``."""
        some = self._moments[2] > 0.0
        mean, square = (self._moments[:2] / self._moments[2]).unbind()
        deviation = (square - mean * mean).clamp(min=0.0).sqrt().clamp(min=_LEAST_SCALE)
        return torch.where(some, mean, 0.0), torch.where(some, deviation, 1.0)

    def _follow(self, returns: Tensor) -> None:
        """Take returns into the running moments; the critic goes on saying what it said."""
        mean, scale = self._scale()
        new = torch.stack([returns.mean(), (returns * returns).mean()]).double()
        self._moments.lerp_(torch.cat([new, torch.ones_like(new[:1])]), self._ppo.return_memory)
        to_mean, to_scale = self._scale()
        weight, bias = self.both.weights[-1][CRITIC], self.both.biases[-1][CRITIC]
        weight.mul_(scale / to_scale)
        bias.mul_(scale / to_scale).add_((mean - to_mean) / to_scale)
