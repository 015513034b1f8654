"""Frequency response of a closed loop, measured by a multisine that it tracks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from baselines.loops import Response
from rdpi_gym.envs.controller import Controller
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.tracking import TrackingTask
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


@dataclass(frozen=True)
class LoopResponse:
    """Displacement over reference, complex, at frequencies (Hz)."""

    frequencies_hz: Array
    tracking: Response

    @property
    def error(self) -> Response:
        """Error over reference."""
        return np.asarray(1.0 - self.tracking)

    def bandwidth_hz(self, decibel: float = 3.0) -> float:
        """Frequency (Hz) up to which the displacement's amplitude stays within ± `decibel`."""
        return self._last(np.abs(20.0 * np.log10(np.abs(self.tracking))) <= decibel)

    def accuracy_hz(self, share: float = 0.1) -> float:
        """Frequency (Hz) up to which the error, phase included, stays below a share."""
        return self._last(np.abs(self.error) <= share)

    def _last(self, within: np.ndarray) -> float:
        count = len(within) if within.all() else int(np.argmin(within))
        return float(self.frequencies_hz[count - 1]) if count else 0.0


def measure_loop(
    controller: Controller,
    truth: PlantModel,
    layout: ObservationLayout,
    amplitude_um: float,
    samples: int = 1000,
    periods: int = 4,
    lines: int = 60,
    highest_hz: float | None = None,
    at: Literal["reference", "reading"] = "reference",
    seed: int = 0,
) -> LoopResponse:
    """Return the response of a loop to a multisine at the reference, or added to the reading."""
    rng = np.random.default_rng(seed)
    highest = samples / 3.0 if highest_hz is None else highest_hz * samples * layout.ts_s
    bins = np.unique(np.geomspace(1.0, highest, lines).round().astype(int))
    angles = 2.0 * math.pi * np.outer(np.arange(samples), bins) / samples
    wave = np.cos(angles + rng.uniform(0.0, 2.0 * math.pi, len(bins))).sum(axis=1)
    task = TrackingTask(truth, layout)
    noise = [rng]
    task.reset(np.zeros((2, 1)) + layout.centre_um, noise)
    reference = np.tile(wave * amplitude_um / wave.std(), periods)[:, None]
    rest = task.displacement_um.copy()
    shown = reference[:, 0] / layout.scale_um if at == "reading" else np.zeros(len(reference))
    observation = task.reset(
        np.full_like(reference, rest[0]) if at == "reading" else reference + rest[0] - reference[0],
        noise,
    )
    displacement = np.empty(len(reference))
    displacement[0], state, starts = task.displacement_um[0], None, np.ones(1, dtype=bool)
    for k in range(1, len(reference)):
        observation[:, layout.columns["measured"].start] -= shown[k - 1]
        action, state = controller.predict(observation, state, starts, deterministic=True)
        command = action[:, 0].astype(np.float64)
        if layout.action == "command":
            command = layout.place_to_V(command)
        else:
            command = task.command_V + layout.action_scale_V * command
        observation = task.step(command)
        displacement[k] = task.displacement_um[0]
        starts = np.zeros(1, dtype=bool)
    if not np.isfinite(displacement).all() or np.ptp(displacement) > 100.0 * np.ptp(reference):
        raise InputError("the loop diverges on the multisine; nothing can be measured in it")
    kept = samples * (periods - periods // 2)
    spectra = [
        np.fft.rfft(x[kept:].reshape(-1, samples).mean(axis=0))[bins]
        for x in (displacement, reference[:, 0])
    ]
    frequencies = bins / (samples * layout.ts_s)
    return LoopResponse(frequencies, np.asarray(spectra[0] / spectra[1]))
