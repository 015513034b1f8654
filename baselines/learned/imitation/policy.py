"""Student policy: description and arrays in a folder, and its controller."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.base import Observation
from baselines.damping import AdaptiveDualLoop, CorrectedAdaptive
from baselines.learned.imitation.student import (
    ARRAYS,
    MOST_UM,
    PREVIEW,
    SCALES,
    WEIGHTED,
    Float32,
    OnDecision,
    Student,
    StudentFeedforward,
    input_count,
)
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
    training: Mapping[str, Any] = field(default_factory=dict)  # record for a reader
    seen: Mapping[str, float] = field(default_factory=dict)  # :mod:`baselines.monitors`

    @classmethod
    def untrained(cls, belief: PlantModel, layout: ObservationLayout, hidden: int) -> StudentPolicy:
        """Return a policy that adds nothing to the controller with its committed settings."""
        feedforward = CorrectedAdaptive(belief, layout)
        return cls(
            Student.blank(input_count(feedforward), hidden, WEIGHTED),
            layout,
            tuple(sorted(effect.name for effect in belief.effects)),
            AdaptiveDualLoop(belief, layout).settings,
            feedforward.settings,
        )

    @property
    def baseline(self) -> str:
        """Name of the controller that it corrects."""
        return AdaptiveDualLoop.name

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
        return StudentFeedforward(
            belief, layout, policy.feedforward, policy.student, self._on_decision
        )

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
        if (taught.scale_um, taught.command_range_V) != (layout.scale_um, layout.command_range_V):
            return f"taught for {taught.scale_um:g} µm"
        return super().warning()
