"""PPO with a memory, in plain torch, in one file that is read from top to bottom.

``python examples/recurrent_ppo.py`` trains for about a minute on a CPU. No task of this package shows
the memory of its hysteresis, nor which plant was drawn. Here no stacked history makes up for that: a
gated recurrent unit (GRU) remembers what it needs. A rollout is one whole episode of every lane, so the
memory always begins empty and no sequence is cut. After CleanRL's `ppo_continuous_action.py`.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass, fields
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor, nn

import rdpi_gym  # noqa: F401  # registers the environments
from rdpi_gym.envs.wrappers.scaling import VectorScaledObservation


@dataclass(frozen=True)
class Options:
    """Options of a training; the comment under each says what it does."""

    task: str = "rdpi_gym/PiezoStage-v0"
    # Id of a registered task that has a vector environment.
    out: Path = Path("results/recurrent-ppo.pt")
    # File of the weights.
    seed: int = 0
    # Of weights, exploration, plants and references: the same seed, the same run.
    iterations: int = 50
    # Rollouts, each followed by an update.
    lanes: int = 64
    # Plants side by side.
    episode: int = 300
    # Samples of an episode, and of a rollout: 30 ms.
    hidden: int = 48
    # Numbers that are remembered.
    epochs: int = 4
    # Times that each rollout is gone through.
    minibatch: int = 16
    # Lanes of one gradient step, each with its whole episode.
    learning_rate: float = 2e-3
    # At the start; it falls linearly to 0.
    gamma: float = 0.95
    # Discount of a step: what a command does has settled after some milliseconds.
    gae_lambda: float = 0.9
    # Bias against variance of the advantages.
    clip: float = 0.2
    # How far the ratio of probabilities may leave 1.
    log_std: float = -1.5
    # Logarithm of the exploration's standard deviation at the start.


class Agent(nn.Module):
    """A GRU, and on its memory beside the observation a Gaussian actor and a critic."""

    def __init__(self, inputs: int, hidden: int, log_std: float) -> None:
        super().__init__()
        self.memory = nn.GRU(inputs, hidden)
        both = inputs + hidden
        self.actor = nn.Sequential(nn.Linear(both, 64), nn.Tanh(), nn.Linear(64, 1))
        self.critic = nn.Sequential(nn.Linear(both, 64), nn.Tanh(), nn.Linear(64, 1))
        self.log_std = nn.Parameter(torch.tensor(log_std))
        with torch.no_grad():  # it begins at rest: the mean of every action is nearly 0
            self.actor[-1].weight *= 0.01
            self.actor[-1].bias.zero_()

    def forward(self, shown: Tensor, past: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """Return mean and value, each ``(K, B)``, of observations ``(K, B, D)``, and the memory."""
        remembered, past = self.memory(shown, past)
        known = torch.cat([shown, remembered], dim=-1)
        return self.actor(known)[..., 0], self.critic(known)[..., 0], past

    def log_density(self, actions: Tensor, mean: Tensor) -> Tensor:
        """Return the logarithm of the density of actions about their mean."""
        away = (actions - mean) / self.log_std.exp()
        return -0.5 * away**2 - self.log_std - 0.5 * math.log(2.0 * math.pi)


@dataclass(frozen=True)
class Rollout:
    """One episode of every lane, sample by lane; observations have one sample more."""

    shown: Tensor
    actions: Tensor
    logarithms: Tensor
    values: Tensor
    rewards: Tensor
    rmse_um: float


def roll_out(env: VectorScaledObservation, agent: Agent, steps: int, seed: int | None) -> Rollout:
    """Let the agent drive one episode in all lanes."""
    observation, _ = env.reset(seed=seed)
    shown, actions, logarithms, values, rewards, squares = [], [], [], [], [], []
    past = None
    with torch.no_grad():
        for _ in range(steps):
            shown.append(torch.from_numpy(observation))
            mean, value, past = agent(shown[-1][None], past)
            action = mean + agent.log_std.exp() * torch.randn_like(mean)
            # The environment clips actions to [-1, 1]; the agent learns from what it drew.
            observation, reward, _, _, infos = env.step(action[0, :, None].numpy())
            actions.append(action[0])
            logarithms.append(agent.log_density(action, mean)[0])
            values.append(value[0])
            rewards.append(torch.from_numpy(reward.astype(np.float32)))
            squares.append(infos["error_um"] ** 2)
        # An episode that is cut off is not at its end: the critic says what would have come.
        shown.append(torch.from_numpy(observation))
        values.append(agent(shown[-1][None], past)[1][0])
    parts = map(torch.stack, (shown, actions, logarithms, values, rewards))
    return Rollout(*parts, rmse_um=float(np.sqrt(np.mean(squares))))


def advantages_of(rollout: Rollout, gamma: float, gae_lambda: float) -> Tensor:
    """Return the generalised advantage estimates, backwards through the episode."""
    advantages = torch.empty_like(rollout.rewards)
    ahead = torch.zeros_like(rollout.rewards[0])
    for k in reversed(range(len(advantages))):
        surprise = rollout.rewards[k] + gamma * rollout.values[k + 1] - rollout.values[k]
        ahead = surprise + gamma * gae_lambda * ahead
        advantages[k] = ahead
    return advantages


def update(
    agent: Agent, optimiser: torch.optim.Optimizer, options: Options, rollout: Rollout
) -> float:
    """Go through a rollout several times; return the mean change of the actions' log density."""
    advantages = advantages_of(rollout, options.gamma, options.gae_lambda)
    returns = advantages + rollout.values[:-1]
    scaled = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    changes = []
    for _ in range(options.epochs):
        # Whole sequences: the memory is run through an episode again, with its gradient.
        for lanes in torch.randperm(options.lanes).split(options.minibatch):
            mean, value, _ = agent(rollout.shown[:-1, lanes])
            density = agent.log_density(rollout.actions[:, lanes], mean)
            change = density - rollout.logarithms[:, lanes]
            ratio, gain = change.exp(), scaled[:, lanes]
            clipped = ratio.clamp(1.0 - options.clip, 1.0 + options.clip)
            policy_loss = -torch.minimum(ratio * gain, clipped * gain).mean()
            value_loss = 0.5 * ((value - returns[:, lanes]) ** 2).mean()
            optimiser.zero_grad()
            (policy_loss + 0.5 * value_loss).backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
            optimiser.step()
            changes.append(float(change.detach().abs().mean()))
    return float(np.mean(changes))


