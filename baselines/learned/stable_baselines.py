"""Algorithms of Stable-Baselines3 as learners."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from torch import nn

from baselines.learned.checkpoint import CheckpointContent, TrainingHooks
from baselines.learned.environments import make_lanes
from baselines.learned.options import DivergedError, Run
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.wrappers.history import VectorHistoryObservation, layout_of
from rdpi_gym.envs.wrappers.scaling import VectorScaledObservation
from rdpi_gym.envs.wrappers.stable_baselines import StableBaselinesVecEnv
from rdpi_gym.support.errors import InputError

_REPLAYED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
_DIVERGED = 1e6

ALGORITHMS: Mapping[str, type[BaseAlgorithm]] = {"ppo": PPO, "sac": SAC, "td3": TD3}
_ACTORS: Mapping[str, Callable[[Any], list[nn.Module]]] = {
    "ppo": lambda model: [
        *model.policy.mlp_extractor.policy_net, model.policy.action_net, nn.Hardtanh(),
    ],
    "sac": lambda model: [*model.actor.latent_pi, model.actor.mu, nn.Tanh()],
    "td3": lambda model: list(model.actor.mu),
}  # fmt: skip
"""Deterministic actors: the mean of PPO's Gaussian, clipped as actions are; that of SAC's, squashed."""


class StableBaselinesLearner:
    """An algorithm of :data:`ALGORITHMS` in lanes of plants: observations with history, scaled."""

    def __init__(self, run: Run) -> None:
        options, settings = run.options, run.settings
        self._name, self._logged_each = run.algorithm, 1 if run.algorithm == "ppo" else 100
        lanes = make_lanes(
            options.models, options.lanes or settings.lanes, options.episode,
            **options.environment(),
        )  # fmt: skip
        stacked = VectorHistoryObservation(lanes, settings.history)
        scaled = VectorScaledObservation(stacked, settings.frequency_hz, settings.error)
        self.env = StableBaselinesVecEnv(scaled)
        torch.set_num_threads(options.threads)
        logs = str(options.out / "tensorboard") if options.tensorboard else None
        arguments = {"policy": "MlpPolicy", **settings.arguments()}
        try:
            self.model: Any = ALGORITHMS[run.algorithm](
                env=self.env, seed=options.seed, device="cpu", tensorboard_log=logs, **arguments
            )
        except (AssertionError, TypeError, ValueError, MemoryError, RuntimeError) as error:
            reason = " ".join(str(error).split())[:200]
            raise InputError(
                f"{ALGORITHMS[run.algorithm].__name__} refuses its hyper-parameters: {reason}"
            ) from error

    @property
    def kind(self) -> str:
        """Name of the algorithm's class."""
        return type(self.model).__name__

    @property
    def timesteps(self) -> int:
        """Steps of all lanes together so far."""
        return int(self.model.num_timesteps)

    @property
    def updates(self) -> int:
        """Updates made so far."""
        return int(self.model._n_updates)

    @property
    def layout(self) -> ObservationLayout:
        """Observation layout of the environment."""
        return layout_of(self.env.vector_env)

    def actor(self) -> list[nn.Module]:
        """Return the deterministic actor."""
        return _ACTORS[self._name](self.model)

    def begin(self, seed: int) -> None:
        """Seed every generator, and begin an episode in all lanes."""
        model = self.model
        model.set_random_seed(seed)
        model._last_obs = model.env.reset()
        model._last_episode_starts = np.ones(model.n_envs, dtype=bool)
        if model.use_sde:  # its noise was drawn just before
            getattr(model, "actor", model.policy).reset_noise(model.n_envs)

    def learn(self, timesteps: int, between: TrainingHooks) -> None:
        """Take so many steps more."""
        try:
            self.model.learn(
                timesteps,
                callback=_Callback(between),
                reset_num_timesteps=False,
                tb_log_name=self._name,
                log_interval=self._logged_each,
            )
        except (ValueError, RuntimeError) as error:
            weights = nn.utils.parameters_to_vector(self.model.policy.parameters())
            largest = float(weights.detach().abs().max())  # NaN where one is
            rate = float(self.model.lr_schedule(self.model._current_progress_remaining))
            if largest < _DIVERGED and rate < _DIVERGED:  # torch refuses a step beyond its floats
                raise
            reason = (
                f"learning_rate is {rate:.3g}"
                if largest < _DIVERGED
                else f"a weight is {largest:.3g}"
            )
            raise DivergedError(
                f"the training diverged after {self.timesteps} steps: {reason}; take a lower learning_rate"
            ) from error

    def tensors(self) -> Mapping[str, Any]:
        """Return the networks, the optimisers, and parameters that belong to no network."""
        variables = {name: getattr(self.model, name).data for name in self._variables()}
        return {"parameters": self.model.get_parameters(), "variables": variables}

    def arrays(self) -> Mapping[str, Any]:
        """Return the replay buffer; nothing where the algorithm has none."""
        if not isinstance(self.model, OffPolicyAlgorithm):
            return {}
        buffer: Any = self.model.replay_buffer
        filled = buffer.buffer_size if buffer.full else buffer.pos
        arrays = {name: getattr(buffer, name)[:filled] for name in _REPLAYED}
        return arrays | {"position": buffer.pos, "full": buffer.full}

    def restore(self, kept: CheckpointContent) -> None:
        """Go on from what a checkpoint holds."""
        model = self.model
        model.set_parameters(kept.tensors["parameters"], exact_match=True, device=model.device)
        for name in self._variables():
            getattr(model, name).data = kept.tensors["variables"][name]
        if isinstance(model, OffPolicyAlgorithm) and kept.read is not None:
            buffer: Any = model.replay_buffer
            for name in _REPLAYED:
                array = kept.read(name)
                getattr(buffer, name)[: len(array)] = array
            buffer.pos, buffer.full = int(kept.read("position")), bool(kept.read("full"))
        model.num_timesteps, model._n_updates = kept.timesteps, kept.updates

    def _variables(self) -> list[str]:
        """Name the parameters that belong to no network: SAC's entropy coefficient."""
        return [name for name in ("log_ent_coef",) if getattr(self.model, name, None) is not None]


class _Callback(BaseCallback):  # type: ignore[misc]  # the library carries no types here
    """Passes the course of a training on to its hooks."""

    def __init__(self, between: TrainingHooks) -> None:
        super().__init__()
        self._between = between

    def _on_rollout_start(self) -> None:
        self._log(self._between.before_rollout())

    def _on_step(self) -> bool:
        self._between.rewarded(float(np.mean(self.locals["rewards"])))
        return True

    def _on_training_end(self) -> None:
        self._log(self._between.end())

    def _log(self, found: Mapping[str, float]) -> None:
        for name, value in found.items():
            self.logger.record(f"held_out/{name}", value)
