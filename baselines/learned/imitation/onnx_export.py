"""A student with the controller that it corrects as an ONNX file: a step that runs without this package."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from baselines.learned.imitation.controller import StudentController
from baselines.learned.imitation.policy import StudentPolicy
from baselines.learned.imitation.step_graph import step_model
from baselines.learned.onnx_file import check_file, content
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.tasks import named_task
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic

FORMAT, VERSION = "rdpi-student-onnx", 1


def controller_on(policy: StudentPolicy, belief: PlantModel | None) -> StudentController:
    """Return a student's controller with as much preview as it makes use of."""
    if belief is None:
        task = policy.training.get("task")
        if not isinstance(task, str):
            raise InputError(
                "belief is needed: the student does not say on what task it was taught"
            )
        belief, layout = named_task(task).belief(), policy.layout
    else:
        layout = ObservationLayout.for_plant(belief, policy.layout.ts_s, policy.layout.preview)
    layout = replace(layout, action="command")
    needed = StudentController(policy, belief, layout).needed_preview
    return StudentController(policy, belief, replace(layout, preview=needed))


def description(made: StudentController) -> dict[str, Any]:
    """Return what a caller needs to know of a step, as JSON holds it."""
    layout, limits, policy = made.layout, made.limits, made.policy
    numbers = made.rows.total
    return {
        "format": FORMAT,
        "version": VERSION,
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

    A step is :func:`baselines.learned.imitation.step_graph.step_model`; the metadata holds
    :func:`description`.
    """
    check_file(out, ["onnx"])
    made = controller_on(policy, belief)
    return write_atomic(out, content(step_model(made), description(made)))
