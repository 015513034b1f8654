"""The teacher: the true plants, and what a correction would have made of their displacement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from baselines.learned.imitation.controller import StudentController
from baselines.learned.imitation.policy import StudentPolicy
from baselines.learned.imitation.student import UNIT_UM, Float32
from baselines.learned.imitation.surroundings import Surroundings, single, surroundings
from baselines.learned.imitation.taught import Moment
from baselines.learned.seen import Witnessed
from rdpi_gym.envs.tasks import Lanes, StageTask
from rdpi_gym.envs.tasks.task import Split
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


@dataclass(frozen=True)
class Visited:
    """What a student met on lanes, decision by decision; displacements in :data:`UNIT_UM`.

    Parameters
    ----------
    seen
        ``float32[K, inputs, B]``.
    error, correction
        Measured error that was seen, and the correction that was answered, ``float32[K, B]``.
    left
        True tracking error one sample later, ``float32[K, B]``.
    surroundings
        What another correction would have met.
    first
        Decision from which on errors are scored.
    score
        Of the run.
    largest
        How far its loops went, see :mod:`baselines.learned.seen`.
    """

    seen: Float32
    error: Float32
    correction: Float32
    left: Float32
    surroundings: Surroundings
    first: int
    score: Score
    largest: Mapping[str, float]


@dataclass(frozen=True)
class Score:
    """How well lanes were tracked.

    Parameters
    ----------
    rmse_um, peak_um
        Of each lane: RMS error, and peak to peak of the reference (µm), ``(B,)``.
    absolute_um
        Mean size of the error (µm), ``(B,)``.
    command_variation_V_s
        Of each lane, ``(B,)``.
    """

    rmse_um: Array
    peak_um: Array
    absolute_um: Array
    command_variation_V_s: Array

    @property
    def percent(self) -> Array:
        """RMS error over the reference's peak to peak, of each lane."""
        return 100.0 * self.rmse_um / self.peak_um


def visit(lanes: Lanes, policy: StudentPolicy) -> Visited:
    """Run a student on lanes of a task, and say what it met."""
    moments: list[Moment] = []
    layout = lanes.layout()
    controller = StudentController(policy, lanes.belief, layout, moments.append)
    track, reference = lanes.track(layout), lanes.references_um
    observation = track.reset(reference, lanes.noises)
    samples, count = reference.shape
    error, command = np.empty((samples, count)), np.empty((samples, count))
    error[0], command[0] = track.error_um, track.command_V
    state, met = None, Witnessed(layout)
    for k in range(1, samples):
        met.take(observation)
        action, state = controller.predict(observation, state)
        observation = track.step(layout.place_to_V(action[:, 0].astype(np.float64)))
        error[k], command[k] = track.error_um, track.command_V
    first = lanes.task.first
    scored = error[first:]
    score = Score(
        np.sqrt(np.mean(scored**2, axis=0)),
        np.ptp(reference[first:], axis=0),
        np.mean(np.abs(scored), axis=0),
        np.mean(np.abs(np.diff(command[first - 1 :], axis=0)), axis=0) / lanes.task.ts_s,
    )
    return Visited(
        single(np.stack([moment.seen for moment in moments])),
        single(np.stack([moment.error_um for moment in moments]) / UNIT_UM),
        single(np.stack([moment.correction_um for moment in moments]) / UNIT_UM),
        single(error[1:] / UNIT_UM),
        surroundings(lanes, controller, moments, command[1:]),
        first - 1,
        score,
        met.largest,
    )


def taught_lanes(task: StageTask, split: Split, numbers: Sequence[int], seed: int | None) -> Lanes:
    """Draw lanes of a task that a student can be taught on."""
    if len(task.nominals) > 1 or task.schedule is not None:
        raise InputError(
            f"a student is not taught on {task.name}, whose plants are of several kinds or change "
            "within an episode; take Stage and score it there"
        )
    (lanes,) = task.lanes(split, numbers, seed)
    return lanes
