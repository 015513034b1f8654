"""One controller on lanes of tracking problems, recorded sample by sample, and the scores of a run."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.tracking.case import Case
from benchmarks.tracking.stages import COVERED
from rdpi_gym.envs import ObservationLayout, TrackingTask
from rdpi_gym.envs.controller import Controller, warning_of
from rdpi_gym.envs.tracking import NoiseSource
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.words import number

WARM_SAMPLES, TIMED_SAMPLES = 5, 300
"""Decisions before those that are timed, and these."""
_GIVEN_UP_S, _FEWEST = 1.0, 3
BLOCK = 20
"""Decisions of one mean: solutions that come every few samples are in each."""


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
    """Time one decision (µs) of a controller that runs one plant: the least mean of a block of many.

    It is the processor time of the process in which the controller runs, and other work on the
    machine, which takes the caches away, can only lengthen it. The first decisions, in which kernels
    are compiled, do not count; one that is very slow is given up early.
    """
    task = TrackingTask(truth, layout)
    observation = task.reset(reference_um[:, None], [np.random.default_rng(0)])
    plan = getattr(controller, "plan", None)
    if plan is not None:
        plan(reference_um[:, None])
    clock: Callable[[], float] = getattr(controller, "processor_s", time.process_time)
    starts = np.ones(1, dtype=bool)
    state, spent = None, list[float]()
    for k in range(min(WARM_SAMPLES + TIMED_SAMPLES, len(reference_um) - 1)):
        begin = clock()
        answer, state = controller.predict(observation, state, starts, deterministic=True)
        if k >= WARM_SAMPLES:
            spent.append(clock() - begin)
        if len(spent) >= _FEWEST and len(spent) * np.median(spent) > _GIVEN_UP_S:
            break
        action = np.clip(np.reshape(answer, 1).astype(np.float64), -1.0, 1.0)
        observation = task.step(layout.place_to_V(action))
        starts = np.zeros(1, dtype=bool)
    blocks = range(0, max(1, len(spent) - BLOCK + 1), BLOCK)
    return 1e6 * min(float(np.mean(spent[first : first + BLOCK])) for first in blocks)


def timed_recording(
    make: Callable[[Sequence[PlantModel]], Controller],
    truths: Sequence[PlantModel],
    layout: ObservationLayout,
    references_um: Array,
    rngs: Sequence[np.random.Generator],
) -> tuple[Recording, str | None, float]:
    """Run a controller on B plants; with its warning, and its time for a decision (µs) on the first."""
    timed = microseconds_per_sample(make(truths[:1]), truths[0], layout, references_um[:, 0])
    controller = make(truths)
    recording = record(controller, truths, layout, references_um, rngs)
    return recording, warning_of(controller), timed


BELOW_NOISE = "below sensor noise"


def shown_error(value: float, error: float, noise: float, digits: int = 3) -> str:
    """Write a value of an error, if the sensor with that noise (rms, in the error's unit) shows it at all."""
    return BELOW_NOISE if error < noise else number(value, digits)


ERROR, DIVERGED, UNSTABLE, SATURATED, EXTRAPOLATED, WARNED = (
    "error", "diverged", "unstable", "saturated", "extrapolated", "warned",
)  # fmt: skip
MEANING = {
    ERROR: "the controller raised an error or answered with NaN; the row has no numbers",
    DIVERGED: "the error is larger than that of standing still",
    UNSTABLE: "the controller says that it is outside its stability limit",
    SATURATED: "some samples of the action lie at the end of the command range",
    EXTRAPOLATED: f"the command is faster than {COVERED:g} times the fastest that the plant was "
    "identified with, so the plant itself is a guess there",
    WARNED: "the controller says something else of itself",
}
"""First words of a status, worst first, and their meaning."""


@dataclass(frozen=True)
class Score:
    """Scores of one run over its scored samples."""

    # root mean square and largest tracking error (µm)
    rmse_um: float
    # the same in percent of the reference's peak to peak
    rmse_percent: float
    max_um: float
    max_percent: float
    command_variation_V_s: float  # total variation of the command per second (V/s)
    max_command_step_V: float  # largest change of the command from one sample to the next (V)
    # samples (%) whose action lies at the end of the command range or beyond
    saturated_percent: float


def score(
    reference_um: Array,
    displacement_um: Array,
    command_V: Array,
    action: Array,
    *,
    first: int,
    ts_s: float,
) -> Score:
    """Score one run from sample `first` on."""
    reference = reference_um[first:]
    error = displacement_um[first:] - reference
    to_percent = 100.0 / np.ptp(reference)
    steps = np.abs(np.diff(command_V[first - 1 :]))
    rmse, largest = np.sqrt(np.mean(error**2)), np.abs(error).max()
    return Score(
        float(rmse),
        float(rmse * to_percent),
        float(largest),
        float(largest * to_percent),
        float(steps.sum() / (ts_s * steps.size)),
        float(steps.max()),
        float(100.0 * np.mean(np.abs(action[first:]) >= 1.0)),
    )


@dataclass(frozen=True)
class Caution:
    """One thing to beware of."""

    word: str  # a key of `MEANING`
    text: str  # what it is here

    def __str__(self) -> str:
        return f"{self.word}: {self.text}"


def cautions(
    scored: Score,
    reference_um: Array,
    *,
    warning: str | None,
    ts_s: float,
    identified_V_s: float | None,
) -> tuple[Caution, ...]:
    """Return what a score alone does not say: what to beware of."""
    found = []
    if warning:
        word = UNSTABLE if "stability limit" in warning else WARNED
        found.append(Caution(word, one_line(warning)))
    if scored.rmse_um > np.std(reference_um):
        found.append(Caution(DIVERGED, "the error is larger than that of standing still"))
    if scored.saturated_percent > 0.0:
        share = f"{scored.saturated_percent:.3g} %"
        found.append(Caution(SATURATED, f"{share} of the samples at the end of the command range"))
    rate = scored.max_command_step_V / ts_s
    if identified_V_s is not None and rate > COVERED * identified_V_s:
        text = f"command rate up to {rate:.3g} V/s, the plant was identified up to {identified_V_s:.3g} V/s"
        found.append(Caution(EXTRAPOLATED, text))
    return tuple(found)


def status(
    scored: Score,
    reference_um: Array,
    *,
    warning: str | None,
    ts_s: float,
    identified_V_s: float | None,
) -> str:
    """Return the status of a score: ``ok``, or its cautions in words."""
    found = cautions(
        scored, reference_um, warning=warning, ts_s=ts_s, identified_V_s=identified_V_s
    )
    return "; ".join(map(str, found)) or "ok"


def score_lane(
    case: Case,
    ts_s: float,
    references_um: Array,
    recording: Recording,
    lane: int,
    *,
    warning: str | None,
    identified_V_s: float | None,
) -> tuple[Score, str]:
    """Return the score of one lane of a recording, and its status."""
    first, end = case.window(ts_s)
    parts = (references_um, recording.displacement_um, recording.command_V, recording.action)
    r, y, u, action = (part[:end, lane] for part in parts)
    scored = score(r, y, u, action, first=first, ts_s=ts_s)
    return scored, status(
        scored, r[first:], warning=warning, ts_s=ts_s, identified_V_s=identified_V_s
    )


def one_line(text: object) -> str:
    r"""Fold any text to one part of a status: one line of at most 200 characters, no semicolon."""
    folded = " ".join(str(text).replace(";", ",").split())
    return folded if len(folded) <= 200 else f"{folded[:199]}…"


def words(statuses: Sequence[str]) -> set[str]:
    """Return the short words that statuses begin their parts with."""
    parts = {part.split(":")[0] for text in statuses for part in text.split("; ")}
    return parts - {"ok"}


def tally(statuses: Sequence[str]) -> str:
    """Count the rows with each word in their status, worst first; ``ok`` where there is none."""
    counts = Counter(word for text in statuses for word in words([text]))
    shares = [f"{word} {counts[word]}/{len(statuses)}" for word in MEANING if counts[word]]
    return ", ".join(shares) or "ok"
