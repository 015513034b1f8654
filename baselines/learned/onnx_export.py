"""Trained policies as ONNX files, which run without torch and without this package."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from torch import nn

from baselines.adaptive_feedforward import (
    HALF,
    MOST,
    POWERS,
    PRODUCTS,
    ROUNDING,
    SPLINE,
    AdaptiveFeedforward,
)
from baselines.classical import ClassicalReferenceRate, pack_inverse
from baselines.learned.imitation.policy import (
    CORRECTIONS,
    COURSE,
    ERRORS,
    MOST_UM,
    PREVIEW,
    UNIT_UM,
    Student,
    StudentBankFeedforward,
    StudentController,
    StudentFeedforward,
    StudentPolicy,
)
from baselines.learned.onnx_graph import Graph, Signal, check_file, content
from baselines.learned.policy import Policy
from baselines.least_squares import SOLVE_EVERY, ForgettingLeastSquares
from baselines.monitors import GROWTH, RingingMonitor
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.tasks import named_task
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic

INPUT, OUTPUT = "observation", "action"


def network_model(policy: Policy) -> Any:
    """Return scaling and actor as an ONNX model, for any number of lanes.

    Differences of nearly equal numbers are taken in double precision, so that runtimes that add in
    another order agree; the network itself runs in single precision.
    """
    graph = Graph(np.float32)
    shown = graph.input(INPUT, policy.scaling.history.size)
    x = (shown.cast(np.float64) @ policy.scaling.matrix.astype(np.float64)).cast(np.float32)
    for module in policy.actor:
        if isinstance(module, nn.Linear):
            x = x @ module.weight.detach().numpy().T + module.bias.detach().numpy()
        elif isinstance(module, nn.Hardtanh):
            x = x.clip(np.float32(-1.0), np.float32(1.0))
        elif isinstance(module, nn.SiLU):
            x = x * x.sigmoid()
        else:
            x = graph.call(
                {"ReLU": "Relu", "ELU": "Elu"}.get(kind := type(module).__name__, kind), x
            )
    return graph.model({OUTPUT: x})


def description(policy: Policy) -> dict[str, Any]:
    """Return what a caller needs to know of the input and the output, as JSON holds it.

    ``observation`` names the entries of the input, k being the present sample; displacements and
    commands are scaled as ``layout`` says.
    """
    layout = policy.layout
    return {
        "format": "rdpi-policy-onnx",
        "version": 1,
        "layout": layout.to_dict(),
        "history": policy.history,
        "observation": policy.scaling.history.entries,
        "baseline": policy.baseline,
    }


def export_onnx(policy: Policy, out: Path) -> Path:
    """Write the deterministic actor, with its scaling, as one ONNX file.

    Input ``observation``, float32 ``(batch, size)``: the environment's observation with its history
    behind, as :class:`rdpi_gym.envs.wrappers.history.History` stacks it, not scaled. Output ``action``,
    float32 ``(batch, 1)`` in [-1, 1]. The metadata holds :func:`description`.
    """
    check_file(out)
    return write_atomic(out, content(network_model(policy), description(policy)))


def monitor_update(
    monitor: RingingMonitor, memory: Signal, error: Signal, asked: Signal
) -> tuple[Signal, Signal]:
    """Return the memory and whether it rings: :meth:`~baselines.monitors.RingingMonitor.watch`."""
    passes, fast, slow, withdraw, returns, small, large = monitor.numbers
    before = [memory[:, i : i + 1] for i in range(monitor.rows)]

    def moved(row: int, share: float, towards: Signal | float) -> Signal:
        return before[row] + share * (towards - before[row])

    errors, references = [], []
    for stage in range(2):
        errors.append(moved(stage, passes, error))
        references.append(moved(2 + stage, passes, asked))
        error, asked = error - errors[-1], asked - references[-1]
    squared = error * error
    quick, lasting = moved(4, fast, squared), moved(5, slow, squared)
    usual = moved(6, fast, asked * asked)
    grows = (quick > GROWTH * lasting) | (quick > large)
    ringing = (quick > small) & (quick > usual) & grows
    trust = memory.graph.where(ringing, withdraw * before[7], moved(7, returns, 1.0))
    return memory.graph.concat(*errors, *references, quick, lasting, usual, trust), ringing


def reference_features(
    made: AdaptiveFeedforward, smooth: Signal, plays: Signal, slow: Signal
) -> tuple[Signal, Signal, Signal]:
    """Return what of φ has no derivatives, the plays and the low-passes: ``_features``."""
    layout = made.layout
    place = (smooth - layout.centre_um) / layout.scale_um
    plays = plays.clip(smooth - made.thresholds_um, smooth + made.thresholds_um)
    slow = slow + (1.0 - made.slow) * (smooth - slow)
    products = place * (plays.take(PRODUCTS) - layout.centre_um)
    powers = [layout.scale_um * place**power for power in POWERS]
    found = smooth.graph.concat(smooth, smooth.full_like(1.0), plays, products, *powers, slow)
    return found, plays, slow


def least_squares_update(
    fit: ForgettingLeastSquares, memory: Signal, phi: Signal, z: Signal, counts: Signal
) -> Signal:
    """Return the memory: :meth:`~baselines.least_squares.ForgettingLeastSquares.learn`.

    The equations are solved at every sample: that costs less than a graph that branches.
    """
    where, concat = memory.graph.where, memory.graph.concat
    rows, columns = np.tril_indices(fit.size)
    forget, used = where(counts, fit.kept, 1.0), counts.cast(np.float64)
    new = concat(used * phi.take(rows) * phi.take(columns), used * phi * z)
    sums = forget * memory[:, 1 : -fit.size] + new
    count = memory[:, :1] + used
    due = counts & (count.remainder(SOLVE_EVERY) <= 0.0)
    theta = where(due, _solved(fit, sums), memory[:, -fit.size :])
    return concat(count, sums, theta)


def _solved(fit: ForgettingLeastSquares, sums: Signal) -> Signal:
    """``_solve`` of the least squares; the right side is eliminated as one more column."""
    concat, size = sums.graph.concat, fit.size
    place = np.zeros((size, size), dtype=np.int64)
    place[np.tril_indices(size)] = np.arange(size * (size + 1) // 2)
    left = sums.take(np.maximum(place, place.T)) + np.diag(fit.precision)
    rest = concat(left, (sums[:, -size:] + fit.pull).unsqueeze(2))
    rows: list[Signal] = []
    for least in fit.precision:
        row = rest[:, :1, 1:]
        rows.append(row / rest[:, :1, :1].maximum(least))
        rest = rest[:, 1:, 1:] - rows[-1][:, :, :-1].transpose() * row
    theta = rows.pop()
    for row in reversed(rows):
        theta = concat(row[:, :, -1:] - (row[:, :, :-1] * theta).sum(), theta)
    return theta.squeeze(1)


def least_squares_fade(fit: ForgettingLeastSquares, memory: Signal, share: Signal) -> Signal:
    """Return the memory: :meth:`~baselines.least_squares.ForgettingLeastSquares.unlearn`."""
    theta = share * memory[:, -fit.size :] + (1.0 - share) * fit.prior
    return memory.graph.concat(memory[:, :1], share * memory[:, 1 : -fit.size], theta)


def inverse_command(
    inverse: ClassicalReferenceRate, wanted: Signal, memory: Signal
) -> tuple[Signal, Signal]:
    """Return the command (V) and the memory: :meth:`~baselines.feedforward.Feedforward.next_command`."""
    model, ts_s = inverse.model, inverse.layout.ts_s
    gain, *numbers, shift, _, offset = pack_inverse([model], ts_s)[:, 0].tolist()
    weights, thresholds = np.array(numbers[: model.n]), np.array(numbers[model.n :])
    rate = (wanted - memory[:, -1:]) / (ts_s * model.A)
    x, reach = wanted - inverse.belief.offset_um, thresholds + shift * abs(rate)
    plays = memory[:, 2:-1].clip(x - reach, x + reach)
    low, high, _ = inverse.limits
    command = (gain * x + offset + (weights * plays).sum()).clip(low, high)
    return command, wanted.graph.concat(command, memory[:, 1:2], plays, wanted)


def student_correction(
    student: Student, seen: Signal, error: Signal, memory: Signal
) -> tuple[Signal, Signal]:
    """Return the correction (µm) and the memory: :meth:`~baselines.learned.imitation.policy.Student.answer_um`.

    Python rounds to single precision within; here nothing is.
    """
    concat, width = seen.graph.concat, student.width
    p = {name: array.astype(np.float64) for name, array in student.arrays.items()}
    scaled = (seen - p["middle"]) / p["spread"]
    before, errors, corrections = (
        memory[:, first : first + count]
        for first, count in ((0, width), (width, ERRORS - 1), (width + ERRORS, CORRECTIONS))
    )
    errors = concat(error / UNIT_UM, errors)
    past = concat(errors, corrections)
    given = scaled.asinh() @ p["into"].T + p["bias"] + past.asinh() @ p["past"].T
    back = before @ p["hidden"].T + p["hidden_bias"]
    gates = (given[:, : 2 * width] + back[:, : 2 * width]).sigmoid()
    reset, keep = gates[:, :width], gates[:, width:]
    fresh = (given[:, 2 * width :] + reset * back[:, 2 * width :]).tanh()
    after = fresh + keep * (before - fresh)
    weights = after @ p["head"].T + p["head_bias"]
    phi = concat(scaled[:, : student.weighted], error.full_like(1.0), errors)
    most = MOST_UM / UNIT_UM
    correction = most * ((weights * phi).sum() / most).tanh()
    return UNIT_UM * correction, concat(after, errors, correction, corrections[:, :-1])


FARTHEST = 1000.0
"""Largest sum of the inputs' distances (scales, ranges of the command) that is used."""


