"""The teacher: the true plants, and what a correction would have made of their displacement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from baselines.adaptive_dual_loop import AdaptiveDualLoop
from baselines.learned.imitation.controller import StudentController
from baselines.learned.imitation.policy import StudentPolicy
from baselines.learned.imitation.student import UNIT_UM, Float32
from baselines.learned.seen import Witnessed
from baselines.loops.path import belief_path
from baselines.loops.systems import LinearSystem, unit_delay
from rdpi_gym.envs.tasks import Lanes, StageTask
from rdpi_gym.envs.tasks.task import Split
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


@dataclass(frozen=True)
class Responses:
    """What corrections do to the displacements of true plants: a linear system a lane, side by side.

    x(k+1) = A x(k) + b c(k), Δy(k+1) = C x(k) + d c(k), for a correction c(k) of the sample k + 1.

    Parameters
    ----------
    a, b, c, d
        ``(B, n, n)``, ``(B, n)``, ``(B, n)``, ``(B,)``.

    Examples
    --------
    >>> late = Responses.of([LinearSystem(np.zeros((1, 1)), np.ones(1), np.ones(1), 0.0)])
    >>> late.displacement(np.array([[1.0], [0.0], [0.0]])).ravel().tolist()
    [0.0, 1.0, 0.0]
    """

    a: Array
    b: Array
    c: Array
    d: Array

    @classmethod
    def of(cls, systems: Sequence[LinearSystem]) -> Responses:
        """Stack systems; those of fewer states are filled up with zeros."""
        lanes, n = len(systems), max(system.order for system in systems)
        a, b, c = np.zeros((lanes, n, n)), np.zeros((lanes, n)), np.zeros((lanes, n))
        for lane, system in enumerate(systems):
            m = system.order
            a[lane, :m, :m], b[lane, :m], c[lane, :m] = system.a, system.b, system.c
        return cls(a, b, c, np.array([system.d for system in systems]))

    def displacement(self, correction_um: Array) -> Array:
        """Return Δy(1) ... Δy(K) (µm) of corrections c(0) ... c(K-1) (µm), ``(K, B)``."""
        x, found = np.zeros_like(self.b), np.empty_like(correction_um)
        for k, added in enumerate(correction_um):
            found[k] = (self.c * x).sum(axis=1) + self.d * added
            x = np.einsum("bij,bj->bi", self.a, x) + self.b * added[:, None]
        return found


def responses(lanes: Lanes, base: AdaptiveDualLoop) -> Responses:
    """Return the responses of the true plants of lanes, with the feedback of the base around them.

    A correction enters before the belief's inverse of the hysteresis, so what it meets is the
    linear part of the true plant: its lag, its delay and its mode. What is left out is that the
    estimate answers, and that the inverse of the belief is not that of the truth: a quarter of the
    effect of wideband corrections of 0.1 µm, less of smooth ones. The students' own states are
    visited anew in each round, so what is left out does not add up.

    Parameters
    ----------
    lanes
        The draws.
    base
        The controller that is corrected.
    """
    path = {
        draw.number: belief_path(draw.truth, lanes.task.ts_s).dynamics.around(
            unit_delay() * base.feedback
        )
        for draw in lanes.draws
    }
    return Responses.of([path[number] for number in lanes.numbers])


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
    response
        What another correction would have done to it.
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
    response: Responses
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
    """Run a student on lanes of a task, and say what it met.

    Parameters
    ----------
    lanes
        The draws; their noise is used up.
    policy
        The student.
    """
    told: list[tuple[Float32, Float32, Float32]] = []

    def witness(seen: Array, error_um: Array, correction_um: Array) -> None:
        error, correction = error_um / UNIT_UM, correction_um / UNIT_UM
        told.append((_single(seen), _single(error), _single(correction)))

    layout = lanes.layout()
    controller = StudentController(policy, lanes.belief, layout, witness)
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
    seen, errors, corrections = (np.stack(part) for part in zip(*told, strict=True))
    left = _single(error[1:] / UNIT_UM)
    response = responses(lanes, controller)
    return Visited(seen, errors, corrections, left, response, first - 1, score, met.largest)


def _single(values: Array) -> Float32:
    return values.astype(np.float32)


def taught_lanes(task: StageTask, split: Split, numbers: Sequence[int], seed: int | None) -> Lanes:
    """Draw lanes of a task that a student can be taught on.

    Raises
    ------
    InputError
        The task has plants of several kinds, or plants that change within an episode.
    """
    if len(task.nominals) > 1 or task.schedule is not None:
        raise InputError(
            f"a student is not taught on {task.name}, whose plants are of several kinds or change "
            "within an episode; take Stage and score it there"
        )
    (lanes,) = task.lanes(split, numbers, seed)
    return lanes
