"""A program as a level-2 S-function of Simulink: a source file beside its own."""

from __future__ import annotations

from rdpi_gym.firmware.program import Program
from rdpi_gym.firmware.writing.source import safe
from rdpi_gym.firmware.writing.templating import filled, template


def sfunction_text(program: Program) -> str:
    """Return ``rdpi_controller_sfunction.c`` or ``rdpi_plant_sfunction.c``, to be compiled with ``mex``."""
    if program.kind == "plant":
        return filled(template("sfunction_plant.c"), WHAT=f"Plant {safe(program.model)}")
    what = f"Controller {safe(program.title)} for plant {safe(program.model)}"
    return filled(template("sfunction_controller.c"), WHAT=what, PREVIEW=str(program.preview))
