"""`diagnose`, `discover`, `add`: the search for missing effects, and its result that goes on."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import pandas as pd

from rdpi_gym import measurement
from rdpi_gym.diagnosis import results
from rdpi_gym.diagnosis.portrait import Portrait
from rdpi_gym.diagnosis.search import discover as searches
from rdpi_gym.diagnosis.search.plants import AUTO
from rdpi_gym.face.catalogues import HasPlant, as_plant
from rdpi_gym.face.data import Dataset, as_dataset, in_words_of
from rdpi_gym.face.display import DisplayMixin
from rdpi_gym.face.experiment import PlannedExperiment, plan_experiment
from rdpi_gym.face.options import CandidateOptions, SearchOptions
from rdpi_gym.measurement.quantities import in_output
from rdpi_gym.plant import CORES, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect, check_effect, load_effect
from rdpi_gym.report.discovery_text import evidence, lines, staircase
from rdpi_gym.support.checks import check_type, checked, unknown_name
from rdpi_gym.support.documents import stored
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.options import with_options
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.words import closed, joined

if TYPE_CHECKING:
    from rdpi_gym.report.chart import Chart

_HEADINGS = {"diagnosis": "What is missing", "discovery": "Missing effects"}
Own = tuple[type[Effect], ...]


@dataclass(frozen=True, eq=False, repr=False)
class SearchResult(DisplayMixin, results.SearchResult):
    """Result of a search for missing effects, with its data, from which it continues.

    Everything that :class:`rdpi_gym.diagnosis.results.SearchResult` is, and it shows itself.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)
    >>> data = data.select("stairs", "sine-50hz", "validation-stairs", "quiet")
    >>> found = rg.add("creep", data, "P5", jobs=1)
    >>> [effect.name for effect in found.plant.effects]
    ['creep']
    >>> [effect.name for effect in found.remove("creep").plant.effects]
    []
    """

    saved_as: ClassVar[str] = "search"
    figure_inches: ClassVar[tuple[float, float]] = (9.5, 3.8)

    data: Dataset = field(kw_only=True, metadata=stored(omitted=True))
    """The records that were searched."""
    own: Own = field(kw_only=True, default=(), metadata=stored(omitted=True))
    """Effects of the user's own that were tried beside the catalogue; not saved."""

    @checked
    def add(
        self,
        effect: str | type[Effect],
        *,
        jobs: int = -1,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> SearchResult:
        """Add an effect to the model and refit everything, whether the records ask for it or not.

        Parameters
        ----------
        effect
            Name of an effect, ``module:Class`` of one of your own, or its class.
        jobs, seed, progress
            As in :class:`SearchOptions`.

        Returns
        -------
        SearchResult
            A new one, with the error before and after; this one stays as it is.

        Raises
        ------
        InputError
            No such effect, or the model has it already.
        """
        options = SearchOptions(self.plant, jobs=jobs, seed=seed, progress=progress)
        return _add(effect, self.data, options, self.own)

    @checked
    def remove(self, effect: str) -> SearchResult:
        """Take an effect out of the model and refit everything.

        Parameters
        ----------
        effect
            Name of an effect of the model.

        Returns
        -------
        SearchResult
            A new one, with the error before and after; this one stays as it is.

        Raises
        ------
        InputError
            The model has no such effect.
        """
        with in_words_of(self.data):
            found = searches.remove_effect(self.data, self.plant, effect)
        return SearchResult.of(found, data=self.data, own=self.own)

    @checked
    def experiment(self, rate_hz: float | None = None) -> PlannedExperiment | None:
        """Return the next experiment as a command to play on the rig.

        Parameters
        ----------
        rate_hz
            Samples a second; by default those that suit the motion.

        Returns
        -------
        PlannedExperiment or None
            None where no experiment is advised, or none that is a motion.

        Raises
        ------
        InputError
            A rate that the motion cannot be played at.
        """
        return plan_experiment(self.advice, self.data, self.plant, rate_hz)

    def _lines(self) -> Sequence[str]:
        return [*lines(self), *map(closed, self.notes)]

    def _evidence(self) -> Sequence[str]:
        return evidence(self)

    def to_dataframe(self) -> pd.DataFrame:
        """Return the models in order, each with its errors; of a diagnosis, the candidates.

        Returns
        -------
        DataFrame
            ``model``, ``train_rmse_um``, ``validation_rmse_um`` (µm), ``validation_nrmse_percent``
            (%), ``times_noise_floor``; or ``candidate``, the errors, ``share`` and ``confidence``
            (0 to 1), best first.
        """
        if self.kind == "diagnosis":
            return pd.DataFrame(
                [
                    {
                        "candidate": c.effect,
                        "train_rmse_um": c.errors.train_rmse_um,
                        "validation_rmse_um": c.errors.validation_rmse_um,
                        "share": c.share,
                        "confidence": c.confidence,
                        "indistinguishable": ", ".join(c.indistinguishable),
                    }
                    for c in self.ranking
                ]
            )
        floor = self.noise_floor_um
        return pd.DataFrame(
            [
                {
                    "model": name,
                    "train_rmse_um": errors.train_rmse_um,
                    "validation_rmse_um": errors.validation_rmse_um,
                    "validation_nrmse_percent": errors.validation_nrmse_percent,
                    "times_noise_floor": errors.validation_rmse_um / floor if floor > 0 else None,
                }
                for name, errors in staircase(self)
            ]
        )

    @property
    def overview_title(self) -> str:
        """Title of :meth:`overview`."""
        if self.kind == "diagnosis":
            without = self._quantities().fill(in_output(self.base.validation_rmse_um))
            return f"Candidates, each added alone; without one {without}"
        return "Error, step by step"

    def overview(self) -> pd.DataFrame:
        """Return what :meth:`to_dataframe` does, in words and with units."""
        if self.kind == "diagnosis":
            rows = [
                {
                    "candidate": c.effect,
                    "validation": in_output(c.errors.validation_rmse_um),
                    "share": _percent(c.share),
                    "confidence": _percent(c.confidence),
                    "indistinguishable from": ", ".join(c.indistinguishable),
                    "remarks": "; ".join(c.remarks),
                }
                for c in self.ranking
            ]
            return self._table_in_units(pd.DataFrame(rows), "validation")
        floor = self.noise_floor_um
        table = pd.DataFrame(
            [
                {
                    "model": name,
                    "training": in_output(errors.train_rmse_um),
                    "validation": in_output(errors.validation_rmse_um),
                    "of the stroke": f"{errors.validation_nrmse_percent:.3g} %",
                    "noise floors": f"{errors.validation_rmse_um / floor:.2f}" if floor > 0 else "",
                }
                for name, errors in staircase(self)
            ]
        )
        return self._table_in_units(table, "training", "validation")

    def brief(self) -> pd.DataFrame:
        """Return :meth:`overview` without the rivals and remarks of candidates."""
        notes = ["indistinguishable from", "remarks"]
        return self.overview().drop(columns=notes, errors="ignore")

    def _chart(self) -> Chart:
        from rdpi_gym.report.discovery_charts import search_chart

        return search_chart(self)

    def page(self, path: Path | str) -> Path:
        """Write the page of ``rdpi diagnose``, ``rdpi add`` or ``rdpi discover``.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        from rdpi_gym.report.discovery_page import write_discovery_page

        names = joined([candidate.effect for candidate in self.added])
        headings = _HEADINGS | {"removal": f"{joined(self.removed)} removed"}
        heading = headings.get(self.kind, f"{names} added")
        title = f"{heading}: {self.title}"
        return write_discovery_page(path, title, self, candidates_of(self.own))

    def to_json(self, path: Path | str) -> Path:
        """Write what was found as JSON, as the commands do: without the records.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        return results.SearchResult.save(self, path)


def _percent(share: float) -> str:
    return f"{round(100 * share)} %" if math.isfinite(share) else ""


def candidates_of(effects: Sequence[str | type[Effect]]) -> Mapping[str, type[Effect]]:
    """Return the catalogue with a user's own effects: classes, or each as ``module:Class``."""
    known = dict(CATALOGUE)
    for effect in effects:
        kind = _effect(effect)
        if kind.form:
            raise InputError(
                f"effect {_named(effect)} is {kind.full_name()}: name {kind.name}, and each of its "
                "forms is tried"
            )
        if known.setdefault(kind.name, kind) is not kind:
            raise InputError(
                f"effect {_named(effect)} is named {kind.name!r}, as another effect is; rename it"
            )
    return known


def _effect(effect: str | type[Effect]) -> type[Effect]:
    if isinstance(effect, str):
        return load_effect(effect)
    return check_effect(effect, f"effect {_named(effect)}")


def _named(effect: str | type[Effect]) -> str:
    return effect if isinstance(effect, str) else effect.__name__


def _given(options: SearchOptions) -> PlantModel | None:
    check_type(options.model, PlantModel | HasPlant | PathLike | str | None, "model")
    return None if options.model is None else as_plant(options.model)


def _core(options: SearchOptions) -> str | None:
    if options.core is not None and options.core not in (*CORES, AUTO):
        raise unknown_name("--core", options.core, (*CORES, AUTO))
    return options.core


def _asked(options: SearchOptions) -> dict[str, Any]:
    """Keywords of a search below."""
    return {
        "jobs": options.jobs,
        "seed": options.seed,
        "progress": options.progress,
        "checkpoint": None if options.resume is None else Path(options.resume),
        "core": _core(options),
        "on_candidate": options.on_candidate,
    }


def _search(
    function: Callable[..., results.SearchResult],
    data: measurement.Dataset | PathLike[str] | str,
    options: CandidateOptions,
) -> SearchResult:
    check_type(data, measurement.Dataset | PathLike | str, "data")
    own = tuple(_effect(effect) for effect in options.effects)
    catalogue = candidates_of(own)
    given = _given(options)
    dataset = as_dataset(data)
    with in_words_of(dataset):
        found = function(dataset, given, catalogue=catalogue, **_asked(options))
    return SearchResult.of(found, data=Dataset.of(dataset), own=own)


@with_options(CandidateOptions)
def diagnose(
    data: measurement.Dataset | PathLike[str] | str, options: CandidateOptions
) -> SearchResult:
    """Rank the effects that a model may miss, each refitted with it.

    Parameters
    ----------
    data
        From :func:`rdpi_gym.load`, or the path of a measurement.
    model
        The model to start from: a plant, a result that has one, the path of a plant file, or a
        plant's name; its core and effects are kept and refitted. By default a bare core is fitted.
    core
        The kind of hysteresis: a key of :data:`rdpi_gym.plant.CORES`, or "auto" for the one of all
        that explains records held out best. By default that of the model; without one RDPI, as long
        as no other is clearly better where loops turn clockwise or much is left.
    seed
        Of every random draw.
    jobs
        Processes that refit candidates; -1: one for each core.
    effects
        Effects of your own, tried beside the catalogue: classes, or each as ``module:Class``.
    resume
        File that keeps finished candidates, so that an interrupted search goes on.
    progress
        Called as ``progress(stage, done, total)``.
    on_candidate
        Called with a :class:`Refit` as soon as a model is refitted: first the one that candidates are
        added to, then each candidate, in the form that gains most; at the end of a diagnosis the
        model that it recommends.

    Returns
    -------
    SearchResult
        It prints the verdict; ``.to_dataframe()`` is the ranking by the error on validation records.

    Raises
    ------
    InputError
        No record to fit, or none to validate on; no such model, core or effect; an argument of
        another type.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)
    >>> data = data.select("stairs", "sine-50hz", "validation-stairs", "quiet")
    >>> rg.diagnose(data, jobs=1).to_dataframe()["candidate"][0]
    'creep'
    """
    return _search(searches.diagnose, data, options)


@with_options(CandidateOptions)
def discover(
    data: measurement.Dataset | PathLike[str] | str, options: CandidateOptions
) -> SearchResult:
    """Search for the set of effects that is missing, each set refitted whole.

    Parameters are those of :func:`diagnose`.

    Returns
    -------
    SearchResult
        It prints the verdict and each effect that was found; `plant` is the model.

    Raises
    ------
    InputError
        As :func:`diagnose`.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)
    >>> data = data.select("stairs", "sine-50hz", "validation-stairs", "quiet")
    >>> [candidate.effect for candidate in rg.discover(data, jobs=1).added]
    ['creep']
    """
    return _search(searches.discover, data, options)


@checked
def portrait(
    data: measurement.Dataset | PathLike[str] | str,
    model: PlantModel | HasPlant | PathLike[str] | str | None = None,
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> Portrait | None:
    """Draw the portrait of an effect that a model misses and that the catalogue may not have.

    A free block, refitted with the hysteresis, tells where in the chain the effect sits, whether it
    has a memory and of what length, whether it is even or odd, and with which powers of amplitude and
    rate it grows. A search draws it by itself where what is left follows from the command;
    ``rg.add("unknown", ...)`` puts the block into the model.

    Parameters
    ----------
    data, model, seed, progress
        As in :func:`diagnose`. Of a search's result the last ranking names the effects of the
        catalogue that come nearest.

    Returns
    -------
    Portrait or None
        It prints itself in sentences; None where no block takes a tenth of the error on the records
        held out.

    Raises
    ------
    InputError
        As :func:`diagnose`; the model has the block already.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", hide="asymmetry", seed=1, ts_factor=4.0)
    >>> drawn = rg.portrait(data.select("triangle-slow", "validation-loops"))
    >>> drawn.place, drawn.memory, drawn.parity
    ('behind', False, 'even')
    """
    dataset = as_dataset(data)
    rounds = model.rounds if isinstance(model, results.SearchResult) else ()
    given = None if model is None else as_plant(model)
    with in_words_of(dataset):
        return searches.portray(
            dataset, given, rounds[-1] if rounds else (), seed=seed, progress=progress
        )  # fmt: skip


@with_options(SearchOptions, None)
def add(
    effect: str | type[Effect],
    data: measurement.Dataset | PathLike[str] | str,
    options: SearchOptions,
) -> SearchResult:
    """Add an effect to a model and refit everything, whether the records ask for it or not.

    Parameters
    ----------
    effect
        Name of an effect, ``module:Class`` of one of your own, or its class.
    data
        From :func:`rdpi_gym.load`, or the path of a measurement.
    model
        The model that it is added to: a plant, a result that has one, the path of a plant file, or a
        plant's name.
    core, seed, jobs, resume, progress, on_candidate
        As in :func:`diagnose`.

    Returns
    -------
    SearchResult
        With the error before and after.

    Raises
    ------
    InputError
        As :func:`diagnose`; no model, no such effect, or the model has it already.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> data = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)
    >>> data = data.select("stairs", "sine-50hz", "validation-stairs", "quiet")
    >>> added = rg.add("creep", data, "P5", jobs=1)
    >>> added.plant.effects[0].name
    'creep'
    """
    check_type(effect, str | type, "add: effect")
    return _add(effect, data, options)


def _add(
    effect: str | type[Effect],
    data: measurement.Dataset | PathLike[str] | str,
    options: SearchOptions,
    own: Own = (),
) -> SearchResult:
    check_type(data, measurement.Dataset | PathLike | str, "data")
    kind = _effect(effect)
    given = _given(options)
    if given is None:
        raise InputError("add needs the model that the effect is added to; give it with --model")
    dataset = as_dataset(data)
    with in_words_of(dataset):
        found = searches.add_effect(dataset, kind, given, **_asked(options))
    if kind.name not in CATALOGUE and kind not in own:
        own = (*own, kind)
    return SearchResult.of(found, data=Dataset.of(dataset), own=own)
