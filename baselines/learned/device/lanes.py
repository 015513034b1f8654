"""The plants of a training side by side on a torch device, and what they show."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from baselines.learned.device.rows import Rows
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
