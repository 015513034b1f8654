"""Data of a search, their noise, its base model, and models refitted to them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rdpi_gym.diagnosis.checks import run_checks
from rdpi_gym.diagnosis.features.cycles import BoolArray
from rdpi_gym.diagnosis.features.noise import (
    MeasuredNoise,
    floor_from,
    measured_noise,
    quiet_noise,
    rough_parts,
    slowness,
)
from rdpi_gym.diagnosis.notices import statement
from rdpi_gym.diagnosis.preprocessing import Finding, inspect
from rdpi_gym.diagnosis.preprocessing.faults import spikes
from rdpi_gym.diagnosis.results import CoreChoice, Errors
from rdpi_gym.diagnosis.search.candidates import (
    Bare,
    Outcome,
    Setting,
    Trial,
    assess,
    attempt,
    refit,
    refit_all,
)
from rdpi_gym.diagnosis.search.checkpoint import Checkpoint
from rdpi_gym.diagnosis.search.plants import (
    AUTO,
    Fitted,
    OnCandidate,
    begun,
    choose,
    fit_kinds,
    instead,
    on_comb,
    refit_of,
    simpler,
    turning,
)
from rdpi_gym.diagnosis.search.ranking import AT_FLOOR
from rdpi_gym.diagnosis.search.record_clocks import (
    leaving_out,
    misleading,
    outliers_left,
    record_clocks,
    unknown_past,
)
from rdpi_gym.diagnosis.search.separability import RATE, separability, typical_effects
from rdpi_gym.diagnosis.search.verdict import EXPLAINED, NumericalFloor, numerical_floor
from rdpi_gym.diagnosis.suitability import (
    close_up,
    falls,
    limits,
    one_size,
    thinned,
    turned,
    unrelated,
)
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.jacobian import simulate_effects
from rdpi_gym.identification.joint import JointFit
from rdpi_gym.identification.plausibility import check_motion, check_scale, orientation
from rdpi_gym.identification.scale import data_scale, rate_spread
from rdpi_gym.identification.stack import stack_records
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import CORES, RDPI, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect, in_chain_order
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.parallel import Pool
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.words import joined

# Of a record, the outliers that a model may show beyond those that were found before.
_MOST_OUTLIERS = 0.03
# Prices of uneven weights where loops of one size are all there is to fit, and the share of the
# held-out error that another one has to take.
_SMOOTHNESS, _SMOOTHER = (0.0, 0.0004, 0.004), 0.04
# Noise floors from which on much is left, and what the first steps of another core have to leave of
# the error of the records to fit: there, and where less is left.
_UNEXPLAINED_FLOORS, _PROMISING_RATIO, _EQUAL_RATIO = 2.0, 0.7, 1.0
# It takes the place of RDPI where it leaves so few noise floors and so much less, or far less.
_NEAR_FLOORS, _NEAR_RATIO, _FAR_RATIO = 1.5, 0.6, 0.1
# Where all rates are alike, an effect at this cosine to that of δ2 is indistinguishable from it.
_LIKE_RATE = 0.9


@dataclass(frozen=True)
class State:
    """A refitted model and its errors."""

    outcome: Outcome

    @property
    def fit(self) -> JointFit:
        """The refit."""
        assert self.outcome.fit is not None
        return self.outcome.fit

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects that it has."""
        return self.fit.variant.effects

    @property
    def hysteresis(self) -> Core:
        """Its core: of many, a comb of thresholds and weights."""
        return self.fit.variant.hysteresis


