"""A sample of a student's controller as an ONNX graph: what is known and remembered in, the command out."""

from __future__ import annotations

from typing import Any

import numpy as np

from baselines.adaptive_feedforward import HALF, MOST, ROUNDING, SPLINE
from baselines.classical import ClassicalReferenceRate
from baselines.learned.imitation.controller import StudentController
from baselines.learned.imitation.step_parts import (
    answered,
    driven,
    features,
    learned,
    unlearned,
    watched,
)
from baselines.learned.imitation.student import UNIT_UM
from baselines.learned.imitation.taught import COURSE, PREVIEW, TaughtAdaptive
from baselines.learned.onnx_graph import Graph, Signal
from rdpi_gym.support.errors import InputError

FARTHEST = 1000.0
"""How far inputs may be away (scales, ranges of the command; all in sum) and still be believed."""


def step_model(made: StudentController) -> Any:
    """Return the controller's ``next_command`` as an ONNX model, for any number of lanes.

    Inputs, float64: ``reference_um`` ``(batch, preview + 1)``, r(k) and what follows; ``measured_um``
    and ``applied_V`` ``(batch,)``, measured and commanded at k; ``state`` ``(batch, S)``, zeros where
    an episode begins. Outputs: ``command_V`` ``(batch,)``, u(k+1), and ``next_state``. Where an input is
    not finite or absurdly large, command and state stay as they are.
    """
    graph, layout, limits = Graph(), made.layout, made.limits
    reference = graph.given("reference_um", layout.preview + 1)
    measured, applied = (graph.given(name).raised(1) for name in ("measured_um", "applied_V"))
    started = made.start(np.array([0.0, 1.0])).T
    state = graph.given("state", started.shape[1])
    # at rest the memory is affine in the first reference
    rest = started[:1] + (started[1:] - started[:1]) * reference[:, :1]
    step = _Step(made, reference, measured, applied)
    command, after = step.taken(state, rest)
    far = (abs(graph.joined(reference, measured) - layout.centre_um) / layout.scale_um).total()
    far = far + abs(applied - limits.rest_V) / (limits.high_V - limits.low_V)
    usable = far <= FARTHEST
    return graph.model(
        {
            "command_V": graph.where(usable, command, applied).lowered(1),
            "next_state": graph.where(usable, after, state),
        }
    )


