"""Examples of the laboratory: exercises with hidden effects, and measured records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rdpi_gym.measurement import measured_data


@dataclass(frozen=True)
class Example:
    """Something to begin with."""

    key: str
    title: str
    text: str
    kind: str  # ``exercise`` (simulated, effects are hidden) or ``measured``
    records: int
    samples: int
    simulated: Mapping[str, Any] | None = None  # arguments of rdpi_gym.simulate
    folder: str = ""  # of measured records
    settings: Mapping[str, Any] = field(default_factory=dict)  # beside their own dataset.toml

    def to_dict(self) -> dict[str, Any]:
        """Return the object of the list: without what is hidden."""
        keys = ("key", "title", "text", "kind", "records", "samples")
        return {key: getattr(self, key) for key in keys}


def _hidden(key: str, title: str, text: str, **simulated: Any) -> Example:
    samples = 138_000 if simulated["ts_factor"] == 1.0 else 34_500
    return Example(key, title, text, "exercise", 16, samples, simulated)


_EXERCISES = (
    _hidden(
        "one-effect", "One hidden effect", "A stage of which one effect is kept secret.",
        model="P5", hide=["creep"], seed=1, ts_factor=4.0,
    ),
    _hidden(
        "two-effects", "Two hidden effects", "What two effects leave looks like neither alone.",
        model="P10", hide=["creep", "resonance"], seed=3, ts_factor=1.0,
    ),
    _hidden(
        "loops-open", "Loops that lean", "Where the displacement falls short, and on which side.",
        model="P10", hide=["asymmetry", "actuator_lag"], seed=5, ts_factor=4.0,
    ),
    _hidden(
        "nothing", "Perhaps nothing", "Not every model misses something.",
        model="P5", hide=[], seed=2, ts_factor=4.0,
    ),
)  # fmt: skip
_MEASURED = (
    Example(
        "picma", "A PICMA stack, measured", "P-885.91, 1 Hz, 200 Hz sampling; one record to fit.",
        "measured", 2, 21_782, folder="picma",
    ),
    Example(
        "friction-damper", "A friction damper, measured", "Displacement to force, sines and quakes.",
        "measured", 12, 52_537, folder="friction_damper",
        settings={"quantities": {
            "input": {"name": "displacement", "symbol": "x", "unit": "mm"},
            "output": {"name": "force", "symbol": "F", "unit": "kN"},
        }},
    ),
)  # fmt: skip


def examples() -> list[Example]:
    """Return the exercises, and the measured records that are here."""
    return [*_EXERCISES, *(example for example in _MEASURED if folder_of(example))]


def folder_of(example: Example) -> Path | None:
    """Return the folder of measured records; None where they are not here."""
    return measured_data(example.folder) if example.folder else None
