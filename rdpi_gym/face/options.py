"""Options of data and of searches, for functions and commands alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field
from os import PathLike
from typing import TYPE_CHECKING

from rdpi_gym.measurement.loading import EXAMPLES, example_folder
from rdpi_gym.measurement.options import DataOptions
from rdpi_gym.support.checks import check_type
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.options import Option
from rdpi_gym.support.progress import Progress

if TYPE_CHECKING:
    from rdpi_gym.diagnosis.search.plants import OnCandidate
    from rdpi_gym.face.catalogues import HasPlant
    from rdpi_gym.plant import PlantModel
    from rdpi_gym.plant.effects import Effect

__all__ = ["EXAMPLES", "CandidateOptions", "DataOptions", "SearchOptions", "example_folder"]


@dataclass(frozen=True)
class SearchOptions:
    """Options of every search: :func:`rdpi_gym.add` has these.

    Parameters
    ----------
    model
        The model to start from, a plant file as `rdpi fit` writes it or a plant's name; its effects
        are kept and refitted. Without it a search fits the bare model; an addition needs it.
    core
        The kind of hysteresis, a core's name; "auto" for the one of all that explains records held
        out best. Without it that of the model, or RDPI as long as no other is clearly better where
        loops turn clockwise or much is left.
    seed
        Seed of every random draw.
    jobs
        Processes that refit candidates; -1: one for each core.
    resume
        File that keeps finished candidates, so that an interrupted search goes on.
    progress
        Called as ``progress(stage, done, total)``.
    on_candidate
        Called with a :class:`rdpi_gym.Refit` as soon as a model is refitted.

    Raises
    ------
    InputError
        A value of another type, a seed below 0, a number of processes that there cannot be.

    Examples
    --------
    >>> SearchOptions("P10", jobs=2).seed
    0
    """

    model: PlantModel | HasPlant | PathLike[str] | str | None = field(
        default=None, metadata=Option("--model", "M").metadata
    )
    _: KW_ONLY
    core: str | None = field(default=None, metadata=Option("--core", "NAME|auto").metadata)
    seed: int = field(default=0, metadata=Option("--seed", type=int).metadata)
    jobs: int = field(default=-1, metadata=Option("--jobs", type=int).metadata)
    resume: PathLike[str] | str | None = None
    progress: Progress | None = None
    on_candidate: OnCandidate | None = None

    def __post_init__(self) -> None:
        check_type(self.core, str | None, "core")
        check_type(self.seed, int, "seed")
        check_type(self.jobs, int, "jobs")
        check_type(self.resume, PathLike | str | None, "resume")
        check_type(self.progress, Callable[..., None] | None, "progress")
        check_type(self.on_candidate, Callable[..., None] | None, "on_candidate")
        if self.seed < 0:
            raise InputError(f"seed is {self.seed}; give 0 or above")
        if self.jobs == 0 or self.jobs < -1:
            raise InputError(
                f"jobs is {self.jobs}; give the number of processes, or -1 for all cores"
            )


@dataclass(frozen=True)
class CandidateOptions(SearchOptions):
    """Options of a search through all candidates: :func:`rdpi_gym.diagnose`, :func:`rdpi_gym.discover`.

    Parameters
    ----------
    effects
        An effect of your own, tried beside the catalogue; may be repeated.

    Raises
    ------
    InputError
        As :class:`SearchOptions`.

    Examples
    --------
    >>> CandidateOptions("P10", effects=["my_effects:Wobble"]).jobs
    -1
    """

    _: KW_ONLY
    effects: Sequence[str | type[Effect]] = field(
        default=(), metadata=Option("--effect", "MODULE:CLASS", list[str]).metadata
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_type(self.effects, Sequence[str | type], "effects")
