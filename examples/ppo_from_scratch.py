"""PPO in plain torch, in one file that is read from top to bottom.

``python examples/ppo_from_scratch.py --total-steps 1000000`` trains a policy and saves it as every
other of this package: ``rdpi bench --controller learned:DIR/policy``. To train for a result take
``rdpi train native-ppo``, which evaluates on held-out plants and continues after an interruption;
this file is to read, and to change. After CleanRL's ``ppo_continuous_action.py``.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor, nn

import rdpi_gym  # noqa: F401  # registers the environments
from baselines.learned.policy import Network, Policy
from rdpi_gym.envs.wrappers.history import VectorHistoryObservation, layout_of
from rdpi_gym.envs.wrappers.scaling import VectorScaledObservation
from rdpi_gym.support.errors import InputError

COLUMNS = ("steps", "reward", "rmse_um", "policy_loss", "value_loss", "approximate_kl")
"""Columns of ``training.csv``, one row an iteration: means over its steps or minibatches."""


@dataclass(frozen=True)
class Options:
    """Options of a training; the comment under each says what it does."""

    out: Path = Path("results/ppo-from-scratch")
    # Folder of the policy and the learning curve.
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
    # Earlier samples in an observation.
    hidden: int = 64
    # Width of the two hidden layers.
    rollout: int = 128
    # Steps of each lane between two updates.
    epochs: int = 5
    # Passes over each rollout.
    minibatch: int = 512
    # Samples of one gradient step.
    learning_rate: float = 1e-3
    # At the start; it falls linearly to 0.
    gamma: float = 0.95
    # Discount of a step: the response to a command has settled after some milliseconds.
    gae_lambda: float = 0.9
    # Bias against variance of the advantages.
    clip: float = 0.2
    # Largest change of the probability ratio.
    log_std: float = -1.5
    # Logarithm of the exploration's standard deviation at the start.


class Agent(nn.Module):
    """A Gaussian about the actor's answer, and a critic."""

    def __init__(self, inputs: int, hidden: int, log_std: float) -> None:
        super().__init__()
        self.actor = Network((inputs, hidden, hidden, 1), "Tanh", "Hardtanh").build()
        *layers, _ = Network((inputs, hidden, hidden, 1), "Tanh", "Hardtanh").build()
        self.critic = nn.Sequential(*layers)
        self.log_std = nn.Parameter(torch.tensor([log_std]))
        for network, last in ((self.actor, 0.01), (self.critic, 1.0)):
            linear = [module for module in network if isinstance(module, nn.Linear)]
            for layer in linear:
                nn.init.orthogonal_(layer.weight, last if layer is linear[-1] else math.sqrt(2.0))
                nn.init.zeros_(layer.bias)

    def policy(self, observation: Tensor) -> torch.distributions.Normal:
        """Return the distribution of actions ``(B, 1)``, not yet clipped to [-1, 1]."""
        mean, deviation = self.actor[:-1](observation), self.log_std.exp()
        return torch.distributions.Normal(mean, deviation, validate_args=False)

    def value(self, observation: Tensor) -> Tensor:
        """Return the critic's estimate ``(B,)`` of the return."""
        estimate: Tensor = self.critic(observation)[..., 0]
        return estimate


