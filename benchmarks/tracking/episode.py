"""One controller on lanes of tracking problems, all side by side, recorded sample by sample."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rdpi_gym.envs import ObservationLayout, TrackingTask
from rdpi_gym.envs.tracking import NoiseSource
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array

TIMED_SAMPLES = 300
_GIVEN_UP_S, _FEWEST = 1.0, 3


@dataclass(frozen=True)
class Recording:
    """Signals of a run, each ``float64[K, B]``."""

    displacement_um: Array  # of the plant, without the sensor (µm)
    command_V: Array  # applied command (V)
    # what set the command, before it was clipped to [-1, 1]; NaN where a controller said so
    action: Array
    measured_um: Array  # the sensor's reading (µm)


def record(
    controller: Any,
    truths: Sequence[PlantModel],
    layout: ObservationLayout,
    references_um: Array,
    rngs: Sequence[np.random.Generator],
) -> Recording:
    """Run a controller on B plants through its ``predict`` alone."""
    return play(controller, TrackingTask(truths, layout), references_um, rngs)


def play(
    controller: Any,
    task: TrackingTask,
    references_um: Array,
    noises: Sequence[NoiseSource],
) -> Recording:
    """Run a controller on tracking problems that are made already; see :func:`record`."""
    samples, lanes = references_um.shape
    layout = task.layout
    observation = task.reset(references_um, noises)
    plan = getattr(controller, "plan", None)
    if plan is not None:
        plan(references_um)
    displacement, command = np.empty((samples, lanes)), np.empty((samples, lanes))
    action, measured = np.zeros((samples, lanes)), np.empty((samples, lanes))
    displacement[0], command[0] = task.displacement_um, task.command_V
    measured[0] = task.measured_um
    starts = np.ones(lanes, dtype=bool)
    state = None
    with np.errstate(invalid="ignore", over="ignore"):
        for k in range(1, samples):
            answer, state = controller.predict(observation, state, starts, deterministic=True)
            action[k] = np.reshape(answer, lanes)
            command[k] = layout.place_to_V(np.minimum(np.maximum(action[k], -1.0), 1.0))
            observation = task.step(command[k])
            displacement[k], measured[k] = task.displacement_um, task.measured_um
            if k == 1:
                starts = np.zeros(lanes, dtype=bool)
    return Recording(displacement, command, action, measured)


def microseconds_per_sample(
    controller: Any, truth: PlantModel, layout: ObservationLayout, reference_um: Array
) -> float:
    """Time one decision (µs) of a controller that runs one plant: the median over many.

    One that is very slow is given up early; a few decisions that take long, as those in which
    kernels are compiled, are no reason to.
    """
    task = TrackingTask(truth, layout)
    observation = task.reset(reference_um[:, None], [np.random.default_rng(0)])
    plan = getattr(controller, "plan", None)
    if plan is not None:
        plan(reference_um[:, None])
    starts = np.ones(1, dtype=bool)
    state, spent = None, []
    for _ in range(min(TIMED_SAMPLES, len(reference_um) - 1)):
        begin = time.perf_counter()
        answer, state = controller.predict(observation, state, starts, deterministic=True)
        spent.append(time.perf_counter() - begin)
        if len(spent) >= _FEWEST and len(spent) * np.median(spent) > _GIVEN_UP_S:
            break
        action = np.clip(np.reshape(answer, 1).astype(np.float64), -1.0, 1.0)
        observation = task.step(layout.place_to_V(action))
        starts = np.zeros(1, dtype=bool)
    return 1e6 * float(np.median(spent))