def step_model(made: StudentController) -> Any:
    """Return the controller's ``next_command`` as an ONNX model, for any number of lanes.

    Inputs, float64: ``reference_um`` ``(batch, preview + 1)``, r(k) and what follows; ``measured_um``
    and ``applied_V`` ``(batch,)``, measured and commanded at k; ``state`` ``(batch, S)``, zeros where
    an episode begins. Outputs: ``command_V`` ``(batch,)``, u(k+1), and ``next_state``. Where an input is
    not finite or absurdly large, command and state stay as they are.
    """
    graph, layout, limits = Graph(), made.layout, made.limits
    reference = graph.input("reference_um", layout.preview + 1)
    measured, applied = (graph.input(name).unsqueeze(1) for name in ("measured_um", "applied_V"))
    started = made.start(np.array([0.0, 1.0])).T
    state = graph.input("state", started.shape[1])
    # at rest the memory is affine in the first reference
    rest = started[:1] + (started[1:] - started[:1]) * reference[:, :1]
    step = _Step(made, reference, measured, applied)
    command, after = step.run(state, rest)
    far = (abs(graph.concat(reference, measured) - layout.centre_um) / layout.scale_um).sum()
    far = far + abs(applied - limits.rest_V) / (limits.high_V - limits.low_V)
    usable = far <= FARTHEST
    return graph.model(
        {
            "command_V": graph.where(usable, command, applied).squeeze(1),
            "next_state": graph.where(usable, after, state),
        }
    )


