"""What is studied: which agents are trained, how long, and on what they are scored."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from baselines import CONTROLLERS, inverts_any_core, inverts_effects
from rdpi_gym.envs.layout import ActionMode

BASELINE = "inversion-free-low-passed"
"""What corrections correct, and what trainings are compared with: the best causal compensator on plants
with all effects, where PI with a belief that lacks them is unstable."""


@dataclass(frozen=True)
class Agent:
    """An algorithm and a reading of its actions.

    Parameters
    ----------
    algorithm
        Of Stable-Baselines3.
    action
        ``correction``: of :data:`BASELINE`; ``increment``: of the command alone.
    """

    algorithm: Literal["ppo", "sac"]
    action: ActionMode

    @property
    def name(self) -> str:
        """What tables and folders call it."""
        return f"{self.algorithm}-{self.action}"


@dataclass(frozen=True)
class Study:
    """Options of the study; the comment under each says what it does."""

    agents: tuple[Agent, ...] = (
        Agent("ppo", "correction"),
        Agent("ppo", "increment"),
        Agent("sac", "correction"),
        Agent("sac", "increment"),
    )
    # Each is trained with every seed.
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    # Of weights, exploration, plants, references and noise of the trainings.
    timesteps: int | None = None
    # Steps of a training; None: `n_timesteps` of the algorithm's hyper-parameters.
    lanes: int | None = None
    # Plants side by side; None: `n_envs` of the hyper-parameters.
    every: int | None = None
    # Steps between evaluations and checkpoints; None: a twentieth of all.
    rivals: tuple[str, ...] = tuple(
        name for name in CONTROLLERS if not (inverts_effects(name) or inverts_any_core(name))
    )
    # What agents are compared with. Without effects in the belief those left out are others' doubles.
    plants: int = 10
    # Held-out plants of a group, each drawn with a seed of its own.
    references: tuple[str, ...] = ("sine", "triangle", "multisine", "raster", "nested-loops")
    # Of the benchmark's suite; sines of 25 to 100 Hz, the others about 20 Hz.
    domains: tuple[str, ...] = ("bare", "with effects", "picma", "picma at 1 Hz")
    # Of the gap, see `worlds.GAP`.
    resamples: int = 2000
    # Of the bootstrap.
    taught: tuple[tuple[str, int], ...] = (
        ("Stage", 28_800_000),
        ("Resonance", 28_800_000),
        ("Creep", 9_600_000),
        ("Lag", 9_600_000),
    )
    # Tasks that students are taught on; one of Creep is the best on Bare too, and for how many steps of all plants together.

    def options(self, agent: Agent, seed: int, out: Path) -> dict[str, Any]:
        """Return what is asked of a training: fields of `TrainingOptions`."""
        return {
            "out": out,
            "seed": seed,
            "timesteps": self.timesteps,
            "lanes": self.lanes,
            "every": self.every,
            "action": agent.action,
            "baseline": BASELINE,
        }


FULL = Study()
"""What the published tables are made of."""

QUICK = Study(
    agents=(Agent("ppo", "correction"), Agent("sac", "increment")),
    seeds=(0,),
    timesteps=512,
    lanes=4,
    every=512,
    rivals=("none", BASELINE, "preview-inversion"),
    plants=2,
    references=("triangle",),
    domains=("bare", "picma"),
    resamples=100,
    taught=(("Bare", 1),),
)
"""Every step of the study in seconds; its agents have learned nothing."""
