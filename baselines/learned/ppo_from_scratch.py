"""PPO in plain torch, in one file that is read from top to bottom.

``python -m baselines.learned.ppo_from_scratch --total-steps 1000000`` trains a policy and saves it
as every other of this package: ``rdpi bench --controller learned:DIR/policy``. To train for a
result take ``rdpi train ppo``, which evaluates on held-out plants and goes on after an
interruption; this file is to read, and to change. After CleanRL's ``ppo_continuous_action.py``.
"""

from __future__ import annotations

import argparse
import csv
import io
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor, nn

from baselines.learned.network import Network
from baselines.learned.policy import Policy
from rdpi_gym.envs.wrappers.history import VectorHistoryObservation, layout_of
from rdpi_gym.envs.wrappers.scaling import VectorScaledObservation
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic

COLUMNS = ("steps", "reward", "rmse_um", "policy_loss", "value_loss", "entropy", "approximate_kl")
"""Of ``training.csv``, one row an iteration: means over its steps or minibatches."""


@dataclass(frozen=True)
class Options:
    """Options of a training; the comment under each says what it does.

    Raises
    ------
    InputError
        A count that is below 1, a seed below 0, or fewer steps than one iteration takes.
    """

    out: Path = Path("results/ppo-from-scratch")
    # Folder that the policy and the learning curve are written to.
    seed: int = 0
    # Of weights, exploration, plants and references: the same seed, the same run.
    total_steps: int = 1_000_000
    # Steps of all lanes together.
    lanes: int = 64
    # Plants side by side.
    plant: str = "P10"
    # Nominal truth: a name, or the path of a JSON file.
    baseline: str = "classical-reference-rate"
    # Compensator that the agent corrects.
    randomise: float = 0.1
    # Relative half-width of the parameters of the plant, drawn for each episode.
    episode: int = 500
    # Samples of an episode.
    history: int = 8
    # Earlier samples that the agent is shown.
    hidden: int = 64
    # Width of the two hidden layers.
    rollout: int = 128
    # Steps of each lane between two updates.
    epochs: int = 5
    # Times that each rollout is gone through.
    minibatch: int = 512
    # Samples of one gradient step.
    learning_rate: float = 1e-3
    # At the start; it falls linearly to 0.
    gamma: float = 0.95
    # Discount of a step: what a command does has settled after some milliseconds.
    gae_lambda: float = 0.9
    # Bias against variance of the advantages.
    clip: float = 0.2
    # How far the ratio of probabilities may leave 1.
    entropy_cost: float = 0.0
    # Weight of the entropy in the loss.
    value_cost: float = 0.5
    # Weight of the critic's error in the loss.
    largest_gradient: float = 0.5
    # Norm that gradients are clipped to.
    log_std: float = -1.5
    # Logarithm of the exploration's standard deviation at the start.
    threads: int = 1
    # Threads of torch. Networks this small gain nothing from more.

    def __post_init__(self) -> None:
        for name in ("lanes", "episode", "hidden", "rollout", "epochs", "minibatch", "threads"):
            if getattr(self, name) < 1:
                raise InputError(f"{name} is {getattr(self, name)}; give a whole number above 0")
        if not 0 <= self.seed < 2**32:
            raise InputError(f"seed is {self.seed}; give a whole number of 0 to 2^32 - 1")
        if self.total_steps < self.lanes * self.rollout:
            raise InputError(
                f"total_steps is {self.total_steps}, fewer than one rollout of {self.rollout} "
                f"steps of {self.lanes} lanes; give {self.lanes * self.rollout} or more"
            )