class _Step:
    """The methods of the controller, each with what it changes of the memory."""

    def __init__(
        self, made: StudentController, reference: Signal, measured: Signal, applied: Signal
    ) -> None:
        taught = made.inverse
        assert isinstance(taught, StudentFeedforward)
        if isinstance(taught, StudentBankFeedforward):
            raise InputError(
                f"the student corrects {made.policy.baseline}, whose inverse is a search: ONNX takes one of "
                "adaptive-dual-loop, rdpi export c takes any"
            )
        inverse = taught.inverse
        if not isinstance(inverse, ClassicalReferenceRate):
            raise InputError(
                f"belief {made.belief.name} has the core {made.belief.hysteresis.name}, whose inverse is "
                "a search: ONNX takes the core rdpi, rdpi export c takes any"
            )
        self.made, self.taught, self.inverse = made, taught, inverse
        self.reference, self.measured, self.applied = reference, measured, applied
        self.of: dict[str, Signal] = {}

    def run(self, state: Signal, rest: Signal) -> tuple[Signal, Signal]:
        """Return the command (V) and the memory: ``next_command`` of the linear feedback."""
        made, where = self.made, state.graph.where
        places = self._places()
        state = where(state[:, places[".count"]] > 0.0, state, rest)
        of = self.of = {name: state[:, place] for name, place in places.items()}
        asked = self.reference[:, :1]
        error = asked - self.measured
        of["monitor"], ringing = monitor_update(made.monitor, of["monitor"], error, asked)
        # the feedforward's monitor watches the same
        of[".monitor"] = of["monitor"]
        allowed = of["allowed"]
        risen = allowed + made.returns * (1.0 - allowed)
        of["allowed"] = where(ringing, made.falls * allowed, risen)
        system, own, given = made.feedback, of["feedback"], error * of["allowed"]
        correction = own @ system.c[:, None] + system.d * given
        command = self._corrected(ringing, error, correction)
        low, high, _ = made.limits
        stands = ((command >= high) & (given > 0.0)) | ((command <= low) & (given < 0.0))
        of["feedback"] = where(stands, own, own @ system.a.T + given * system.b)
        return command, state.graph.concat(*of.values())

    def _places(self) -> dict[str, slice]:
        """Return the slices of the memory's parts, in their order; a dot before those of the feedforward."""
        rows = np.arange(self.made.rows.total, dtype=np.float64)
        within = self.made.rows.of(rows, "inverse")
        own, student = np.split(within, [self.taught.rows.total])
        parts = {name: self.made.rows.of(rows, name) for name in ("feedback", "monitor", "allowed")}
        parts |= {f".{name}": self.taught.rows.of(own, name) for name in self.taught.rows.counts}
        ends = np.cumsum([len(part) for part in (*parts.values(), student)]).tolist()
        starts = [0, *ends]
        return {
            name: slice(first, last)
            for name, first, last in zip((*parts, "student"), starts, ends, strict=False)
        }

    def _corrected(self, ringing: Signal, error: Signal, correction: Signal) -> Signal:
        """``corrected_command`` of the adaptive feedforward with a student."""
        of, concat = self.of, error.graph.concat
        smooth, wanted = self._wanted(ringing)
        seen = self._seen(smooth, wanted)
        added, of["student"] = student_correction(self.taught.student, seen, error, of["student"])
        total = wanted + correction + added
        of[".wanted"] = concat(of[".wanted"][:, 1:], total)
        command, of[".inverse"] = inverse_command(self.inverse, total, of[".inverse"])
        return command

    def _wanted(self, ringing: Signal) -> tuple[Signal, Signal]:
        """Return what the window of the reference is without its noise, and ``wanted_um``."""
        of, taught, graph = self.of, self.taught, ringing.graph
        spline = self.reference.take(taught.window) @ SPLINE.T
        smooth, derivatives = spline[:, :1], spline[:, 1:]
        static, of[".plays"], of[".slow"] = reference_features(
            taught, smooth, of[".plays"], of[".slow"]
        )
        size = taught.fit.size - (len(SPLINE) - 1)
        of[".seen"] = graph.concat(of[".seen"][:, size:], static)
        of[".measured"] = graph.concat(of[".measured"][:, 1:], self.measured)
        of[".count"] = of[".count"] + 1.0
        low, high, _ = taught.limits
        room = ROUNDING * (high - low)
        free = (self.applied > low + room) & (self.applied < high - room)
        of[".last_V"] = self.applied
        counts = ~ringing & free & (of[".count"] > taught.lead + 2 * HALF + 2)
        fit = least_squares_update(taught.fit, of[".fit"], *self._compared(), counts)
        trust = of[".monitor"][:, -1:]
        of[".fit"] = least_squares_fade(taught.fit, fit, graph.where(ringing, trust, 1.0))
        phi = graph.concat(derivatives, static)
        believed = (taught.fit.prior * phi).sum()
        correction = believed + trust * ((self._theta * phi).sum() - believed)
        most = MOST * taught.layout.scale_um
        return smooth, smooth + correction.clip(-most, most)

    @property
    def _theta(self) -> Signal:
        return self.of[".fit"][:, -self.taught.fit.size :]

    def _compared(self) -> tuple[Signal, Signal]:
        """``compared`` of the adaptive feedforward."""
        of, size = self.of, self.taught.fit.size - (len(SPLINE) - 1)
        spline = of[".measured"] @ SPLINE.T
        entered = of[".wanted"][:, : 2 * HALF + 1] @ SPLINE[:1].T
        return spline.graph.concat(spline[:, 1:], of[".seen"][:, :size]), entered - spline[:, :1]

    def _seen(self, smooth: Signal, wanted: Signal) -> Signal:
        """Return the inputs of the student."""
        of, taught, layout = self.of, self.taught, self.taught.layout
        course = (self.reference[:, : PREVIEW + 1] - layout.centre_um) / layout.scale_um @ COURSE.T
        plays = (of[".plays"] - smooth) / taught.thresholds_um
        slow = (of[".slow"] - smooth) / layout.scale_um
        theta = self._theta
        phi, z = self._compared()
        left = (z - (theta * phi).sum()) / UNIT_UM
        known = (theta - taught.fit.prior) / taught.fit.spread
        own = (wanted - smooth) / layout.scale_um
        since = taught.fades[:, 0] ** of[".count"]
        return smooth.graph.concat(course, plays, slow, known, left, own, since)


