"""The plants of a training side by side, what they show written in place, scaled, with its history."""

from __future__ import annotations

from typing import Any

import numpy as np

from baselines.learned.environments import lanes_of_each
from baselines.learned.options import PHASES, TrainingOptions
from baselines.learned.settings import Settings
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.envs.vector.lanes import Floats32, Integers
from rdpi_gym.envs.vector.task import VectorTask
from rdpi_gym.envs.wrappers.history import History
from rdpi_gym.envs.wrappers.scaling import Scaling
from rdpi_gym.envs.wrappers.side_by_side import SideBySideVectorEnv
from rdpi_gym.support.arrays import Array


class Lanes:
    """Lanes of plants whose episodes begin anew by themselves, not all at once.

    Parameters
    ----------
    options, settings
        Of the training.
    lanes
        Number of lanes B.
    parts
        Into how many parts the plants are divided, each run by a thread; as many as plants at most.

    Attributes
    ----------
    parts : tuple of Part
        They share the lanes, one after the other.
    scaling
        From observations with their history to rows.

    Raises
    ------
    InputError
        Fewer lanes than plants, plants of other sizes, or keywords that make no environment.
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
    """Some groups of lanes, one after the other, that one thread steps.

    Parameters
    ----------
    scaling
        As of :class:`Lanes`.
    tasks, widths
        The groups, and their numbers of lanes.
    first
        Number of the first lane.
    episode
        Samples of an episode.

    Attributes
    ----------
    first, end
        Its lanes are ``first`` to ``end - 1``.
    steps
        Since all lanes began.
    """

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
