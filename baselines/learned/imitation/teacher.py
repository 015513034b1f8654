"""Teacher: the true plants, and the effect of another correction on their displacement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from baselines.adaptive_feedforward import HALF, AdaptiveFeedforward
from baselines.classical import pack_inverse
from baselines.core_bank import BankFeedforward, CoreBank
from baselines.damping import AdaptiveDualLoop
from baselines.feedforward import Feedforward
from baselines.learned.imitation.policy import (
    UNIT_UM,
    DecisionSample,
    Float32,
    StudentController,
    StudentPolicy,
)
from baselines.least_squares import SOLVE_EVERY, ForgettingLeastSquares
from baselines.loops import LinearSystem, linear_part, unit_delay
from baselines.monitors import EnvelopeRecorder
from rdpi_gym.envs.tasks import Lanes, StageTask
from rdpi_gym.envs.tasks.task import Split
from rdpi_gym.plant import RDPI, Plant, PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

RENEWED = 25
"""Samples between two covariances: a small part of the memory of the estimate."""


@dataclass(frozen=True)
class Systems:
    """Linear systems side by side, one a lane: x(k+1) = A x(k) + b u(k), y(k) = c x(k) + d u(k)."""

    a: Float32
    b: Float32
    c: Float32
    d: Float32  # ``(B, n, n)``, ``(B, n)``, ``(B, n)``, ``(B,)``

    @classmethod
    def of(cls, systems: Sequence[LinearSystem]) -> Systems:
        """Stack systems; those of fewer states are filled up with zeros."""
        lanes, n = len(systems), max(system.order for system in systems)
        a, b, c = np.zeros((lanes, n, n)), np.zeros((lanes, n)), np.zeros((lanes, n))
        for lane, system in enumerate(systems):
            m = system.order
            a[lane, :m, :m], b[lane, :m], c[lane, :m] = system.a, system.b, system.c
        return cls(*map(single, (a, b, c, np.array([system.d for system in systems]))))

    @classmethod
    def joined(cls, parts: Sequence[Systems]) -> Systems:
        """Return the systems of all lanes."""
        return cls.of(
            [
                LinearSystem(*of)
                for part in parts
                for of in zip(part.a, part.b, part.c, part.d, strict=True)
            ]
        )


@dataclass(frozen=True)
class Inverse:
    """The classical inverse of the belief, at the rate of what it is given."""

    gain: float
    weights: Float32
    thresholds_um: Float32  # 1/a_0, b_i and s_i at rest
    per_um: float  # growth of every s_i with the change of w in a sample (µm/µm)
    plays_um: Float32  # η_i at rest, ``(n,)``

    @classmethod
    def of(cls, inverse: Feedforward) -> Inverse:
        """Take over what an inverse runs with."""
        model, ts_s = inverse.model, inverse.layout.ts_s
        packed, n = pack_inverse([model], ts_s)[:, 0], model.n
        rest = inverse.start(np.zeros(1))[2 : n + 2, 0]
        return cls(
            float(packed[0]),
            single(packed[1 : n + 1]),
            single(packed[n + 1 : 2 * n + 1]),
            float(packed[2 * n + 1] / (ts_s * model.A)),
            single(rest),
        )


@dataclass(frozen=True)
class Plays:
    """The true hysteresis of every lane, Eq. 3 to 5, at its own low-passed rate."""

    gain: Float32
    weights: Float32  # a_0 ``(B,)`` and a_i ``(B, n)`` (µm/V)
    thresholds_V: Float32
    delta2_s: Float32  # at rest ``(B, n)``, and δ2 ``(B,)``
    pole: Float32
    per_V: Float32
    # Of the rate's low-pass, and what a change of the command of 1 V in a sample adds to it
    # (V/s), ``(B,)``.
    memory_V: Float32  # ξ_i at rest, ``(B, n)``

    @classmethod
    def of(cls, cores: Sequence[RDPI], ts_s: float, memory_V: Array) -> Plays:
        """Stack the cores of the lanes, with what they remember at rest, ``(n, B)``."""
        pole = np.array([core.rate_pole(ts_s) for core in cores])
        weights = np.array([core.weights for core in cores])
        return cls(
            single(weights[:, 0]),
            single(weights[:, 1:]),
            single(np.array([core.thresholds_V for core in cores])),
            single(np.array([core.delta2_s for core in cores])),
            single(pole),
            single((1.0 - pole) / ts_s),
            single(memory_V.T),
        )


@dataclass(frozen=True)
class Chords:
    """The search for a command along chords of the belief's core; see :meth:`CoreBank.command`.

    What the mixture adds to the core is taken as it was: of a command that differs by nanometres it
    differs by far less.
    """

    gain: float
    weights: Float32
    thresholds_V: Float32  # a_0 (µm/V), a_i and r_i of the plays, ``(n,)``
    delta2_s: float
    pole: float
    per_V: float  # of the rate's low-pass, as of :class:`Plays`
    kept: float  # what the believed lag in front leaves of a distance in a sample
    slopes: tuple[float, float, float]  # least, usual and largest (µm/V)
    range_V: tuple[float, float]
    memory_V: Float32  # plays at rest, ``(n,)``

    @classmethod
    def of(cls, bank: CoreBank, ts_s: float) -> Chords:
        """Take over what a bank searches with."""
        core = bank.core
        pole = core.rate_pole(ts_s)
        return cls(
            core.a0,
            single(np.array(core.weights[1:])),
            single(np.array(core.thresholds_V)),
            core.delta2_s,
            pole,
            (1.0 - pole) / ts_s,
            bank.lag,
            bank.slopes,
            bank.range_V,
            single(np.array(core.settled((bank.rest_V,)))),
        )


@dataclass(frozen=True)
class Estimate:
    """The estimate along what was visited, and what moves it.

    With ε = z - θ·φ of what it learned from, small changes of φ and z change it by P(k) g(k),
    g(k) = λ g(k-1) + ε δφ + φ (δz - θ·δφ), P the inverse of its normal equations: as if θ had been
    then what it is now.
    """

    theta: Float32
    answered: Float32
    phi: Float32  # as :class:`~baselines.learned.imitation.policy.DecisionSample`, ``(K, B, F)``
    left_um: Float32  # ε, ``(K, B)``
    covariance: Float32  # P at every :data:`RENEWED` samples, ``(K / RENEWED, B, F, F)``
    spread: Float32  # expected deviations, ``(F,)``
    scale_um: float  # scale of what the base answers, as a student sees it
    kept: float  # λ
    begins: int
    late: int
    # First decision that learns, and samples by which w was entered before it is compared.

    @classmethod
    def of(cls, adaptive: AdaptiveFeedforward, moments: Sequence[DecisionSample]) -> Estimate:
        """Take over what was visited."""
        fit, begins = adaptive.fit, adaptive.lead + 2 * HALF + 2
        phi = np.stack([each.phi.T for each in moments])
        used = phi.copy()
        used[:begins] = 0.0
        return cls(
            single(np.stack([each.theta.T for each in moments])),
            single(np.stack([each.answered.T for each in moments])),
            single(phi),
            single(np.stack([each.left_um for each in moments])),
            single(_covariances(used, fit)),
            single(fit.spread),
            adaptive.layout.scale_um,
            fit.kept,
            begins,
            adaptive.lead,
        )

    def solves(self, k: int) -> bool:
        """Whether the estimate moves at a decision."""
        return k >= self.begins and (k - self.begins + 1) % SOLVE_EVERY == 0


@dataclass(frozen=True)
class LoopModel:
    """All that another correction would have met on the way to the error that it is to lessen.

    The correction is added to w; the belief's inverse makes a command of it, at the rate of w; the
    true plants follow it, their lag before the plays and delay and mode behind them; the feedback
    answers the displacement, and the estimate what it learns from it. What is left out: creep and
    whatever else is neither linear nor the hysteresis, the ends of the command's range, and that
    what rings is withdrawn.
    """

    wanted_um: Float32  # w, ``(K, B)``
    start_um: Float32  # the w of before, ``(B,)``
    given_um: Float32  # what the plays gave, ``(K, B)``
    rest_V: float  # command before the first
    inverse: Inverse
    plays: Plays
    estimate: Estimate  # see there
    before: Systems
    behind: Systems
    feedback: Systems  # linear parts: of the command, of what the plays give, and of the error


@dataclass(frozen=True)
class BankModel:
    """The same of a correction of the bank of cores: it searches a command for w, and its estimate stays.

    The rate of a fast correction takes most of what its command gives, so the search ends short of it,
    and more of it comes a sample later: a filter that no linear part of the plant has.
    """

    commands_V: Float32
    given_um: Float32  # what drove the true plants, and what their plays gave, ``(K, B)``
    rest_V: float
    chords: Chords
    plays: Plays
    before: Systems
    behind: Systems
    feedback: Systems

    @classmethod
    def joined(cls, parts: Sequence[BankModel]) -> BankModel:
        """Return the models of all lanes, which hold one belief."""
        plays = (
            np.concatenate([getattr(part.plays, each.name) for part in parts])
            for each in fields(Plays)
        )
        systems = (
            Systems.joined([getattr(part, name) for part in parts])
            for name in ("before", "behind", "feedback")
        )
        return cls(
            np.concatenate([part.commands_V for part in parts], axis=1),
            np.concatenate([part.given_um for part in parts], axis=1),
            parts[0].rest_V, parts[0].chords, Plays(*plays), *systems,
        )  # fmt: skip


def correction_loop(truth: PlantModel, feedback: LinearSystem, ts_s: float) -> LinearSystem:
    """Return the system from the correction of w at a decision to the displacement a sample later.

    Of a core whose thresholds do not move with the rate: the inverse that w is given to undoes it, of
    whatever kind, but for errors that are small beside the correction. So what lies on the way is what
    is linear of the true plant, and the feedback around it, which sees a displacement a sample later.
    """
    path = linear_part(truth.effects, truth.hysteresis, ts_s)
    return path.around(unit_delay() * feedback)


def loop_model(
    lanes: Lanes, base: AdaptiveDualLoop, moments: Sequence[DecisionSample], commands_V: Array
) -> LoopModel | BankModel | Systems:
    """Return what surrounded a student that drove lanes: where a true core is another, :func:`correction_loop`."""
    ts_s, adaptive = lanes.task.ts_s, base.feedforward
    truths = {draw.number: draw.truth for draw in lanes.draws}
    each = [truths[number] for number in lanes.numbers]
    if not all(isinstance(m.hysteresis, RDPI) for m in [*lanes.task.nominals, base.belief]):
        loops = {
            number: correction_loop(truth, base.feedback, ts_s) for number, truth in truths.items()
        }
        return Systems.of([loops[number] for number in lanes.numbers])
    rest_V = base.limits.rest_V
    plant = _plays_alone(each, ts_s, rest_V)
    memory = plant.memory.copy()
    given_um = single(plant.simulate(commands_V))
    before, behind = zip(*(_parts(truth, ts_s) for truth in each), strict=True)
    plays = Plays.of([truth.hysteresis for truth in each], ts_s, memory)
    around = Systems.of(before), Systems.of(behind), Systems.of([base.feedback] * len(each))
    if isinstance(adaptive, BankFeedforward):
        chords = Chords.of(adaptive.bank, ts_s)
        return BankModel(single(commands_V), given_um, rest_V, chords, plays, *around)
    offset = base.belief.offset_um
    return LoopModel(
        single(np.stack([moment.wanted_um for moment in moments]) - offset),
        single(lanes.references_um[0] - offset),
        given_um,
        rest_V,
        Inverse.of(adaptive.inverse),
        plays,
        Estimate.of(adaptive, moments),
        *around,
    )


def single(values: Array) -> Float32:
    """Return numbers in single precision."""
    return np.ascontiguousarray(values, dtype=np.float32)


def _parts(truth: PlantModel, ts_s: float) -> tuple[LinearSystem, LinearSystem]:
    """Return the linear effects of a plant before its plays, and those behind."""
    before = [effect for effect in truth.effects if effect.slot == "input"]
    behind = [effect for effect in truth.effects if effect.slot != "input"]
    core = truth.hysteresis
    return linear_part(before, core, ts_s), linear_part(behind, core, ts_s)


def _plays_alone(truths: Sequence[PlantModel], ts_s: float, rest_V: float) -> Plant:
    """Return true plants without what stands behind their plays, at rest."""
    bare = [
        replace(truth, offset_um=0.0, effects=tuple(e for e in truth.effects if e.slot == "input"))
        for truth in truths
    ]
    plant = Plant(bare, ts_s)
    plant.reset(u0_V=rest_V)
    plant.step(np.full((1, len(truths)), rest_V))
    return plant


def _covariances(phi: Array, fit: ForgettingLeastSquares) -> Array:
    """Return the inverse of the normal equations at every :data:`RENEWED` samples."""
    lanes, size = phi.shape[1:]
    fades = fit.kept ** np.arange(RENEWED - 1, -1, -1.0)
    sums, found = np.zeros((lanes, size, size)), []
    for begin in range(0, len(phi), RENEWED):
        block = phi[begin : begin + RENEWED].transpose(1, 2, 0)
        weighted = block * fades[-block.shape[2] :]
        sums = fit.kept ** block.shape[2] * sums + weighted @ block.transpose(0, 2, 1)
        found.append(np.linalg.inv(sums + np.diag(fit.precision)))
    return np.stack(found)


@dataclass(frozen=True)
class Rollout:
    """Rollout of a student on lanes, decision by decision; displacements in :data:`UNIT_UM`."""

    seen: Float32  # ``float32[K, inputs, B]``
    error: Float32
    correction: Float32
    # Measured error that was seen, and the correction that was answered, ``float32[K, B]``.
    left: Float32  # true tracking error one sample later, ``float32[K, B]``
    loop_model: LoopModel | BankModel | Systems  # what another correction would have met
    first: int  # decision from which on errors are scored
    score: Score  # of the run
    largest: Mapping[str, float]  # how far its loops went, see :mod:`baselines.monitors`

    @classmethod
    def joined(cls, parts: Sequence[Rollout]) -> Rollout:
        """Return rollouts side by side, as one; several are of one sort, and not :class:`LoopModel`."""
        if len(parts) == 1:
            return parts[0]
        loops = [part.loop_model for part in parts if isinstance(part.loop_model, Systems)]
        banks = [part.loop_model for part in parts if isinstance(part.loop_model, BankModel)]
        around = Systems.joined(loops) if loops else BankModel.joined(banks)

        def joined(name: str) -> Float32:
            return np.concatenate([getattr(one, name) for one in parts], axis=-1)

        furthest = {name: max(one.largest[name] for one in parts) for name in parts[0].largest}
        return cls(
            joined("seen"), joined("error"), joined("correction"), joined("left"),
            around, parts[0].first, Score.joined([one.score for one in parts]), furthest,
        )  # fmt: skip


@dataclass(frozen=True)
class Score:
    """Tracking scores of lanes."""

    rmse_um: Array
    peak_um: Array  # of each lane: RMS error, and peak to peak of the reference (µm), ``(B,)``
    absolute_um: Array  # mean size of the error (µm), ``(B,)``
    command_variation_V_s: Array  # of each lane, ``(B,)``

    @property
    def percent(self) -> Array:
        """RMS error over the reference's peak to peak, of each lane."""
        return 100.0 * self.rmse_um / self.peak_um

    @classmethod
    def joined(cls, scores: Sequence[Score]) -> Score:
        """Return the scores of all lanes."""
        names = ("rmse_um", "peak_um", "absolute_um", "command_variation_V_s")
        return cls(*(np.concatenate([getattr(one, name) for one in scores]) for name in names))