class _Step:
    """The methods of the controller, each with what it changes of the memory.

    Parameters
    ----------
    made
        The controller.
    reference, measured, applied
        What is known: ``(batch, preview + 1)``, and ``(batch, 1)``.
    """

    def __init__(
        self, made: StudentController, reference: Signal, measured: Signal, applied: Signal
    ) -> None:
        taught = made.inverse
        assert isinstance(taught, TaughtAdaptive)
        inverse = taught.inverse
        if not isinstance(inverse, ClassicalReferenceRate):
            raise InputError(
                f"belief {made.belief.name} has the core {made.belief.hysteresis.name}, whose inverse is "
                "a search: ONNX takes the core rdpi, rdpi export c takes any"
            )
        self.made, self.taught, self.inverse = made, taught, inverse
        self.reference, self.measured, self.applied = reference, measured, applied
        self.of: dict[str, Signal] = {}

    def taken(self, state: Signal, rest: Signal) -> tuple[Signal, Signal]:
        """Return the command (V) and the memory: ``next_command`` of the linear feedback."""
        made, where = self.made, state.graph.where
        places = self._places()
        state = where(state[:, places[".count"]] > 0.0, state, rest)
        of = self.of = {name: state[:, place] for name, place in places.items()}
        asked = self.reference[:, :1]
        error = asked - self.measured
        of["monitor"], ringing = watched(made.monitor, of["monitor"], error, asked)
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
        return command, state.graph.joined(*of.values())

    def _places(self) -> dict[str, slice]:
        """Where the parts of the memory lie, in their order; a stop before those of the feedforward."""
        rows = np.arange(self.made.rows.total, dtype=np.float64)
        within = self.made.rows.of(rows, "inverse")
        own, student = np.split(within, [self.taught.rows.total])
        parts = {name: self.made.rows.of(rows, name) for name in ("feedback", "monitor", "allowed")}
        parts |= {f".{name}": self.taught.rows.of(own, name) for name in self.taught.rows.names}
        ends = np.cumsum([len(part) for part in (*parts.values(), student)]).tolist()
        starts = [0, *ends]
        return {
            name: slice(first, last)
            for name, first, last in zip((*parts, "student"), starts, ends, strict=False)
        }

    def _corrected(self, ringing: Signal, error: Signal, correction: Signal) -> Signal:
        """``corrected_command`` of the adaptive feedforward with a student."""
        of, joined = self.of, error.graph.joined
        smooth, wanted = self._wanted(ringing)
        seen = self._seen(smooth, wanted)
        added, of["student"] = answered(self.taught.student, seen, error, of["student"])
        total = wanted + correction + added
        of[".wanted"] = joined(of[".wanted"][:, 1:], total)
        command, of[".inverse"] = driven(self.inverse, total, of[".inverse"])
        return command

    def _wanted(self, ringing: Signal) -> tuple[Signal, Signal]:
        """Return what the window of the reference is without its noise, and ``wanted_um``."""
        of, taught, graph = self.of, self.taught, ringing.graph
        spline = self.reference.picked(taught.window) @ SPLINE.T
        smooth, derivatives = spline[:, :1], spline[:, 1:]
        static, of[".plays"], of[".slow"] = features(taught, smooth, of[".plays"], of[".slow"])
        size = taught.fit.size - (len(SPLINE) - 1)
        of[".seen"] = graph.joined(of[".seen"][:, size:], static)
        of[".measured"] = graph.joined(of[".measured"][:, 1:], self.measured)
        of[".count"] = of[".count"] + 1.0
        low, high, _ = taught.limits
        room = ROUNDING * (high - low)
        free = (self.applied > low + room) & (self.applied < high - room)
        of[".last_V"] = self.applied
        counts = ~ringing & free & (of[".count"] > taught.lead + 2 * HALF + 2)
        fit = learned(taught.fit, of[".fit"], *self._compared(), counts)
        trust = of[".monitor"][:, -1:]
        of[".fit"] = unlearned(taught.fit, fit, graph.where(ringing, trust, 1.0))
        phi = graph.joined(derivatives, static)
        believed = (taught.fit.prior * phi).total()
        correction = believed + trust * ((self._theta * phi).total() - believed)
        most = MOST * taught.layout.scale_um
        return smooth, smooth + correction.clipped(-most, most)

    @property
    def _theta(self) -> Signal:
        return self.of[".fit"][:, -self.taught.fit.size :]

    def _compared(self) -> tuple[Signal, Signal]:
        """``compared`` of the adaptive feedforward."""
        of, size = self.of, self.taught.fit.size - (len(SPLINE) - 1)
        spline = of[".measured"] @ SPLINE.T
        entered = of[".wanted"][:, : 2 * HALF + 1] @ SPLINE[:1].T
        return spline.graph.joined(spline[:, 1:], of[".seen"][:, :size]), entered - spline[:, :1]

    def _seen(self, smooth: Signal, wanted: Signal) -> Signal:
        """What the student sees."""
        of, taught, layout = self.of, self.taught, self.taught.layout
        course = (self.reference[:, : PREVIEW + 1] - layout.centre_um) / layout.scale_um @ COURSE.T
        plays = (of[".plays"] - smooth) / taught.thresholds_um
        slow = (of[".slow"] - smooth) / layout.scale_um
        theta = self._theta
        phi, z = self._compared()
        left = (z - (theta * phi).total()) / UNIT_UM
        known = (theta - taught.fit.prior) / taught.fit.spread
        own = (wanted - smooth) / layout.scale_um
        since = taught.fades[:, 0] ** of[".count"]
        return smooth.graph.joined(course, plays, slow, known, left, own, since)
