"""Student: a recurrent network in NumPy, its inputs, its policy in a folder, and its controller."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.adaptive_feedforward import PLAYS, SLOW_S, SPLINE, spline_weights
from baselines.base import Observation, lane_products, product
from baselines.core_bank import AdaptiveCoreBank, BankFeedforward
from baselines.damping import AdaptiveDualLoop, CorrectedAdaptive
from baselines.learned.policy import (
    DESCRIPTION,
    SavedPolicy,
    check_digest,
    check_preview,
    reading,
    write_policy,
)
from baselines.monitors import checked_envelope
from baselines.tuning import Settings, checked_settings
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_bytes, read_json, settled_folder
from rdpi_gym.support.npz import open_npz
from rdpi_gym.support.words import quoted

Float32 = NDArray[np.float32]

UNIT_UM = 0.05
"""Unit (µm) of errors and corrections inside the network: what the adaptive controllers leave."""
ERRORS, CORRECTIONS = 6, 4
"""Newest errors, which are weighted, and own corrections, which are only seen."""
MOST_UM = 1.0
"""Bound of the correction (µm); it is approached smoothly."""
ARRAYS = ("middle", "spread", "into", "bias", "past", "hidden", "hidden_bias", "head", "head_bias")
"""Names of the network's arrays, in the order of a file."""
SCALES = ("middle", "spread")
"""Those that units hang on; the others are kept in half precision."""


def shapes(inputs: int, hidden: int, weighted: int) -> dict[str, tuple[int, ...]]:
    """Return the shape of each array of a network."""
    gates, past = 3 * hidden, ERRORS + CORRECTIONS
    return {
        "middle": (inputs,),
        "spread": (inputs,),
        "into": (gates, inputs),
        "bias": (gates,),
        "past": (gates, past),
        "hidden": (gates, hidden),
        "hidden_bias": (gates,),
        "head": (weighted + 1 + ERRORS, hidden),
        "head_bias": (weighted + 1 + ERRORS,),
    }


