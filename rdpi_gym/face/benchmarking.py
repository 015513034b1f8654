"""`make_controller`, `benchmark`: controllers by name, and their scores as a result that shows itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from baselines import Controller
from baselines import make_controller as make_by_name
from benchmarks.tracking import evaluation
from benchmarks.tracking.controllers import named
from benchmarks.tracking.episode import BELOW_NOISE, Caution, cautions, play, score
from benchmarks.tracking.run import benchmark as run_benchmark
from benchmarks.tracking.selection import select
from rdpi_gym.envs.controller import warning_of
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.tracking import TrackingTask
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.face.catalogues import HasPlant, as_plant
from rdpi_gym.face.display import DisplayMixin
from rdpi_gym.face.environments import layout as usual_layout
from rdpi_gym.plant import PLANTS, PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import checked
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import LEADING_ROWS
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.words import micrometres, number

if TYPE_CHECKING:
    from rdpi_gym.report.chart import Chart

SEEDS = 5
_SHOWN = ("rank", "controller", "RMSE (%)", "RMSE (µm)", "status")


@checked
def make_controller(
    name: str,
    plant: PlantModel | HasPlant | PathLike[str] | str,
    layout: ObservationLayout | None = None,
) -> Controller:
    """Make a controller that believes a plant to be true.

    Parameters
    ----------
    name
        A name of :data:`rdpi_gym.controllers`; ``learned:`` and the folder of a trained policy, or
        the name of a shipped one; or ``module:attribute`` of a callable of your own.
    plant
        What it believes of the plant: a plant, a result that has one, the path of a plant file, or
        a name of :data:`rdpi_gym.plants`.
    layout
        What an observation shows; by default :func:`rdpi_gym.environments.layout` of the plant.

    Returns
    -------
    Controller
        With ``predict(observation, state) -> (action, state)``; feedforwards also have
        ``command_block(reference_um) -> u_V``.

    Raises
    ------
    InputError
        No such controller or plant, a policy that cannot be read, an argument of another type.

    Examples
    --------
    >>> import numpy as np
    >>> import rdpi_gym as rg
    >>> controller = rg.make_controller("classical-reference-rate", "P10")
    >>> controller.command_block(np.array([[0.0], [1.0]])).round(3).tolist()
    [[0.0], [1.61]]
    """
    belief = as_plant(plant)
    return make_by_name(name, belief, usual_layout(belief) if layout is None else layout)


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation(DisplayMixin, evaluation.Evaluation):
    """Scores of controllers, as :func:`rdpi_gym.benchmark` returns them.

    Everything that :class:`benchmarks.tracking.evaluation.Evaluation` is, and it shows itself.
    """

    saved_as: ClassVar[str] = "benchmark"
    figure_inches: ClassVar[tuple[float, float]] = (10.5, 4.9)

    finished: int = field(kw_only=True, default=0)
    """Rows of the run, those of the bound that all are measured against among them."""
    computed: int = field(kw_only=True, default=0)
    """Rows that were computed now; the others were found in the run's folder."""
    run_notes: tuple[str, ...] = field(kw_only=True, default=())
    """What the run itself remarked, one sentence each."""
    payoff: pd.DataFrame | None = field(kw_only=True, default=None)
    """Scores on plants with hidden effects, where all controllers and plants were asked for."""

    def _lines(self) -> Sequence[str]:
        tables = [
            line
            for title, table in self.leaders().items()
            for line in (title, *table.to_string(index=False).splitlines())
        ]
        return [self.answer, *tables, *self.notes]

    def leaders(self, own: Sequence[str] = (), most: int = LEADING_ROWS) -> dict[str, pd.DataFrame]:
        """Return the first of each ranking: rank, controller, error, status.

        Parameters
        ----------
        own
            Controllers that are shown wherever they stand, beside the user's own.
        most
            Number of the others.

        Returns
        -------
        dict of str to DataFrame
            By title: over all cases and, where policies were scored, over the cases of each sampling
            time that they were trained at.
        """
        found = {}
        for at_s, ranked in ((None, self.ranking), *self.where_trained.items()):
            if not ranked.empty:
                least_um = min(self.noise_um.values(), default=0.0)
                title, table = first_of(ranked, [*own, *self.own], most, least_um)
                found[title + ("" if at_s is None else f" at Ts = {at_s:g} s")] = table
        return found

    def to_dataframe(self) -> pd.DataFrame:
        """Return the scores, one row a controller, plant, reference, sampling time and seed."""
        return self.table.copy()

    def overview(self) -> pd.DataFrame:
        """Return the ranking, best first."""
        return evaluation.ranking_view(self.ranking)

    def _chart(self) -> Chart:
        from benchmarks.tracking.charts import leaderboard_chart

        return leaderboard_chart(self)

    def page(self, path: Path | str) -> Path:
        """Write the page of ``rdpi bench``.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        from benchmarks.tracking.report import write_benchmark_page

        return write_benchmark_page(Path(path), self, self.payoff)

    def write(self, folder: Path | str) -> Path:
        """Write ``leaderboard.csv``, ``leaderboard.md``, ``leaderboard.png`` and ``measured.csv``.

        Returns
        -------
        Path
            ``leaderboard.md``.

        Raises
        ------
        InputError
            The folder cannot be written.
        """
        from benchmarks.tracking.charts import leaderboard_png
        from benchmarks.tracking.report import write_tables
        from rdpi_gym.support.files import write_atomic

        write_atomic(Path(folder) / "leaderboard.png", leaderboard_png(self))
        return write_tables(Path(folder), self, self.payoff)


def first_of(
    ranked: pd.DataFrame, own: Sequence[str], most: int = LEADING_ROWS, noise_um: float = 0.0
) -> tuple[str, pd.DataFrame]:
    """Return the first of a ranking and a user's own, with a title; cells are text.

    An error below the sensor noise (µm rms) is said to be that. The bound is shown where it is alone.
    """
    bound = ranked["rank"] == "bound"
    shown = (
        ((~bound).cumsum() <= most) & ~bound | ranked["controller"].isin(own) | bool(bound.all())
    )
    title, rivals = "Ranking", int((~bound).sum())
    if rivals > most:
        yours = ", and yours" if (shown & ~bound).sum() > most else ""
        title = f"The first {most} of {rivals} controllers{yours}"
    table = evaluation.ranking_view(ranked).loc[shown, list(_SHOWN)]
    below = ranked.loc[shown, "rmse_um"] < noise_um
    table = table.astype(object)
    table.loc[below, ["RMSE (%)", "RMSE (µm)"]] = BELOW_NOISE, f"< {noise_um:g}"
    return title, table.map(lambda cell: number(cell) if isinstance(cell, float) else str(cell))


@checked
def benchmark(
    controllers: Sequence[str | Controller | Callable[..., Any]] | None = None,
    plants: Sequence[PlantModel | HasPlant | PathLike[str] | str] | None = None,
    references: Sequence[str] | None = None,
    ts_s: Sequence[float] | None = None,
    seeds: int | Sequence[int] = SEEDS,
    *,
    own_controllers: Sequence[str | Controller | Callable[..., Any]] = (),
    own_plants: Sequence[PlantModel | HasPlant | PathLike[str] | str] = (),
    belief: PlantModel | HasPlant | PathLike[str] | str | None = None,
    out: PathLike[str] | str | None = None,
    jobs: int = -1,
    ray: str | None = None,
    progress: Progress | None = None,
    told: Callable[[str, Mapping[str, float]], None] | None = None,
) -> Evaluation:
    """Score controllers on reference signals.

    Parameters
    ----------
    controllers
        Names, as :func:`make_controller` takes them; callables ``(belief, layout)`` that make a
        controller; or controllers, which are scored as they are, at the sampling time of their
        layout. By default all of :data:`rdpi_gym.controllers`, and the trained policies that ship.
    plants
        Plants, results that have one, paths of plant files, names of :data:`rdpi_gym.plants`; by
        default ``P5``, ``P10`` and ``picma``.
    references
        Names of reference signals; by default all of the suite.
    ts_s
        Sampling times (s); by default those that suit each plant.
    seeds
        Number of seeds, or the seeds; seed 0 is the nominal plant, any other draws one around it.
    own_controllers, own_plants
        Further ones, beside those above or all.
    belief
        What controllers are told of the plant, of any hysteresis core and with effects or without:
        the plant itself by default. There is one plant then, and the others are left out.
    out
        Folder that keeps finished rows, so that an interrupted run goes on; by default none.
    jobs
        Worker processes; -1: one for each core.
    ray
        Address of a Ray cluster that scores in place of processes here.
    progress
        Called as ``progress(stage, done, total)``.
    told
        Called as ``told(controller, errors)`` when the last row of a controller is computed: its
        RMSE (%) by plant, the geometric mean over the cases and draws that are ranked.

    Returns
    -------
    Evaluation
        It prints the ranking. Where nothing is left out, plants with hidden effects are scored too.

    Raises
    ------
    InputError
        An unknown name, a policy that cannot be read, no case that suits the sampling times, an
        argument of another type.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> scores = rg.benchmark(["none", "classical-static"], ["P5"], ["sine"], [1e-3], seeds=1)
    >>> scores.order
    ['classical-static', 'none']
    """
    if isinstance(seeds, int) and seeds < 1:
        raise InputError(f"seeds is {seeds}; give the number of seeds, 1 or more, or the seeds")
    asked = None if controllers is None else [c for c in controllers if isinstance(c, str)]
    further = [*(controllers or ()), *own_controllers]
    selection = select(
        asked,
        None if plants is None else [_named(plant) for plant in plants],
        None if references is None else list(references),
        None if ts_s is None else list(ts_s),
        range(seeds) if isinstance(seeds, int) else tuple(seeds),
        own_controllers=[c for c in own_controllers if isinstance(c, str)],
        own_plants=[_named(plant) for plant in own_plants],
        belief=None if belief is None else _named(belief),
        factories=named([c for c in further if not isinstance(c, str)]),
    )
    everything = all(each is None for each in (controllers, plants, references, ts_s, belief))
    notes: list[str] = []
    payoff = None

    def hear(name: str, rows: Sequence[dict[str, Any]]) -> None:
        if told is not None:
            told(name, evaluation.by_plant(selection, rows))

    with TemporaryDirectory() as scratch:
        folder = None if out is None else Path(out)
        outcome = run_benchmark(selection, folder, jobs, progress, ray, hear if told else None)
        if everything:
            stamped = folder is not None
            payoff = _payoff(folder or Path(scratch), stamped, jobs, ray, progress, notes)
    return Evaluation.of(
        evaluation.evaluate(selection, outcome),
        finished=len(outcome.rows),
        computed=outcome.computed,
        run_notes=(*outcome.notes, *notes),
        payoff=payoff,
    )


def _named(plant: PlantModel | HasPlant | PathLike[str] | str) -> PlantModel | str:
    """Leave names to the selection, which says which there are."""
    if isinstance(plant, PathLike) or (isinstance(plant, str) and plant not in PLANTS):
        return str(plant)
    return as_plant(plant)


def _payoff(
    out: Path,
    stamped: bool,
    jobs: int,
    ray: str | None,
    progress: Progress | None,
    notes: list[str],
) -> pd.DataFrame:
    """Score the plants with hidden effects, with the beliefs of this release."""
    from benchmarks.payoff.scores import HIDDEN_PLANTS, payoff_table, stored_beliefs

    beliefs = {hidden: stored_beliefs(hidden) for hidden in HIDDEN_PLANTS}
    return payoff_table(
        beliefs,
        out,
        jobs=jobs,
        progress=progress,
        ray_address=ray,
        note=notes.append,
        stamped=stamped,
    )


PREVIEW = 16
"""Samples of the reference that are shown ahead where nothing else is asked."""


@dataclass(frozen=True)
class Tracking:
    """A run along a reference.

    Parameters
    ----------
    controller
        Name of what tracked.
    t_s, reference_um, displacement_um, command_V
        Times (s), reference and displacement (µm), command (V), ``(K,)``.
    rmse_um, rmse_percent
        Error over the samples that count (µm rms), and in percent of the reference's peak to peak.
    warning
        What to beware of: outside its stability limit, diverged, saturated; None: nothing.
    cautions
        The same, one by one.
    """

    controller: str
    t_s: Array
    reference_um: Array
    displacement_um: Array
    command_V: Array
    rmse_um: float
    rmse_percent: float
    warning: str | None
    cautions: tuple[Caution, ...] = ()

    def __repr__(self) -> str:
        """Error first, then what to beware of."""
        said = f"{micrometres(self.rmse_um)} ({self.rmse_percent:.3g} %) with {self.controller}"
        return said if self.warning is None else f"{said}; {self.warning}"


@checked
def track(
    controller: str,
    plant: PlantModel | HasPlant | PathLike[str] | str,
    reference_um: ArrayLike,
    ts_s: float,
    *,
    belief: PlantModel | HasPlant | PathLike[str] | str | None = None,
    first: int = 1,
    preview: int = PREVIEW,
    seed: int = 0,
) -> Tracking:
    """Track a reference on a plant with a controller, from rest at the command nearest 0 V.

    As in :func:`benchmark`, the rate of plant and belief has a cut-off of 800 Hz at most: no sampled
    command follows the literal rate of Eq. 5.

    Parameters
    ----------
    controller
        A name of :data:`rdpi_gym.controllers`.
    plant
        What it drives: a plant, a result that has one, the path of a plant file, or a plant's name.
    reference_um
        Where the plant is to be (µm), ``(K,)``.
    ts_s
        Sampling time (s).
    belief
        What the controller is told of the plant; by default the plant itself.
    first
        First sample that counts in the error.
    preview
        Samples of the reference that are shown ahead.
    seed
        Of the sensor's noise.

    Returns
    -------
    Tracking
        It prints the error.

    Raises
    ------
    InputError
        No such controller or plant, one that does not suit the belief, a reference that is not
        finite or has no motion.

    Examples
    --------
    >>> import numpy as np
    >>> import rdpi_gym as rg
    >>> sine = 5.0 * np.sin(2 * np.pi * 10.0 * np.arange(400) * 1e-3)
    >>> blind = rg.track("none", "P5", sine, 1e-3)
    >>> rg.track("classical-static", "P5", sine, 1e-3).rmse_um < blind.rmse_um / 2
    True
    """
    truth = limit_band(as_plant(plant))
    told = truth if belief is None else limit_band(as_plant(belief))
    reference = np.array(reference_um, dtype=np.float64)
    if reference.ndim != 1 or not np.isfinite(reference).all():
        raise InputError(f"reference_um of shape {reference.shape}; give finite numbers, (K,)")
    if not 1 <= first < reference.size - 1 or np.ptp(reference[first:]) <= 0:
        raise InputError(
            f"reference_um has {reference.size} samples and does not move from sample {first} on; "
            "give a motion"
        )
    layout = ObservationLayout.for_plant(truth, ts_s, preview)
    made: Controller = make_controller(controller, told, layout)
    # what is shown ahead at the end goes on as the reference ended
    shown = np.pad(reference, (0, preview), mode="edge")
    taken = play(
        made, TrackingTask(truth, layout), shown[:, None], [np.random.default_rng(seed)]
    )  # fmt: skip
    end = reference.size
    y, u, action = (
        part[:end, 0] for part in (taken.displacement_um, taken.command_V, taken.action)
    )
    scored = score(reference, y, u, action, first=first, ts_s=ts_s)
    found = cautions(
        scored, reference[first:], warning=warning_of(made), ts_s=ts_s, identified_V_s=None
    )
    return Tracking(
        controller, np.arange(end, dtype=np.float64) * float(ts_s), reference, y, u, scored.rmse_um, scored.rmse_percent,
        "; ".join(map(str, found)) or None, found,
    )  # fmt: skip