class Agent(nn.Module):
    """A Gaussian about the actor's answer, and a critic."""

    def __init__(self, inputs: int, hidden: int, log_std: float) -> None:
        super().__init__()
        self.actor = Network((inputs, hidden, hidden, 1), "Tanh", "Hardtanh").build()
        self.critic = nn.Sequential(
            nn.Linear(inputs, hidden), nn.Tanh(), nn.Linear(hidden, hidden), nn.Tanh(),
            nn.Linear(hidden, 1),
        )  # fmt: skip
        self.log_std = nn.Parameter(torch.tensor([log_std]))
        for network, last in ((self.actor, 0.01), (self.critic, 1.0)):
            layers = [module for module in network if isinstance(module, nn.Linear)]
            for layer in layers:
                nn.init.orthogonal_(layer.weight, last if layer is layers[-1] else math.sqrt(2.0))
                nn.init.zeros_(layer.bias)

    def mean(self, shown: Tensor) -> Tensor:
        """Return the mean ``(B, 1)`` of actions, not yet clipped to [-1, 1]."""
        mean: Tensor = self.actor[:-1](shown)
        return mean

    def log_density(self, actions: Tensor, mean: Tensor) -> Tensor:
        """Return the logarithm ``(B,)`` of the density of actions ``(B, 1)`` about their mean."""
        away = (actions - mean) / self.log_std.exp()
        return (-0.5 * away**2 - self.log_std - 0.5 * math.log(2.0 * math.pi))[:, 0]

    def entropy(self) -> Tensor:
        """Return the entropy of an action, the same for every observation."""
        return self.log_std[0] + 0.5 * math.log(2.0 * math.pi * math.e)

    def value(self, shown: Tensor) -> Tensor:
        """Return the critic's estimate ``(B,)`` of what is to come."""
        estimate: Tensor = self.critic(shown)[..., 0]
        return estimate