@dataclass(frozen=True)
class Student:
    """c(k) = a(h)·φ(k): a gated recurrent unit sets the weights a of what is seen, φ.

    What is seen is scaled, and compressed by asinh before the unit, so that nanometres and jumps
    both show. φ are the first of the inputs, 1 and the newest errors, not compressed: with h at rest
    the student is a linear filter without poles, and what h makes of it is an adaptive one. Its own
    newest corrections are seen by the unit alone, or a fit could make an oscillator of them.
    """

    arrays: Mapping[str, Float32]  # by the names of :data:`ARRAYS`, float32
    weighted: int  # the first of the inputs, which are weighted too

    def __post_init__(self) -> None:
        found = self.arrays
        if set(found) != set(ARRAYS) or found["hidden"].ndim != 2:
            raise InputError(
                f"a student has the arrays {', '.join(ARRAYS)}, not {', '.join(found)}"
            )
        wanted = shapes(len(found["middle"]), found["hidden"].shape[1], self.weighted)
        for name, shape in wanted.items():
            each = found[name]
            if each.shape != shape or each.dtype != np.float32 or not np.isfinite(each).all():
                raise InputError(
                    f"array {name!r} of the student is no finite float32 of shape {shape}"
                )

    @classmethod
    def blank(cls, inputs: int, hidden: int, weighted: int) -> Student:
        """Return a student that corrects nothing."""
        arrays = {
            name: np.zeros(shape, dtype=np.float32)
            for name, shape in shapes(inputs, hidden, weighted).items()
        }
        arrays["spread"] += 1.0
        return cls(arrays, weighted)

    def rounded_to_half(self) -> Student:
        """Return the student as it is kept: its weights rounded to half precision."""
        with np.errstate(over="ignore"):  # refused as not finite
            rounded = {
                name: each if name in SCALES else each.astype(np.float16).astype(np.float32)
                for name, each in self.arrays.items()
            }
        return Student(rounded, self.weighted)

    @property
    def inputs(self) -> int:
        """Numbers seen beside errors and corrections."""
        return len(self.arrays["middle"])

    @property
    def width(self) -> int:
        """Width of the recurrent layer."""
        return int(self.arrays["hidden"].shape[1])

    @property
    def rows(self) -> int:
        """Rows of its memory: h, errors and corrections, the newest of each first."""
        return self.width + ERRORS + CORRECTIONS

    def answer_um(
        self, seen: NDArray[np.float64], error_um: NDArray[np.float64], memory: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Return the correction (µm), ``(B,)``, and move the memory on."""
        p, width = self.arrays, self.width
        scaled = ((seen.astype(np.float32).T - p["middle"]) / p["spread"]).astype(np.float32)
        h, errors, corrections = np.split(memory, [width, width + ERRORS])
        errors[1:] = errors[:-1].copy()
        errors[0] = error_um / UNIT_UM
        past = memory[width:].T.astype(np.float32)
        before = h.T.astype(np.float32)
        given = np.arcsinh(scaled) @ p["into"].T + p["bias"] + np.arcsinh(past) @ p["past"].T
        back = before @ p["hidden"].T + p["hidden_bias"]
        gates = 1.0 / (1.0 + np.exp(-(given[:, : 2 * width] + back[:, : 2 * width])))
        reset, keep = gates[:, :width], gates[:, width:]
        fresh = np.tanh(given[:, 2 * width :] + reset * back[:, 2 * width :])
        after = fresh + keep * (before - fresh)
        weights = after @ p["head"].T + p["head_bias"]
        ones = np.ones((len(scaled), 1), dtype=np.float32)
        phi = np.concatenate([scaled[:, : self.weighted], ones, past[:, :ERRORS]], axis=1)
        most = MOST_UM / UNIT_UM
        correction = most * np.tanh((weights * phi).sum(axis=1) / most)
        h[:] = after.T
        corrections[1:] = corrections[:-1].copy()
        corrections[0] = correction
        return np.asarray(UNIT_UM * correction, dtype=np.float64)


def fresh_arrays(
    seed: int, middle: Float32, spread: Float32, hidden: int, weighted: int
) -> dict[str, Float32]:
    """Draw a network to begin with: its recurrent layer at random, its head zero."""
    rng = np.random.default_rng(seed)
    arrays = dict(Student.blank(len(middle), hidden, weighted).arrays)
    arrays |= {"middle": middle, "spread": spread}
    for name in ("into", "bias", "past", "hidden", "hidden_bias"):
        fan_in = arrays[name].shape[1] if arrays[name].ndim == 2 else hidden
        bound = 1.0 / math.sqrt(fan_in)
        arrays[name] = rng.uniform(-bound, bound, arrays[name].shape).astype(np.float32)
    return arrays


PREVIEW = 8
"""Samples of the reference ahead that a student sees."""
COURSE = spline_weights(PREVIEW)
"""Value and derivatives of the reference over what is seen of it."""
WEIGHTED = len(COURSE) + len(PLAYS)
"""Inputs that a student weights: the course of the reference, and the plays."""
SINCE_S = (0.01, 0.1)
"""Time constants (s) of what says how long an episode runs."""

KNOWN = WEIGHTED + len(SLOW_S)
"""First of the inputs that say what the estimate is; what it leaves and the base's own follow."""


class DecisionSample(NamedTuple):
    """One decision of a student, and what the estimate beside it was."""

    seen: Array  # ``(inputs, B)``
    error_um: Array
    correction_um: Array  # measured error, and what the student answered (µm), ``(B,)``
    wanted_um: Array  # w, all that the belief's inverse is given (µm), ``(B,)``
    theta: Array
    answered: Array  # the estimate, and the φ of the reference that it multiplies, ``(F, B)``
    phi: Array
    left_um: Array
    # φ of what was measured, which it learned from last, ``(F, B)``, and z - θ·φ (µm), ``(B,)``.


OnDecision = Callable[[DecisionSample], None]
"""Called with every decision."""


class StudentFeedforward(CorrectedAdaptive):
    """The adaptive feedforward with a student beside it, whose correction the estimate knows of.

    A student sees, in this order: value and derivatives of the reference over the preview; how far
    each play is from the reference, and each slow low-pass; the estimate, as distance from its prior
    in expected deviations; what the estimate leaves unexplained of the newest sample that it can
    compare; the base's own correction; and for how long the episode runs.
    """

    def __init__(
        self,
        belief: PlantModel,
        layout: ObservationLayout,
        settings: Settings,
        student: Student,
        on_decision: OnDecision | None = None,
    ) -> None:
        super().__init__(belief, layout, settings)
        self.student, self._on_decision = student, on_decision
        self._inside = self.rows.total
        since = np.array(SINCE_S)[:, None]
        self.fades = np.exp(-layout.ts_s / since)

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest, the student's below that of the estimate."""
        own = np.zeros((self.student.rows, len(reference_um)))
        return np.concatenate([super().start(reference_um), own])

    def corrected_command(
        self, observation: Observation, correction_um: Array, state: Array
    ) -> Array:
        """Return u(k+1) (V), ``(B,)``; see :class:`baselines.linear_designs.CorrectedInverse`."""
        inside = state[: self._inside]
        measured = self.layout.measured_um(observation)
        ahead = self.layout.reference_um(observation, slice(PREVIEW + 1))
        own = self.wanted_um(observation, measured, ahead[:, 0], inside)
        theta = self.fit.theta(self.rows.of(inside, "fit"))
        phi, z = self.compared(inside)
        left = z - lane_products(theta, phi)
        window = self.layout.reference_um(observation)
        smooth, *derivatives = product(SPLINE, window[:, self.window].T)
        seen, error = self._seen(ahead, smooth, own, left, inside), ahead[:, 0] - measured
        added = self.student.answer_um(seen, error, state[self._inside :])
        wanted = self.corrected(own, inside, correction_um, added)
        if self._on_decision is not None:
            static = self.rows.of(inside, "seen").reshape(*self._rings, -1)[-1]
            answered = np.vstack([*derivatives, static])
            told = seen, error, added, wanted, theta.copy(), answered, phi, left
            self._on_decision(DecisionSample(*told))
        return self.driven(observation, wanted, inside)

    def _seen(
        self, ahead_um: Array, smooth_um: Array, own_um: Array, left_um: Array, state: Array
    ) -> Array:
        of, layout = self.rows.of, self.layout
        course = product(COURSE, ((ahead_um - layout.centre_um) / layout.scale_um).T)
        plays = (of(state, "plays") - smooth_um) / self.thresholds_um[:, None]
        slow = (of(state, "slow") - smooth_um) / layout.scale_um
        theta = self.fit.theta(of(state, "fit"))
        known = (theta - self.fit.prior[:, None]) / self.fit.spread[:, None]
        own = (own_um - smooth_um) / layout.scale_um
        since = self.fades ** of(state, "count")
        return np.vstack([course, plays, slow, known, left_um / UNIT_UM, own, since])


class StudentBankFeedforward(StudentFeedforward, BankFeedforward):
    """The feedforward on the bank of cores with a student beside it: the estimate has their weights too."""


FEEDFORWARDS: Mapping[str, tuple[type[CorrectedAdaptive], type[StudentFeedforward]]] = {
    AdaptiveDualLoop.name: (CorrectedAdaptive, StudentFeedforward),
    AdaptiveCoreBank.name: (BankFeedforward, StudentBankFeedforward),
}
"""Feedforward of each controller that a student can correct, without the student and with it."""


def checked_baseline(name: str) -> str:
    """Return the name of a controller that a student can correct."""
    if name not in FEEDFORWARDS:
        raise InputError(
            f"a student corrects {' or '.join(FEEDFORWARDS)}, not {quoted(name)}; give one of these"
        )
    return name


def input_count(base: CorrectedAdaptive) -> int:
    """Return how many numbers a student sees beside errors and its own corrections."""
    return WEIGHTED + len(SLOW_S) + base.fit.size + 2 + len(SINCE_S)


SCALE_SPREAD = 0.1
"""Largest relative difference of two strokes at which a student is used without a warning.

Exact equality would warn of every stack but the one taught on, also where little is lost: at the
farthest stroke ``imitation-stage`` leaves less than 0.6 of its base's error, which a test holds.
"""


def is_like(layout: ObservationLayout, taught: ObservationLayout) -> bool:
    """Whether sampling time, command range and, nearly, stroke are those of a training."""
    return (layout.ts_s, layout.command_range_V) == (taught.ts_s, taught.command_range_V) and abs(
        layout.scale_um / taught.scale_um - 1.0
    ) <= SCALE_SPREAD


FORMAT, VERSION = "rdpi-student", 2
WEIGHTS = "weights.npz"
_LARGEST = 2**24  # bytes


@dataclass(frozen=True)
class StudentPolicy(SavedPolicy):
    """A student, and what it was taught on."""

    student: Student
    layout: ObservationLayout  # of the observations of its training
    effects: tuple[str, ...]  # names of those of the belief, sorted
    loop: Settings
    feedforward: Settings  # settings of the controller that it corrects
    baseline: str = AdaptiveDualLoop.name  # its name
    training: Mapping[str, Any] = field(default_factory=dict)  # record for a reader
    seen: Mapping[str, float] = field(default_factory=dict)  # :mod:`baselines.monitors`

    @classmethod
    def untrained(
        cls,
        belief: PlantModel,
        layout: ObservationLayout,
        hidden: int,
        baseline: str = AdaptiveDualLoop.name,
    ) -> StudentPolicy:
        """Return a policy that adds nothing to the controller with its committed settings."""
        plain, _ = FEEDFORWARDS[checked_baseline(baseline)]
        feedforward = plain(belief, layout)
        return cls(
            Student.blank(input_count(feedforward), hidden, WEIGHTED),
            layout,
            tuple(sorted(effect.name for effect in belief.effects)),
            AdaptiveDualLoop(belief, layout).settings,
            feedforward.settings,
            baseline,
        )

    def save(self, folder: Path) -> Path:
        """Write ``policy.json`` and ``weights.npz``; what was in the folder is replaced as a whole.

        Weights that half precision holds, as those of :meth:`Student.rounded_to_half`, are written in it.
        """
        weights = io.BytesIO()
        kept = {
            name: each if name in SCALES else _shortest(each)
            for name, each in self.student.arrays.items()
        }
        np.savez(weights, **kept)  # type: ignore[arg-type]  # arrays by name
        document = {
            "format": FORMAT,
            "version": VERSION,
            "corrects": self.baseline,
            "layout": self.layout.to_dict(),
            "effects": list(self.effects),
            "loop": dict(self.loop),
            "feedforward": dict(self.feedforward),
            "weighted": self.student.weighted,
            "training": dict(self.training),
            **({"seen": dict(self.seen)} if self.seen else {}),
        }
        return write_policy(folder, WEIGHTS, weights.getvalue(), document)

    @classmethod
    def load(cls, folder: Path) -> StudentPolicy:
        """Read a policy; no code in its files is executed."""
        folder = settled_folder(folder)
        source = folder / DESCRIPTION
        document = read_json(source, FORMAT, VERSION)
        if document["version"] < VERSION:
            raise InputError(
                f"{source} is of an earlier release, whose students saw another residual; teach it again: "
                "its training.command says how"
            )
        with reading("student", source):
            layout = dict(document["layout"])
            low, high = layout.pop("command_range_V")
            weighted = document["weighted"]
            if weighted != WEIGHTED:
                raise InputError(f"weighted is {quoted(weighted)}; this release reads {WEIGHTED}")
            return cls(
                Student(_arrays(folder / WEIGHTS, document["weights_sha256"]), WEIGHTED),
                ObservationLayout.from_dict(
                    {**layout, "command_range_V": (float(low), float(high))}
                ),
                tuple(map(str, document["effects"])),
                checked_settings(AdaptiveDualLoop.name, AdaptiveDualLoop.knobs, document["loop"]),
                checked_settings(
                    CorrectedAdaptive.name, CorrectedAdaptive.knobs, document["feedforward"]
                ),
                checked_baseline(document["corrects"]),
                dict(document["training"]),
                checked_envelope(document.get("seen")),
            )


def _shortest(weights: Float32) -> NDArray[np.floating[Any]]:
    """Return weights in half precision where that holds them."""
    half = weights.astype(np.float16)
    return half if np.array_equal(half, weights) else weights


def _arrays(path: Path, sha256: str) -> dict[str, Any]:
    check_digest(read_bytes(path, _LARGEST), sha256, path.name)
    try:
        with open_npz(path) as archive:
            return {name: archive.read(name).astype(np.float32) for name in ARRAYS}
    except Exception as error:  # a damaged archive raises whatever its reader trips over
        raise InputError(f"{path.name} holds no arrays of a student ({quoted(error)})") from error


class StudentController(AdaptiveDualLoop):
    """A student with the controller that it corrects, at the sampling time of its training.

    The base runs with the settings that the student was taught on.
    """

    def __init__(
        self,
        policy: StudentPolicy,
        belief: PlantModel,
        layout: ObservationLayout,
        on_decision: OnDecision | None = None,
    ) -> None:
        policy.check_runs(layout)
        self.policy, self._on_decision = policy, on_decision
        super().__init__(belief, layout, policy.loop)
        self.plant_samples += int(policy.training.get("at_timesteps", 0))

    def adaptive(self, belief: PlantModel, layout: ObservationLayout) -> CorrectedAdaptive:
        """Return the feedforward with the student beside it."""
        policy = self.policy
        _, kind = FEEDFORWARDS[policy.baseline]
        return kind(belief, layout, policy.feedforward, policy.student, self._on_decision)

    @property
    def needed_preview(self) -> int:
        """Samples that the student sees, or the feedforward needs."""
        return max(PREVIEW, super().needed_preview)

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """See :meth:`baselines.base.Baseline.next_command`."""
        check_preview(self.layout, PREVIEW)
        return super().next_command(observation, reference_um, state)

    def certificate(self) -> str | None:
        """Return what is certain of the feedback; of what a network adds only the bound is."""
        line = super().certificate()
        return line and f"{line}; the student adds {MOST_UM:.3g} µm at most"

    def warning(self) -> str | None:
        """Return one line where it was taught on another belief, amplitude or command range."""
        taught, layout = self.policy.layout, self.layout
        if sorted(e.name for e in self.belief.effects) != list(self.policy.effects):
            return f"taught on a belief with {', '.join(self.policy.effects) or 'no effects'}"
        if not is_like(layout, taught):
            return f"taught for {taught.scale_um:g} µm"
        return super().warning()