class Refitting:
    """The data of a search, the noise in them, and refits.

    Arguments are those of :func:`rdpi_gym.diagnosis.search.discover.diagnose`.
    """

    def __init__(
        self,
        dataset: Dataset,
        catalogue: Mapping[str, type[Effect]],
        jobs: int,
        seed: int,
        progress: Progress | None,
        checkpoint: Path | None,
        core: str | None = None,
        on_candidate: OnCandidate | None = None,
    ) -> None:
        train, validation = tuple(dataset.train), tuple(dataset.validation)
        if not train or not validation:
            raise InputError(
                "a diagnosis needs records to fit and records to validate on; the data set has "
                f"{len(train)} and {len(validation)} in which the {dataset.quantities.input.name} moves"
            )
        check_motion(train)
        check_scale(train, dataset.quantities)
        reversed_sign = falls((*train, *validation))
        if reversed_sign:
            dataset = turned(dataset)
        self.orientation: tuple[str, ...] = (template("turned"),) if reversed_sign else ()
        inspected = inspect(dataset)
        dataset, self._openings = inspected.dataset, inspected.openings
        self.findings = inspected.findings
        self.limits = limits(dataset)
        self._recorded, self._thinned = inspected, thinned(dataset, inspected.openings)
        if self._thinned is not None:
            dataset, self._openings = self._thinned.dataset, self._thinned.openings
        self.dataset = dataset
        self.catalogue = self._offered = catalogue
        self._asked_core = core
        self.still = quiet_noise(dataset.quiet)
        self.setting = setting_of(dataset)
        train, validation = self.setting.train, self.setting.validation
        self._whole = self._stated = self.setting
        self._searched: Setting | None = None
        self._close_up: tuple[Record, ...] = ()
        self._floor: tuple[State, tuple[Record, ...], NumericalFloor] | None = None
        self._clocks: tuple[State, float, tuple[Finding, ...]] | None = None
        if self._thinned is not None:
            self._stated = setting_of(inspected.dataset)
            self._close_up = close_up(self._stated.validation)
        self.is_within = False
        self._spared: dict[str, BoolArray] = {}
        self.noise_um, self.noise_origin = math.nan, statement("noise/unknown")
        self._least, self._colour = math.inf, 1.0
        self._whitest: tuple[float, MeasuredNoise, list[tuple[float, int]]] | None = None
        self._pooled: (
            tuple[tuple[tuple[Record, ...], ...], tuple[Record, ...], MeasuredNoise] | None
        ) = None
        self._pool, self.seed = Pool(jobs), seed
        self._on_candidate = on_candidate
        self._given: PlantModel[Any] | None = None
        self.progress = progress or (lambda task, done, total: None)
        self._checkpoint = Checkpoint(checkpoint, (*train, *validation))
        remark = self._checkpoint.remark
        self.remarks: tuple[str, ...] = () if remark is None else (remark,)
        self.undecided = unrelated(train)
        self.checks = run_checks(dataset)
        self._suspects = {name for c in self.checks if c.zone == "yes" for name in c.suggests}
        if any(finding.kind == "clock" for finding in self.findings):
            self._suspects.add("delay")  # in whole samples
        self._like_rate: tuple[str, ...] = ()
        self._rates_alike = rate_spread(stack_records(train, None)[0]).alike

    @property
    def searched(self) -> Setting:
        """The samples that the search read: fewer than all where there are too many."""
        return self._searched or self.setting

    @property
    def close_up(self) -> Setting:
        """Samples as recorded, of records with too many of them a stretch."""
        if self._thinned is None:
            return self.setting
        train, validation = close_up(self.setting.train), close_up(self.setting.validation)
        return replace(self.setting, train=train, validation=validation)

    @property
    def reads_fewer(self) -> str | None:
        """Say which samples the search read, where it did not read all."""
        return None if self._thinned is None else self._thinned.sentence

    @property
    def reads_in_part(self) -> bool:
        """Whether the search reads a stretch alone of some record."""
        return self._thinned is not None and self._thinned.in_part

    def errors_of(self, outcome: Outcome) -> Errors:
        """Errors of a refit as they are stated: of every sample that inspection without a model left."""
        here, stated = self.setting, self._stated
        alike = here.train is stated.train and here.validation is stated.validation
        if alike or outcome.fit is None:
            return outcome.errors
        return assess(stated, "", outcome.fit).errors

    def again(self, state: State) -> State:
        """Return a model refitted to the samples that count now."""
        state = self._moved(state, refit(self.setting, state.hysteresis, state.effects, None))
        self._update_noise(state)
        return state

    def without(self, state: State, names: Sequence[str]) -> State:
        """Return the model without some effects, refitted; where that fails, with an infinite error."""
        kept = in_chain_order(e for e in state.effects if e.name not in names)
        return State(refit(self.setting, state.hysteresis, kept, None))

    def on_whole_comb(self, state: State) -> State:
        """Return a model refitted on the whole comb."""

        def refitted() -> Outcome:
            whole = on_comb(state.hysteresis, self.setting.train)
            return refit(self.setting, whole, state.effects, None)

        return self._smoothed(self._moved(state, attempt(refitted)))

    def _moved(self, state: State, outcome: Outcome) -> State:
        """Return a refit of a model, or where there is none the model as it stands, with a remark."""
        if outcome.fit is not None:
            return State(outcome)
        self.say(template("no refit", remark=outcome.remark))
        return State(assess(self.setting, "", state.fit))

    def say(self, remark: str) -> None:
        """Add a remark on the search, once."""
        self.remarks = tuple(dict.fromkeys((*self.remarks, remark)))

    def _smoothed(self, state: State) -> State:
        """Return a model with weights as smooth as held-out records like them best."""
        if self._is_explained(state) or not one_size(self.setting.train):
            return state
        best, chosen = state, self.setting
        for price in _SMOOTHNESS:
            if price == self.setting.smoothness:
                continue
            setting = replace(self.setting, smoothness=price)
            trial = State(refit(setting, state.hysteresis, state.effects, None))
            if trial.outcome.mean_square < (1.0 - _SMOOTHER) * best.outcome.mean_square:
                best, chosen = trial, setting
        self.setting = chosen
        if best is not state:
            self._update_noise(best)
        return best

    def past_openings(self, state: State) -> State:
        """Leave out the beginnings of records whose unknown history misleads the model.

        Returns the model itself where there are none, else refitted.
        """
        bad = misleading(self.setting, state.outcome, self._openings, self.noise_um)
        if not bad:
            return state
        self.setting, self._spared = leaving_out(self.setting, bad), {**self._spared, **bad}
        kept = tuple(f for f in self.findings if f.kind != "in motion" or f.record not in bad)
        self.findings = (*kept, unknown_past(bad))
        return self.again(state)

    def past_outliers(self, state: State) -> State:
        """Leave out more outliers of records that have some, which a model's residual shows.

        A record without any shows none here either: what stands out there is the model's fault.
        Returns the model itself where there are none, else refitted.
        """
        found: dict[str, BoolArray] = {}
        spoilt = {finding.record for finding in self.findings if finding.kind == "spikes"}
        for record in dict.fromkeys((*self.setting.train, *self.setting.validation)):
            if record.name not in spoilt:
                continue
            left = record.y_um - simulate_effects([state.fit.variant], record)[:, 0]
            single, _ = spikes(replace(record, y_um=left))
            new = single & record.error_mask
            if new.any() and new.sum() <= _MOST_OUTLIERS * new.size:
                found[record.name] = found.get(record.name, np.zeros_like(new)) | new
        if not found:
            return state
        self.setting, self._whole = (
            leaving_out(each, found) for each in (self.setting, self._whole)
        )
        self.findings = (*self.findings, *(outliers_left(n, m) for n, m in found.items()))
        return self.again(state)

    def at_floor(self, state: State) -> bool:
        """Whether so little exceeds noise and numerical floor that no effect can be earned.

        Of the numerical floor counts what the error bears out: what it does not show may be an
        effect, such as hum beside a mode that the records sample too slowly.
        """
        variance = self.noise_um**2
        if state.outcome.mean_square - variance < AT_FLOOR * variance:
            return True
        variance += self.numerical(state).borne_um ** 2
        return state.outcome.mean_square - variance < AT_FLOOR * variance

    def _is_explained(self, state: State) -> bool:
        return state.outcome.errors.validation_rmse_um <= EXPLAINED * self.noise_um

    def numerical(self, state: State) -> NumericalFloor:
        """Return what the simulation of a model on the validation records leaves open."""
        records = self._close_up or self.setting.validation
        if self._floor is None or self._floor[0] is not state or self._floor[1] is not records:
            # asked of one model again and again: whether it is at the floor, how probable, its verdict
            self._floor = (state, records, numerical_floor(state.fit.variant, records))
        return self._floor[2]

    def clocks(self, state: State) -> tuple[Finding, ...]:
        """Return what is wrong with the clock of single records, by a model."""
        setting, floor_um = self.setting, math.hypot(self.noise_um, self.numerical(state).total_um)
        if self._clocks is None or self._clocks[0] is not state or self._clocks[1] != floor_um:
            found = record_clocks(
                state.fit.variant, setting.train, setting.validation, floor_um, setting.smoothness
            )
            self._clocks = (state, floor_um, found)
        return self._clocks[2]

    def _bare(self, state: State) -> Bare:
        return Bare(self.setting, self._plays(state), state.effects)

    def _plays(self, state: State) -> Core:
        # smooth weights are those of the whole comb
        return state.hysteresis if self.setting.smoothness else state.hysteresis.pruned()

    def _refit(
        self, bare: Bare, trials: Sequence[Trial], task: str, least_um: float = math.inf
    ) -> list[Outcome]:
        core = type(bare.hysteresis)
        return refit_all(
            bare, [t for t in trials if t.kind.fits_in(core)], self._checkpoint, self._pool,
            lambda done, total: self.progress(task, done, total), least_um, self.seen,
        )  # fmt: skip

    def seen(self, outcome: Outcome) -> None:
        """Tell whoever watches that a refit is there."""
        if self._on_candidate is not None:
            stated = replace(outcome, errors=self.errors_of(outcome))
            self._on_candidate(refit_of(self.setting, stated, self._given))

    def _update_noise(self, state: State) -> None:
        records, measured = self._measured()
        residuals = [
            (r.y_um - simulate_effects([state.fit.variant], r)[:, 0])[r.error_mask] for r in records
        ]
        if state.outcome.mean_square < self._least:
            # what the best model leaves is most like the noise
            self._least, self._colour = state.outcome.mean_square, slowness(residuals)
        rough = rough_parts(residuals)
        white_um, _ = floor_from(measured, rough, 1.0)
        if self._whitest is None or white_um < self._whitest[0]:
            self._whitest = (white_um, measured, rough)
        self.noise_um, self.noise_origin = floor_from(*self._whitest[1:], self._colour)

    def _measured(self) -> tuple[tuple[Record, ...], MeasuredNoise]:
        """The records that are fitted and judged, and their noise without a model."""
        parts = self.setting.train, self.setting.validation
        if self._pooled is None or any(
            a is not b for a, b in zip(self._pooled[0], parts, strict=True)
        ):
            # a record of which a part is held out is one record
            whole: dict[str, Record] = {}
            for r in (*parts[0], *parts[1]):
                other = whole.get(r.name, r)
                whole[r.name] = replace(r, error_mask=r.error_mask | other.error_mask)
            records = tuple(whole.values())
            self._pooled = parts, records, measured_noise(self.still, records)
        return self._pooled[1:]

    def base(self, given: PlantModel[Any] | None) -> State:
        """Refit the base model, with the core and the effects that a given model has."""
        self.core, self._given = self._core(given), given
        return self._on_core(CORES[self.core.kind], () if given is None else given.effects)

    def _core(self, given: PlantModel[Any] | None) -> CoreChoice:
        """Return the core that is asked for or given; else RDPI, unless loops turn the wrong way for it.

        Asked for automatically, it is chosen among all kinds.
        """
        asked, clockwise = self._asked_core, orientation(self.setting.train)
        if asked is None and given is not None:
            asked = given.hysteresis.name
        if asked is None and not clockwise:
            return CoreChoice(RDPI.name, clockwise=clockwise)
        if asked is not None and asked != AUTO:
            return CoreChoice(asked, clockwise=clockwise)
        ways = fit_kinds(self.setting, [RDPI, *turning(clockwise)], self.progress, say=self.say)
        if asked is None or not ways:  # RDPI as long as no other kind is clearly better
            own = next((way.outcome for way in ways if way.kind is RDPI), None)
            if not ways or (own is not None and not instead(ways, own, self.seed)):
                return CoreChoice(RDPI.name, clockwise=clockwise)
        return choose(self.setting, ways, clockwise, self.seed)

    def other_core(self, state: State) -> CoreChoice | None:
        """Return another core that explains what an RDPI model with all its effects does not, if any.

        Asked only where no core was asked for or given, and something is left that is not the clock of
        one record: a record in a wrong time looks like another kind of hysteresis. Where little is
        left, plays and effects may imitate a kind: one of no more numbers has to leave half of that.
        """
        if self._asked_core is not None or self.core.kind != RDPI.name:
            return None
        left, variance = state.outcome.mean_square, self.noise_um**2
        # above the noise, not the numerical floor: that of another kind may be lower
        if left <= (1.0 + AT_FLOOR) * variance or self.clocks(state):
            return None
        much = left > _UNEXPLAINED_FLOORS**2 * variance and not self.at_floor(state)
        least_um = (_PROMISING_RATIO if much else _EQUAL_RATIO) * state.outcome.errors.train_rmse_um
        # a kind of very many numbers is none of no more, and slow beside some effects
        kinds = [k for k in turning(self.core.clockwise) if much or not k.loose]

        def better(ways: Sequence[Fitted]) -> list[Fitted]:
            if much and instead(ways, state.outcome, self.seed):
                return list(ways)
            return simpler(ways, Fitted(RDPI, state.outcome), self.noise_um, self.seed)

        ways = better(fit_kinds(self.setting, kinds, self.progress, (), least_um, self.say))
        if state.effects and not ways:
            # effects that stand in for the core are none beside it, but others may be
            beside = fit_kinds(
                self.setting, kinds, self.progress, state.effects, least_um, self.say
            )
            ways = better(beside)
        if not ways:
            return None
        every = [*ways, Fitted(RDPI, state.outcome)] if much else ways
        return choose(self.setting, every, self.core.clockwise, self.seed)

    def gives_way(self, state: State, other: State) -> bool:
        """Whether a model of another core is at the noise, or so much better that it takes the place of one.

        Many gains make up for an effect that was not found: to be better is not enough.
        """
        left, its = state.outcome.mean_square, other.outcome.mean_square
        near = its <= _NEAR_FLOORS**2 * self.noise_um**2
        if its < _FAR_RATIO * left or (near and its < _NEAR_RATIO * left):
            return True
        own, others = (Fitted(type(s.hysteresis), s.outcome) for s in (state, other))
        return near and bool(simpler([others], own, self.noise_um, self.seed))

    def left_by(self, core: CoreChoice, state: State, other: State) -> str:
        """Say what a search with another core left, which did not take the place of this one."""
        own_um, its_um = (s.outcome.errors.validation_rmse_um for s in (state, other))
        return template("other core", core=core.kind, its=its_um, own_core=RDPI.name, own=own_um)

    def base_of(self, core: CoreChoice) -> State:
        """Refit the base model with a core that was chosen, without effects."""
        self.core = core
        return self._on_core(CORES[core.kind], ())

    def _on_core(self, kind: type[Core], present: Sequence[Effect]) -> State:
        self.catalogue = {n: k for n, k in self._offered.items() if k.fits_in(kind)}
        wrong = [e.name for e in present if not type(e).fits_in(kind)]
        if wrong:
            raise InputError(
                f"the model has {joined(wrong)}, which only the core {RDPI.name} has; take it out, "
                f"or leave out --core {kind.name}"
            )
        self.progress("base model", 0, 1)
        fit = self.setting.fit(begun(self.setting, kind, present), present)
        state = State(assess(self.setting, "", fit))
        self._update_noise(state)
        state = self.past_outliers(self.past_openings(state))
        state = self._smoothed(state)
        if self._rates_alike:
            bare = typical_effects(self.catalogue, self.setting.scale)
            found = separability(self.setting.train, state.hysteresis, (), bare)
            self._like_rate = found.alike(RATE, _LIKE_RATE)
        self.progress("base model", 1, 1)
        self.seen(state.outcome)
        return state


def setting_of(dataset: Dataset) -> Setting:
    """Return the records to fit and to judge, and their size."""
    train, validation = dataset.train, dataset.validation
    return Setting(train, validation, data_scale((*train, *validation)))