def train(options: Options) -> Path:
    """Train, and write ``policy`` and ``training.csv``."""
    # One seed for everything that torch draws; the plants have the environment's.
    torch.manual_seed(options.seed)
    torch.set_num_threads(options.threads)
    lanes, steps = options.lanes, options.rollout
    env = VectorScaledObservation(
        VectorHistoryObservation(
            gym.make_vec(
                "rdpi_gym/PiezoTracking-v0",
                num_envs=lanes,
                vectorization_mode="vector_entry_point",
                autoreset_mode=AutoresetMode.SAME_STEP,
                max_episode_steps=options.episode,
                plant=options.plant,
                randomise=options.randomise,
                action="correction",
                baseline=options.baseline,
            ),
            options.history,
        )
    )
    assert env.single_observation_space.shape is not None
    (size,) = env.single_observation_space.shape
    agent = Agent(size, options.hidden, options.log_std)
    optimiser = torch.optim.Adam(agent.parameters(), lr=options.learning_rate, eps=1e-5)
    iterations = options.total_steps // (lanes * steps)
    curve: list[dict[str, float]] = []

    # What a rollout holds.
    shown = torch.empty(steps, lanes, size)
    actions = torch.empty(steps, lanes, 1)
    logarithms, rewards, values, nexts, over = (torch.empty(steps, lanes) for _ in range(5))

    first, _ = env.reset(seed=options.seed)
    observation = torch.from_numpy(first)
    for iteration in range(iterations):
        optimiser.param_groups[0]["lr"] = options.learning_rate * (1.0 - iteration / iterations)

        # Let the agent run in all lanes.
        squared_um2 = 0.0
        for k in range(steps):
            with torch.no_grad():
                mean = agent.mean(observation)
                actions[k] = mean + agent.log_std.exp() * torch.randn(lanes, 1)
                logarithms[k] = agent.log_density(actions[k], mean)
                values[k] = agent.value(observation)
            shown[k] = observation
            # The environment clips actions to [-1, 1]; the agent learns from what it drew.
            following, reward, _, truncated, infos = env.step(actions[k].numpy())
            observation = torch.from_numpy(following)
            rewards[k] = torch.from_numpy(reward)
            over[k] = torch.from_numpy(truncated)
            ends = last_observations(following, truncated, infos)
            with torch.no_grad():
                nexts[k] = agent.value(torch.from_numpy(ends))
            squared_um2 += float(np.mean(infos["error_um"] ** 2))

        # Generalised advantage estimation, backwards. A truncated episode is not at its end: the
        # critic's value of its last observation stands for what would have come.
        advantages = torch.empty(steps, lanes)
        ahead = torch.zeros(lanes)
        for k in reversed(range(steps)):
            surprise = rewards[k] + options.gamma * nexts[k] - values[k]
            ahead = surprise + options.gamma * options.gae_lambda * (1.0 - over[k]) * ahead
            advantages[k] = ahead
        returns = advantages + values

        # Gradient steps on minibatches, each sample several times.
        batch = [x.flatten(0, 1) for x in (shown, actions, logarithms, advantages, returns)]
        losses = []
        for _ in range(options.epochs):
            order = torch.randperm(steps * lanes)
            for start in range(0, steps * lanes, options.minibatch):
                chosen = order[start : start + options.minibatch]
                part = [array[chosen] for array in batch]
                losses.append(update(agent, optimiser, options, part))

        row = [float(rewards.mean()), math.sqrt(squared_um2 / steps), *np.mean(losses, axis=0)]
        if not np.isfinite(row).all():
            raise InputError(
                f"the training diverged in iteration {iteration + 1}; take a lower learning_rate"
            )
        done = (iteration + 1) * steps * lanes
        curve.append(dict(zip(COLUMNS, (done, *map(float, row)), strict=True)))

    policy = Policy(
        layout_of(env),
        history=options.history,
        frequency_hz=env.scaling.frequency_hz,
        error=env.scaling.error,
        actor=agent.actor,
        baseline=options.baseline,
        training={**asdict(options), "out": str(options.out), "algorithm": "ppo_from_scratch"},
    )
    folder = policy.save(options.out / "policy")
    table = io.StringIO()
    writer = csv.DictWriter(table, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(curve)
    write_atomic(options.out / "training.csv", table.getvalue())
    return folder


def last_observations(
    following: np.ndarray[Any, Any], truncated: np.ndarray[Any, Any], infos: dict[str, Any]
) -> np.ndarray[Any, Any]:
    """Return what each lane showed at the end of the step, before a new episode began in it."""
    ends = following.copy()
    for lane in np.flatnonzero(truncated):
        ends[lane] = infos["final_obs"][lane]
    return ends


def update(
    agent: Agent, optimiser: torch.optim.Optimizer, options: Options, batch: list[Tensor]
) -> list[float]:
    """Make one gradient step; return policy loss, value loss, entropy and approximate KL."""
    shown, actions, before, advantages, returns = batch
    change = agent.log_density(actions, agent.mean(shown)) - before
    ratio = change.exp()
    if len(advantages) > 1:
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    clipped = ratio.clamp(1.0 - options.clip, 1.0 + options.clip)
    policy_loss = -torch.minimum(ratio * advantages, clipped * advantages).mean()
    value_loss = 0.5 * ((agent.value(shown) - returns) ** 2).mean()
    entropy = agent.entropy()
    loss = policy_loss + options.value_cost * value_loss - options.entropy_cost * entropy
    optimiser.zero_grad()
    torch.autograd.backward(loss)
    nn.utils.clip_grad_norm_(agent.parameters(), options.largest_gradient)
    optimiser.step()
    kl = ((ratio - 1.0) - change).mean()
    return [float(x.detach()) for x in (policy_loss, value_loss, entropy, kl)]


def parse(words: list[str] | None = None) -> Options:
    """Read options from a command line: every field by its name."""
    parser = argparse.ArgumentParser(prog="ppo_from_scratch", description="PPO in plain torch.")
    for field in fields(Options):
        name = "--" + field.name.replace("_", "-")
        parser.add_argument(name, type=type(field.default), default=field.default)
    return Options(**vars(parser.parse_args(words)))


if __name__ == "__main__":
    print(train(parse()))