def controller_on(policy: StudentPolicy, belief: PlantModel | None) -> StudentController:
    """Return a student's controller with as much preview as it makes use of."""
    if belief is None:
        task = policy.training.get("task")
        if not isinstance(task, str):
            raise InputError(
                "belief is needed: the student does not say on what task it was taught"
            )
        belief, layout = named_task(task.partition(",")[0]).belief(), policy.layout
    else:
        belief = limit_band(belief)
        layout = ObservationLayout.for_plant(belief, policy.layout.ts_s, policy.layout.preview)
    layout = replace(layout, action="command")
    needed = StudentController(policy, belief, layout).needed_preview
    return StudentController(policy, belief, replace(layout, preview=needed))


def step_description(made: StudentController) -> dict[str, Any]:
    """Return what a caller needs to know of a step, as JSON holds it."""
    layout, limits, policy = made.layout, made.limits, made.policy
    numbers = made.rows.total
    return {
        "format": "rdpi-student-onnx",
        "version": 1,
        "holds": (
            f"{policy.baseline} with its student, the whole controller on belief {made.belief.name}: "
            f"a step every {layout.ts_s:g} s, {numbers} numbers of state"
        ),
        "inputs": {
            "reference_um": f"r(k) ... r(k+{layout.preview}) (µm)",
            "measured_um": "measured at k (µm)",
            "applied_V": f"command that holds at k (V); {limits.rest_V:g} where an episode begins",
            "state": f"next_state of the step before; {numbers} zeros where an episode begins",
        },
        "outputs": {
            "command_V": "u(k+1) (V), within the range",
            "next_state": "state of the next step",
        },
        "ts_s": layout.ts_s,
        "preview": layout.preview,
        "state": numbers,
        "command_range_V": [limits.low_V, limits.high_V],
        "rest_V": limits.rest_V,
        "centre_um": layout.centre_um,
        "scale_um": layout.scale_um,
        "corrects": policy.baseline,
        "loop": dict(policy.loop),
        "feedforward": dict(policy.feedforward),
        "belief": made.belief.to_dict(),
        "certificate": made.certificate(),
        "warning": made.warning(),
    }


def export_student(policy: StudentPolicy, out: Path, belief: PlantModel | None = None) -> Path:
    """Write a student with the controller that it corrects as one ONNX file.

    A step is :func:`step_model`; the metadata holds
    :func:`step_description`.
    """
    check_file(out)
    made = controller_on(policy, belief)
    return write_atomic(out, content(step_model(made), step_description(made)))