def train(options: Options) -> list[dict[str, float]]:
    """Train, write the weights, and return a row for each iteration."""
    torch.manual_seed(options.seed)
    torch.set_num_threads(1)  # a network this small only loses by more
    env = VectorScaledObservation(
        gym.make_vec(
            options.task,
            num_envs=options.lanes,
            vectorization_mode="vector_entry_point",
            autoreset_mode=AutoresetMode.DISABLED,
            max_episode_steps=options.episode,
            history=0,
            action="increment",
            smooth_start_s=0.005,
            command_cost=0.5,
        )
    )
    (size,) = env.single_observation_space.shape
    agent = Agent(size, options.hidden, options.log_std)
    optimiser = torch.optim.Adam(agent.parameters(), lr=options.learning_rate, eps=1e-5)
    begun, rows = time.perf_counter(), []
    for i in range(options.iterations):
        optimiser.param_groups[0]["lr"] = options.learning_rate * (1.0 - i / options.iterations)
        rollout = roll_out(env, agent, options.episode, options.seed if i == 0 else None)
        change = update(agent, optimiser, options, rollout)
        rows.append(
            {
                "steps": (i + 1) * options.lanes * options.episode,
                "reward": float(rollout.rewards.mean()),
                "rmse_um": rollout.rmse_um,
                "log_density_change": change,
                "seconds": time.perf_counter() - begun,
            }
        )
        print("  ".join(f"{name} {value:.4g}" for name, value in rows[-1].items()), flush=True)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    torch.save(agent.state_dict(), options.out)
    return rows


def parse(words: list[str] | None = None) -> Options:
    """Read options from a command line: every field by its name."""
    parser = argparse.ArgumentParser(description="PPO with a memory, in plain torch.")
    for field in fields(Options):
        name = "--" + field.name.replace("_", "-")
        parser.add_argument(name, type=type(field.default), default=field.default)
    return Options(**vars(parser.parse_args(words)))


if __name__ == "__main__":
    train(parse())