def roll_out(lanes: Lanes, policy: StudentPolicy) -> Rollout:
    """Run a student on lanes of a task, and say what it met."""
    moments: list[DecisionSample] = []
    layout = lanes.layout()
    controller = StudentController(policy, lanes.belief, layout, moments.append)
    track, reference = lanes.track(layout), lanes.references_um
    observation = track.reset(reference, lanes.noises)
    samples, count = reference.shape
    error, command = np.empty((samples, count)), np.empty((samples, count))
    error[0], command[0] = track.error_um, track.command_V
    state, met = None, EnvelopeRecorder(layout)
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
    return Rollout(
        single(np.stack([moment.seen for moment in moments])),
        single(np.stack([moment.error_um for moment in moments]) / UNIT_UM),
        single(np.stack([moment.correction_um for moment in moments]) / UNIT_UM),
        single(error[1:] / UNIT_UM),
        loop_model(lanes, controller, moments, command[1:]),
        first - 1,
        score,
        met.largest,
    )


def student_lanes(
    task: StageTask, split: Split, numbers: Sequence[int], seed: int | None
) -> list[Lanes]:
    """Draw lanes of a task that a student can be taught on, those of each nominal plant apart."""
    if task.schedule is not None:
        raise InputError(
            f"a student is not taught on {task.name}, whose plants change within an episode; take "
            "Stage and score it there"
        )
    return task.lanes(split, numbers, seed)
