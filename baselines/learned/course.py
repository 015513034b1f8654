"""The course of a training: evaluations, checkpoints, and how an interrupted one goes on exactly.

A training is cut into stretches. At the start of each, every generator (exploration, plants,
references, noise) is seeded from the run's seed and the stretch's number, and all lanes begin an
episode. So a checkpoint between two stretches needs no generator and no state of a plant, and the
run that goes on from it is, bit by bit, the one that was not interrupted.
"""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from torch import nn

from baselines import make_controller
from baselines.learned.checkpoint import save_checkpoint
from baselines.learned.controller import LearnedController
from baselines.learned.evaluation import Evaluation, HeldOut
from baselines.learned.policy import Policy
from baselines.learned.run import CHECKPOINT, CURVE, POLICY, Run
from rdpi_gym.envs.wrappers.history import layout_of
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.progress import Progress

COLUMNS = (
    "timesteps", "seconds", "training_reward", "reward", "rmse_um", "rmse_percent",
    "command_variation_V_s", "compensator_rmse_um", "compensator_rmse_percent",
    "compensator_command_variation_V_s",
)  # fmt: skip
"""Of ``training.csv``: all but the second and third are of the held-out plants."""

_COMPARED = ("rmse_um", "rmse_percent", "command_variation_V_s")

ActorOf = Callable[[Any], list[nn.Module]]
Row = dict[str, float | None]


class Course(BaseCallback):  # type: ignore[misc]  # the library carries no types here
    """Between two stretches of a training: evaluates, keeps the best policy and a checkpoint.

    Parameters
    ----------
    run
        The training.
    actor_of, progress
        As :func:`baselines.learned.training.learn`.
    """

    def __init__(self, run: Run, actor_of: ActorOf, progress: Progress | None) -> None:
        super().__init__()
        self.run, self.actor_of, self.progress = run, actor_of, progress
        self.rows: list[Row] = []
        self._stretch, self._seeded = -1, False
        self._rewards: list[float] = []
        self._before_s, self._began = 0.0, time.perf_counter()
        self._held_out = HeldOut(run.options)
        name = run.options.baseline
        self._compensator = self._held_out.evaluate(partial(make_controller, name))

    def resume(self, kept: dict[str, Any]) -> None:
        """Go on from what a checkpoint kept."""
        self.rows, self._stretch = kept["rows"], kept["stretch"]
        self._before_s = kept["seconds"]

    def _on_rollout_start(self) -> None:
        if self.progress is not None:
            self.progress("training", self.num_timesteps, self.run.timesteps)
        stretch = self.model.num_timesteps // self.run.every
        if stretch > self._stretch:
            self._stretch = stretch
            self._keep()
            self._seed()
        elif not self._seeded:  # the first stretch after an interruption
            self._seed()
        self._seeded = True

    def _on_step(self) -> bool:
        self._rewards.append(float(np.mean(self.locals["rewards"])))
        return True

    def _on_training_end(self) -> None:
        self._keep(finished=True)
        if self.progress is not None:
            self.progress("training", self.run.timesteps, self.run.timesteps)

    def _seed(self) -> None:
        model = self.model
        entropy = [self.run.options.seed, self._stretch]
        model.set_random_seed(int(np.random.SeedSequence(entropy).generate_state(1)[0]))
        model._last_obs = model.env.reset()
        model._last_episode_starts = np.ones(model.n_envs, dtype=bool)
        if model.use_sde:  # its noise was drawn just before
            getattr(model, "actor", model.policy).reset_noise(model.n_envs)

    def _keep(self, finished: bool = False) -> None:
        """Evaluate, and write what a reader and a later run find: policy, curve, checkpoint."""
        policy = self._policy()
        found = self._held_out.evaluate(partial(LearnedController, policy))
        best = max((row["reward"] or 0.0 for row in self.rows), default=-np.inf)
        seconds = self._before_s + time.perf_counter() - self._began
        row = self._row(found, seconds)
        self.rows.append(row)
        self._rewards = []
        out = self.run.options.out
        if found.reward > best:
            replace(policy, training=self._story(row)).save(out / POLICY)
        write_atomic(out / CURVE, _csv(self.rows))
        progress = {"rows": self.rows, "stretch": self._stretch, "seconds": seconds}
        save_checkpoint(out / CHECKPOINT, self.model, progress, finished)
        for name, value in asdict(found).items():
            self.logger.record(f"held_out/{name}", value)

    def _policy(self) -> Policy:
        env, settings = self.model.env.unwrapped.vector_env, self.run.settings
        layout, options = layout_of(env), self.run.options
        return Policy(
            layout=layout,
            history=settings.history,
            frequency_hz=settings.frequency_hz,
            error=settings.error,
            actor=nn.Sequential(*self.actor_of(self.model)),
            baseline=options.baseline if layout.action == "correction" else None,
        )

    def _row(self, found: Evaluation, seconds: float) -> Row:
        row: Row = {
            "timesteps": self.model.num_timesteps,
            "seconds": round(seconds, 3),
            "training_reward": float(np.mean(self._rewards)) if self._rewards else None,
            **asdict(found),
        }
        compensator = asdict(self._compensator)
        return row | {f"compensator_{name}": compensator[name] for name in _COMPARED}

    def _story(self, row: Row) -> dict[str, Any]:
        """What a policy says of how it came about."""
        return {
            "algorithm": self.run.algorithm,
            "seed": self.run.options.seed,
            "plants": [model.name for model in self.run.options.models],
            **{name: row[name] for name in ("timesteps", "rmse_um", "command_variation_V_s")},
        }


def _csv(rows: list[Row]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