def train(options: Options) -> Path:
    """Train, and write ``policy`` and ``training.csv``."""
    for name in ("lanes", "episode", "hidden", "rollout", "epochs", "minibatch"):
        if getattr(options, name) < 1:
            raise InputError(f"{name} is {getattr(options, name)}; give a whole number above 0")
    if not 0 <= options.seed < 2**32:
        raise InputError(f"seed is {options.seed}; give a whole number of 0 to 2^32 - 1")
    iterations = options.total_steps // (options.lanes * options.rollout)
    if iterations < 1:
        least = options.lanes * options.rollout
        raise InputError(f"total_steps is {options.total_steps}; one rollout takes {least}")
    torch.manual_seed(options.seed)
    torch.set_num_threads(1)  # networks this small gain nothing from more
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
    curve = [",".join(COLUMNS)]

    # The arrays of a rollout.
    observations = torch.empty(steps, lanes, size)
    actions = torch.empty(steps, lanes, 1)
    densities, rewards, values, nexts, over = (torch.empty(steps, lanes) for _ in range(5))

    first, _ = env.reset(seed=options.seed)
    observation = torch.from_numpy(first)
    for iteration in range(iterations):
        optimiser.param_groups[0]["lr"] = options.learning_rate * (1.0 - iteration / iterations)

        # Rollout: the agent acts in all lanes.
        squared_um2 = 0.0
        for k in range(steps):
            with torch.no_grad():
                policy = agent.policy(observation)
                actions[k] = policy.sample()
                densities[k] = policy.log_prob(actions[k])[:, 0]
                values[k] = agent.value(observation)
            observations[k] = observation
            # The environment clips actions to [-1, 1]; the agent learns from what it drew.
            following, reward, _, truncated, infos = env.step(actions[k].numpy())
            observation = torch.from_numpy(following)
            rewards[k], over[k] = torch.from_numpy(reward), torch.from_numpy(truncated)
            ends = last_observations(following, truncated, infos)
            with torch.no_grad():
                nexts[k] = agent.value(torch.from_numpy(ends))
            squared_um2 += float(np.mean(infos["error_um"] ** 2))
        advantages = advantages_of(options, rewards, values, nexts, over)

        # Gradient steps on minibatches.
        batch = [
            x.flatten(0, 1) for x in (observations, actions, densities, advantages, advantages + values)
        ]  # fmt: skip
        losses = []
        for _ in range(options.epochs):
            for chosen in torch.randperm(steps * lanes).split(options.minibatch):
                losses.append(update(agent, optimiser, options.clip, [x[chosen] for x in batch]))
        row = [float(rewards.mean()), math.sqrt(squared_um2 / steps), *np.mean(losses, axis=0)]
        weights = nn.utils.parameters_to_vector(agent.parameters())
        if not (np.isfinite(row).all() and torch.isfinite(weights).all()):
            raise InputError(f"diverged in iteration {iteration + 1}; take a lower learning_rate")
        curve.append(",".join(map(str, [(iteration + 1) * steps * lanes, *map(float, row)])))

    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "training.csv").write_text("\n".join(curve) + "\n")
    return Policy(
        layout_of(env),
        history=options.history,
        frequency_hz=env.scaling.frequency_hz,
        error=env.scaling.error,
        actor=agent.actor,
        baseline=options.baseline,
        training={**asdict(options), "out": str(options.out), "algorithm": "ppo_from_scratch"},
    ).save(options.out / "policy")


def last_observations(
    following: np.ndarray[Any, Any], truncated: np.ndarray[Any, Any], infos: dict[str, Any]
) -> np.ndarray[Any, Any]:
    """Return the observations at the end of a step: a truncated lane already shows its next episode."""
    ends = following.copy()
    for lane in np.flatnonzero(truncated):
        ends[lane] = infos["final_obs"][lane]
    return ends


def advantages_of(
    options: Options, rewards: Tensor, values: Tensor, nexts: Tensor, over: Tensor
) -> Tensor:
    """Return generalised advantage estimates ``(steps, lanes)``.

    A truncated episode is not at its end: the critic's value of its last observation stands for the
    rewards that would have come.
    """
    advantages, ahead = torch.empty_like(rewards), torch.zeros_like(rewards[0])
    for k in reversed(range(len(rewards))):
        surprise = rewards[k] + options.gamma * nexts[k] - values[k]
        ahead = surprise + options.gamma * options.gae_lambda * (1.0 - over[k]) * ahead
        advantages[k] = ahead
    return advantages


def update(
    agent: Agent, optimiser: torch.optim.Optimizer, clip: float, batch: list[Tensor]
) -> list[float]:
    """Make one gradient step; return policy loss, value loss and approximate KL divergence."""
    observations, actions, before, advantages, returns = batch
    change = agent.policy(observations).log_prob(actions)[:, 0] - before
    ratio = change.exp()
    advantages = (advantages - advantages.mean()) / (advantages.std(correction=0) + 1e-8)
    clipped = ratio.clamp(1.0 - clip, 1.0 + clip)
    policy_loss = -torch.minimum(ratio * advantages, clipped * advantages).mean()
    value_loss = 0.5 * ((agent.value(observations) - returns) ** 2).mean()
    optimiser.zero_grad()
    torch.autograd.backward(policy_loss + 0.5 * value_loss)
    nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
    optimiser.step()
    kl = ((ratio - 1.0) - change).mean()
    return [float(x.detach()) for x in (policy_loss, value_loss, kl)]


def parse(words: list[str] | None = None) -> Options:
    """Read options from a command line: every field by its name."""
    parser = argparse.ArgumentParser(prog="ppo_from_scratch", description="PPO in plain torch.")
    for field in fields(Options):
        name = "--" + field.name.replace("_", "-")
        parser.add_argument(name, type=type(field.default), default=field.default)
    return Options(**vars(parser.parse_args(words)))


if __name__ == "__main__":
    try:
        print(train(parse()))
    except InputError as error:
        raise SystemExit(f"error: {error}") from None
