"""The plants of a training side by side on a torch device, and what they show."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from baselines.learned.environments import lanes_of_each
from baselines.learned.native.lanes import ending_phase, phases_of
from baselines.learned.options import TrainingOptions
from baselines.learned.settings import Settings
from rdpi_gym.envs.piezo_tracking import PiezoTrackingEnv
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.envs.wrappers.history import History
from rdpi_gym.envs.wrappers.scaling import Scaling
from rdpi_gym.envs.wrappers.side_by_side import SideBySideVectorEnv
from rdpi_gym.support.errors import InputError
from rdpi_gym.torch_plant import TorchEpisodes


class Rows:
    """Makes of observations what :class:`~rdpi_gym.envs.wrappers.scaling.Scaling` makes of them.

    Parameters
    ----------
    scaling
        From observations with their history to rows.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.envs.wrappers.history import History
    >>> layout = ObservationLayout(1, 0.0, 1.0, (-1.0, 1.0), 1e-4)
    >>> rows = Rows(Scaling(History(layout, 1), error=0.1))
    >>> rows.first(torch.tensor([[0.5, 0.5, 0.25, 0.0]])).tolist()
    [[0.5, 0.0, 0.0, 2.5, 2.5, 0.0, 0.0]]
    """

    def __init__(self, scaling: Scaling) -> None:
        layout = scaling.history.layout
        self._preview, self._steps = layout.preview, scaling.history.steps
        # Of an increment of one in a sample, and of an error of one.
        self._moved = 2.0 * math.pi * scaling.frequency_hz * layout.ts_s
        self._error = scaling.error

    def first(self, observed: Tensor) -> Tensor:
        """Return the rows ``float32[B, size]`` of episodes that begin with observations ``[B, D]``."""
        reference, ahead, error, command = self._now(observed)
        still = torch.zeros_like(command).expand(-1, self._steps)
        errors = error.expand(-1, self._steps + 1)
        return torch.cat([reference, ahead, still, errors, command, still], dim=1)

    def next(self, before: Tensor, observed: Tensor) -> Tensor:
        """Return the rows that follow rows ``float32[B, size]`` once ``[B, D]`` is observed."""
        p, steps = self._preview, self._steps
        reference, ahead, error, command = self._now(observed)
        if steps == 0:
            return torch.cat([reference, ahead, error, command], dim=1)
        at = p + steps + 1  # the newest error
        last = at + steps + 1  # the command
        change = (command - before[:, last : last + 1]) / self._moved
        # What lay ahead is past; of the rest the oldest is forgotten.
        past = before[:, 1:2], before[:, p + 1 : p + steps]
        errors, changes = before[:, at : at + steps], before[:, last + 1 : last + steps]
        return torch.cat([reference, ahead, *past, error, errors, command, change, changes], dim=1)

    def _now(self, observed: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        p = self._preview
        reference, ends = observed[:, :1], observed[:, 1 : p + 1]
        ahead = (ends - observed[:, :p]) / self._moved
        error = (reference - observed[:, p + 1 : p + 2]) / self._error
        return reference, ahead, error, observed[:, p + 2 : p + 3]


DRAWN = 1024
"""Plants of each kind, and references, from which episodes are drawn."""


class DeviceLanes:
    """Lanes of plants on a device, whose episodes begin anew by themselves, not all at once.

    The numba environment draws plant and reference of each episode anew. Here :data:`DRAWN` of each
    are drawn once, by the same environment's own draws, and an episode takes one plant and one
    reference of them: that needs no word from the host.

    Parameters
    ----------
    options, settings
        Of the training.
    lanes
        Number of lanes B.
    device
        Where they live.

    Attributes
    ----------
    rows : Tensor
        What the networks are shown now, ``float32[B, D]``; changed in place.
    rewards : Tensor
        Of the last step, ``float32[B]``; changed in place.
    scaling
        From observations with their history to rows.

    Raises
    ------
    InputError
        Fewer lanes than plants, plants of other sizes, actions that correct a baseline, or keywords
        that make no environment.
    """

    def __init__(
        self, options: TrainingOptions, settings: Settings, lanes: int, device: torch.device
    ) -> None:
        if options.action == "correction":
            raise InputError(
                "action is 'correction', whose baseline does not run on a torch device; "
                "give action 'increment' or 'command', or no device"
            )
        shares = lanes_of_each(options.models, lanes)
        keywords = options.environment()
        single = [PiezoTrackingVectorEnv(1, plant=p, **keywords) for p in options.models]
        layout = SideBySideVectorEnv(single).layout  # refuses those that cannot stand side by side
        self.scaling = Scaling(
            History(layout, settings.history), settings.frequency_hz, settings.error
        )
        self._as_rows, self._episode = Rows(self.scaling), options.episode
        ends = np.cumsum(shares)
        self._groups = [
            (
                _episodes(env.single, share, options, number, device),
                slice(int(end - share), int(end)),
            )
            for number, (env, share, end) in enumerate(zip(single, shares, ends, strict=True))
        ]
        self.rows = torch.zeros(lanes, self.scaling.history.size, device=device)
        self.rewards = torch.zeros(lanes, device=device)
        every, phases = torch.arange(lanes, device=device), phases_of(options.episode)
        self._every, self._phases = every, [every[i::phases] for i in range(phases)]
        # The lanes of a phase, and of all, as each group counts them.
        self._within = {
            i: [(g, _own(i, phases, own, device)) for g, own in self._groups] for i in range(phases)
        }
        self._all = [(g, _own(0, 1, own, device)) for g, own in self._groups]
        self._steps = 0

    @torch.no_grad()
    def begin(self, generator: torch.Generator) -> None:
        """Begin an episode in every lane."""
        self._steps = 0
        self._place(self._every, self._all, generator)

    @torch.no_grad()
    def step(self, actions: Tensor, noise: Tensor) -> None:
        """Take a step of every lane: what is replayed."""
        observed = []
        for group, own in self._groups:
            shown, reward = group.step(actions[own], noise[own])
            observed.append(shown)
            self.rewards[own] = reward
        self.rows.copy_(self._as_rows.next(self.rows, torch.cat(observed)))

    def ended(self) -> Tensor | None:
        """Count a step; return the lanes whose episode is over after it, if there are any."""
        self._steps += 1
        phase = ending_phase(self._steps, self._episode)
        return None if phase is None or not len(self._phases[phase]) else self._phases[phase]

    @torch.no_grad()
    def restart(self, generator: torch.Generator) -> None:
        """Begin new episodes in the lanes that :meth:`ended` returned."""
        phase = ending_phase(self._steps, self._episode)
        assert phase is not None
        self._place(self._phases[phase], self._within[phase], generator)

    def _place(
        self, lanes: Tensor, within: list[tuple[TorchEpisodes, Tensor]], generator: torch.Generator
    ) -> None:
        observed = []
        for group, own in within:
            given: dict[str, Any] = {"generator": generator, "device": own.device}
            plants, references = (torch.randint(n, own.shape, **given) for n in group.counts)
            observed.append(group.begin(own, plants, references, torch.randn(own.shape, **given)))
        self.rows.index_copy_(0, lanes, self._as_rows.first(torch.cat(observed)))


def _episodes(
    single: PiezoTrackingEnv,
    lanes: int,
    options: TrainingOptions,
    number: int,
    device: torch.device,
) -> TorchEpisodes:
    """Draw the pools of one nominal plant, as its environment draws."""
    rng, truths, layout = (
        np.random.default_rng([options.seed, number]),
        single.truths,
        single.layout,
    )
    drawn = truths.half_width > 0.0 or truths.effects_half_width > 0.0
    models = [truths.draw(rng, {}, layout) for _ in range(DRAWN if drawn else 1)]
    samples = options.episode + layout.preview + 1
    references = [
        single.reference_um(single.references.draw(rng), 0, samples) for _ in range(DRAWN)
    ]
    return TorchEpisodes(
        models,
        np.concatenate(references, axis=1),
        layout,
        lanes,
        command_cost=single.command_cost,
        bound_um=single.bound_um,
        device=device,
    )


def _own(first: int, stride: int, own: slice, device: torch.device) -> Tensor:
    """Return every so many lanes from a first one on, those of a group, as it counts them."""
    lanes = np.arange(first, own.stop, stride)
    return torch.from_numpy(lanes[lanes >= own.start] - own.start).to(device)
