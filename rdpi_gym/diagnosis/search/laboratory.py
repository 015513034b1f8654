"""What a search works with: the data, the noise floor, the refits, what follows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from rdpi_gym.diagnosis.checks import run_checks
from rdpi_gym.diagnosis.features.noise import noise_floor, slowness
from rdpi_gym.diagnosis.hygiene import inspect, limits
from rdpi_gym.diagnosis.hygiene.finding import BoolArray, Finding
from rdpi_gym.diagnosis.hygiene.spikes import spikes
from rdpi_gym.diagnosis.portrait.drawing import draw
from rdpi_gym.diagnosis.portrait.learning import learn_forms
from rdpi_gym.diagnosis.portrait.portrait import Portrait
from rdpi_gym.diagnosis.probability import LEAST_PROBABLE, Course, of_classes
from rdpi_gym.diagnosis.results import Candidate, CoreChoice
from rdpi_gym.diagnosis.search.base_models import begun, on_comb
from rdpi_gym.diagnosis.search.candidates import (
    CHANCE,
    FIRST_SAMPLES,
    SEARCH_SAMPLES,
    Outcome,
    Setting,
    Trial,
    assess,
    past_cusps,
    refit,
    refit_all,
)
from rdpi_gym.diagnosis.search.checkpoint import Checkpoint
from rdpi_gym.diagnosis.search.core_choice import AUTO, Fitted, choose, fit_kinds, instead, turning
from rdpi_gym.diagnosis.search.forms import (
    better_forms,
    further_forms,
    in_best_form,
    simplified,
)
from rdpi_gym.diagnosis.search.law import in_few_numbers
from rdpi_gym.diagnosis.search.numerics import NumericalFloor, numerical_floor
from rdpi_gym.diagnosis.search.openings import (
    leaving_out,
    misleading,
    missed,
    outliers_left,
    unknown_past,
)
from rdpi_gym.diagnosis.search.ranking import (
    AT_FLOOR,
    LEAST_GAIN,
    SETTLED_GAIN,
    Ranked,
    not_missed,
    of_effect,
    own_bounds,
    rank,
    share_of_train,
)
from rdpi_gym.diagnosis.search.record_clocks import record_clocks
from rdpi_gym.diagnosis.search.scale import one_size
from rdpi_gym.diagnosis.search.separability import (
    RATE,
    separability,
    typical_effects,
)
from rdpi_gym.diagnosis.search.stability import (
    LEAST_STABLE,
    WITHIN,
    exchanged,
    in_blocks,
    stability,
)
from rdpi_gym.diagnosis.search.suitability import TURNED, falls, turned, unrelated
from rdpi_gym.diagnosis.search.thinning import close_up, thinned
from rdpi_gym.diagnosis.search.traces import taken_by
from rdpi_gym.diagnosis.search.verdict import EXPLAINED
from rdpi_gym.diagnosis.search.vetoes import hear
from rdpi_gym.identification.jacobian import simulate_effects
from rdpi_gym.identification.joint import FirstSteps, JointFit
from rdpi_gym.identification.kinds import orientation
from rdpi_gym.identification.plausibility import check_motion, check_scale
from rdpi_gym.identification.rates import rate_spread
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.identification.stack import stack_records
from rdpi_gym.measurement import Dataset, Record, hold_out_blocks
from rdpi_gym.plant import CORES, RDPI, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect, forms_of, in_chain_order
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.words import joined

_NOMINEES = 4
# Others that a drift is compared with where it is judged within the records, and the share of the
# excess that it has to take there.
_RIVALS_WITHIN, _MOST_OF_IT = 3, 0.5
# Of what the best candidate takes from the records to fit, what a drift takes that is as good.
_AS_WELL = 0.98
# Of the training error's excess, what a candidate's first steps have to take for it to be refined.
_GLIMPSE = 0.01
# Mean square without an effect over that with it from which on the error hangs on it.
_HANGS = 1.7
# Of a record, the outliers that a model may show beyond those that were found before.
_MOST_OUTLIERS = 0.03
# Samples to fit from which on blocks of them are held out, and not their end.
_BLOCKS = 64
# Prices of uneven weights where loops of one size are all there is to fit, and the share of the
# held-out error that another one has to take.
_SMOOTHNESS, _SMOOTHER = (0.0, 0.0004, 0.004), 0.04
# Of the training error's excess, what a candidate takes that is judged with exchanged roles too.
_ASKED = 0.2
# Largest confidence in one member of a class that records of one rate do not tell apart.
_ONE_CLASS = 0.5
# Rivals of an effect in each split of the records.
_SPLIT_RIVALS = 2
# Rivals that are tried once more in the end: by the gain of the effect chosen, or by the noise.
_CLOSE_GAIN, _CLOSE_NOISE = 0.03, 1.0
# Candidates of a round for which the effects that are there already are moved past their cusps.
_LEADERS = 4
# The best candidates of a round show the noise floor; what others leave is no smaller.
_FLOOR_FROM = 3
# Noise floors from which on another core is asked for at the end, and what its first steps have to
# leave of the error of the records to fit.
_NOWHERE, _HOPEFUL = 2.0, 0.7
# It takes the place of RDPI where it leaves so few noise floors and so much less, or far less.
_NEAR, _BESIDES, _FAR = 1.5, 0.6, 0.1
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


class Laboratory:
    """One data set; arguments as :func:`rdpi_gym.diagnosis.search.discover.diagnose`."""

    def __init__(
        self,
        dataset: Dataset,
        catalogue: Mapping[str, type[Effect]],
        jobs: int,
        seed: int,
        progress: Progress | None,
        checkpoint: Path | None,
        core: str | None = None,
    ) -> None:
        train, validation = tuple(dataset.train), tuple(dataset.validation)
        if not train or not validation:
            raise InputError(
                "a diagnosis needs records to fit and records to validate on; the data set has "
                f"{len(train)} and {len(validation)} in which the voltage moves"
            )
        check_motion(train)
        check_scale(train, dataset.quantities)
        reversed_sign = falls((*train, *validation))
        if reversed_sign:
            dataset = turned(dataset)
        self.orientation: tuple[str, ...] = (TURNED,) if reversed_sign else ()
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
        self.setting = _setting(dataset)
        train, validation = self.setting.train, self.setting.validation
        self._whole = self.setting
        self._searched: Setting | None = None
        self._close_up: tuple[Record, ...] = ()
        self._floor: tuple[State, tuple[Record, ...], NumericalFloor] | None = None
        self._clocks: tuple[State, float, tuple[Finding, ...]] | None = None
        if self._thinned is not None:
            self._close_up = close_up(_setting(inspected.dataset).validation)
        self._is_within = False
        self._spared: dict[str, BoolArray] = {}
        self.noise_um, self.noise_origin = math.nan, ""
        self._least, self._colour = math.inf, 1.0
        self._whitest: tuple[float, tuple[Record, ...], list[Array]] | None = None
        self._jobs, self._seed = jobs, seed
        self._progress = progress or (lambda task, done, total: None)
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

    def base(self, given: PlantModel[Any] | None) -> State:
        """Refit the base model, with the core and the effects that a given model has."""
        self.core = self._core(given)
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
        ways = fit_kinds(self.setting, [RDPI, *turning(clockwise)], self._progress)
        if asked is None:  # RDPI as long as no other kind is clearly better
            own = next(way.outcome for way in ways if way.kind is RDPI)
            if not instead(ways, own, self._seed):
                return CoreChoice(RDPI.name, clockwise=clockwise)
        return choose(ways, clockwise, self._seed)[0]

    def other_core(self, state: State) -> CoreChoice | None:
        """Return another core that explains what an RDPI model with all its effects does not, if any.

        Asked only where no core was asked for or given, and much is left that is not the clock of one
        record: a record in a wrong time looks like another kind of hysteresis.
        """
        left = state.outcome.mean_square
        if self._asked_core is not None or self.core.kind != RDPI.name:
            return None
        if left <= _NOWHERE**2 * self.noise_um**2 or self.at_floor(state) or self.clocks(state):
            return None
        least_um = _HOPEFUL * state.outcome.errors.train_rmse_um
        kinds = turning(self.core.clockwise)
        ways = fit_kinds(self.setting, kinds, self._progress, (), least_um)
        if state.effects and not instead(ways, state.outcome, self._seed):
            # effects that stand in for the core are none beside it, but others may be
            ways = fit_kinds(self.setting, kinds, self._progress, state.effects, least_um)
        if not instead(ways, state.outcome, self._seed):
            return None
        return choose([*ways, Fitted(RDPI, state.outcome)], self.core.clockwise, self._seed)[0]

    def gives_way(self, state: State, other: State) -> bool:
        """Whether a model of another core is at the noise, or so much better that it takes the place of one.

        Many gains make up for an effect that was not found: to be better is not enough.
        """
        left, its = state.outcome.mean_square, other.outcome.mean_square
        near = its <= _NEAR**2 * self.noise_um**2
        return its < _FAR * left or (near and its < _BESIDES * left)

    def left_by(self, core: CoreChoice, state: State, other: State) -> str:
        """Say what a search with another core left, which did not take the place of this one."""
        own_um, its_um = (s.outcome.errors.validation_rmse_um for s in (state, other))
        return (
            f"the core {core.kind} with its own effects leaves {its_um:.4g} µm held out, {RDPI.name} "
            f"{own_um:.4g} µm: --core {core.kind} shows it"
        )

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
        self._progress("base model", 0, 1)
        state = State(refit(self.setting, begun(self.setting, kind, present), present, None))
        self._update_noise(state)
        state = self.past_outliers(self.past_openings(state))
        state = self._smoothed(state)
        if self._rates_alike:
            bare = typical_effects(self.catalogue, self.setting.scale)
            found = separability(self.setting.train, state.hysteresis, (), bare)
            self._like_rate = found.alike(RATE, _LIKE_RATE)
        self._progress("base model", 1, 1)
        return state

    def _smoothed(self, state: State) -> State:
        """Return a model with weights as smooth as held-out records like them best."""
        if self._is_explained(state) or not one_size(self.setting.train):
            return state
        best, chosen = state, self.setting
        for price in _SMOOTHNESS:
            if price == self.setting.smoothness:
                continue
            setting = replace(self.setting, smoothness=price)
            trial = State(assess(setting, "", setting.fit(state.hysteresis, state.effects)))
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

    def again(self, state: State) -> State:
        """Return a model refitted to the samples that count now."""
        state = State(refit(self.setting, state.hysteresis, state.effects, None))
        self._update_noise(state)
        return state

    def ranked(self, state: State) -> list[Ranked]:
        """Refit every candidate that the model does not have, and better forms of what it has."""
        have = {effect.name for effect in state.effects}
        kinds = {name: kind for name, kind in self.catalogue.items() if name not in have}
        task = "with " + ", ".join(e.name for e in state.effects) if have else "candidates"
        scale = self.setting.scale
        starts = self._starts(state, list(kinds.values()))
        new = [
            Trial(kind, state.effects, start)
            for kind, start in zip(kinds.values(), starts, strict=True)
        ]
        begun = self.setting.first_steps(self._plays(state), state.effects, 0)
        least_um = self._least_um(begun)
        simple = self._refit(state, [*new, *better_forms(state.effects, scale)], task, least_um)
        leaders = [past_cusps(self.setting, o, state.effects) for o in simple[:_LEADERS]]
        outcomes = sorted([*leaders, *simple[_LEADERS:]], key=lambda o: o.mean_square)
        self._floor_from(outcomes)
        if not outcomes:
            return []
        if outcomes[0].mean_square > (1.0 + AT_FLOOR) * self.noise_um**2:
            others = [o for o in outcomes if o.effect in kinds]
            suspects = self._suspects | self._traced(begun, list(kinds.values()))
            if missed(self.setting, state.outcome, self._openings, self.noise_um):
                suspects = suspects | {"initial_memory"}
            trials = further_forms(state.outcome, others, kinds, state.effects, scale, suspects)
            outcomes += self._refit(state, trials, f"forms {task}", least_um)
            self._floor_from(sorted(outcomes, key=lambda o: o.mean_square))
        tried = [*kinds.values(), *(type(e) for e in state.effects)]
        best = in_best_form(outcomes, self.noise_um)
        most = self._most_trained(state, outcomes)
        ranked = [
            replace(r, most_train_share=most.get(r.candidate.effect, 0.0))
            for r in rank(state.outcome, best, tried, self.noise_um, self._seed)
        ]
        if not self._rates_alike:
            return ranked
        alike = set(self._like_rate) - have
        return [_lags(r, self._like_rate) if r.candidate.effect in alike else r for r in ranked]

    def learned(self, state: State, kind: type[Effect]) -> list[Ranked]:
        """Refit every form of a block that records teach, and return the one worth its freedom."""
        outcomes = learn_forms(
            self.setting, self._plays(state), state.effects, kind, self._progress
        )  # fmt: skip
        best = in_best_form(outcomes, self.noise_um)
        return rank(state.outcome, best, [kind], self.noise_um, self._seed)

    def portrait(self, state: State, nearest: Sequence[Candidate]) -> Portrait | None:
        """Draw the portrait of what a model misses, beside the effects that came nearest to it."""
        setting = self.searched
        whole = on_comb(state.hysteresis, setting.train)
        fitted = State(assess(setting, "", setting.fit(whole, state.effects)))
        typical = typical_effects(self.catalogue, setting.scale)
        kin = {c.effect: typical[c.effect] for c in nearest if c.effect in typical}
        plays, present = self._plays(fitted), fitted.effects
        forms = learn_forms(setting, plays, present, Unknown, self._progress)
        return draw(setting, plays, present, forms, kin, self._seed, self._progress)

    def _most_trained(self, state: State, outcomes: Sequence[Outcome]) -> dict[str, float]:
        """Return by effect what its best form takes of the error of the records to fit."""
        variance, most = self.noise_um**2, dict[str, float]()
        for outcome in outcomes:
            if outcome.fit is not None:
                share = share_of_train(state.outcome, outcome, variance)
                most[outcome.effect] = max(share, most.get(outcome.effect, share))
        return most

    def _starts(
        self, state: State, kinds: Sequence[type[Effect]]
    ) -> list[tuple[Effect, ...] | None]:
        """Return the starts of candidates with those that the longest record shows, if any."""
        record = max(self.setting.train, key=lambda r: r.t_s[-1] - r.t_s[0])
        left_um = record.y_um - simulate_effects([state.fit.variant], record)[:, 0]
        left_um -= left_um.mean()
        shown = [kind.seen_in(record.t_s, left_um) for kind in kinds]
        return [
            (*seen, *kind.starts(self.setting.scale)) if seen else None
            for kind, seen in zip(kinds, shown, strict=True)
        ]

    def _plays(self, state: State) -> Core:
        # smooth weights are those of the whole comb
        return state.hysteresis if self.setting.smoothness else state.hysteresis.pruned()

    def _refit(
        self, state: State, trials: Sequence[Trial], task: str, least_um: float = math.inf
    ) -> list[Outcome]:
        core = type(state.hysteresis)
        return refit_all(
            self.setting, self._plays(state), [t for t in trials if t.kind.fits_in(core)],
            self._checkpoint, self._jobs,
            lambda done, total: self._progress(task, done, total), least_um,
        )  # fmt: skip

    def _least_um(self, begun: FirstSteps) -> float:
        """Return the training error (µm) that is no gain: what takes no more is not refined."""
        return math.sqrt((1.0 - self._worth_a_look(begun)) * begun.train_rmse_um**2)

    def _worth_a_look(self, begun: FirstSteps) -> float:
        """Return the share of what a model leaves that a candidate has to take to be refined."""
        excess = 1.0 - (self.noise_um / max(begun.train_rmse_um, 1e-300)) ** 2
        return _GLIMPSE * max(excess, 0.0)

    def _traced(self, begun: FirstSteps, kinds: Sequence[type[Effect]]) -> set[str]:
        """Return the candidates of which some form could take a share that is worth a look."""
        records, scale = self.setting.train, self.setting.scale
        least, counted = self._worth_a_look(begun), sum(map(len, begun.left_um))
        traces = {kind.name: kind.traces(scale) for kind in kinds}
        return {
            name
            for name, them in traces.items()
            if them
            and taken_by(records, begun, them, FIRST_SAMPLES) > least + CHANCE * len(them) / counted
        }

    def _floor_from(self, outcomes: Sequence[Outcome]) -> None:
        for outcome in [o for o in outcomes if o.fit is not None][:_FLOOR_FROM]:
            self._update_noise(State(outcome))

    def choose(self, state: State, ranked: Sequence[Ranked]) -> list[Ranked]:
        """Return what to add: the simplest of the best class, a pair, or nothing."""
        if self._goes_by_the_clock(ranked) and (found := self._within(state, ranked)):
            return found
        earned = self._heard([r for r in ranked if r.earned])
        if earned:
            best = max(earned, key=lambda r: r.worth)
            names = (best.candidate.effect, *best.candidate.indistinguishable)
            have = {effect.name for effect in state.effects}
            equals = [r for r in earned if r.candidate.effect in names]
            # a better form of an effect that is there comes before another name
            return [
                min(
                    equals,
                    key=lambda r: (
                        _bounds_hit(r), r.candidate.effect not in have,
                        len(r.candidate.parameters), -r.worth,
                    ),
                )
            ]  # fmt: skip
        if self._is_explained(state):
            return []
        return (
            self._both_ways(state, ranked)
            or self._within(state, ranked)
            or self._pair(state, ranked)
        )

    def _goes_by_the_clock(self, ranked: Sequence[Ranked]) -> bool:
        """Whether a drift explains the records to fit best: no later record tells its form."""
        most = max((r.most_train_share for r in ranked), default=0.0)
        return any(
            r.most_train_share >= max(_MOST_OF_IT, _AS_WELL * most)
            for r in ranked
            if r.candidate.effect in self.catalogue and self.catalogue[r.candidate.effect].clocked
        )

    def _within(self, state: State, ranked: Sequence[Ranked]) -> list[Ranked]:
        """Judge within every record what the records to fit ask for: the others may not show it.

        What goes by the clock is told of no later record; and where more than one effect is
        missing, one that is added alone can spoil a record that hangs on another.
        """
        if self.dataset.holds_out_quarters or self._is_within:
            return []
        asked = self._asked_within(ranked)
        if not asked:
            return []
        kinds = [self.catalogue[name] for name in asked]
        here = in_blocks(self.setting)
        now = refit(here, state.hysteresis, state.effects, None)
        tried = [
            refit(here, state.hysteresis, state.effects, form)
            for kind in kinds
            for form in forms_of(kind)
            if form.fits_in(type(state.hysteresis))
        ]
        others = [r for r in ranked if r.candidate.effect not in asked and r.outcome.fit]
        for r in sorted(others, key=lambda r: r.train_share)[-_RIVALS_WITHIN:]:
            tried.append(refit(here, state.hysteresis, state.effects, type(r.outcome.fitted)))
            kinds.append(type(r.outcome.fitted))
        again = rank(now, in_best_form(tried, self.noise_um), kinds, self.noise_um, self._seed)
        best = max(again, key=lambda r: r.worth)
        if best.candidate.effect not in asked or best.worth <= _MOST_OF_IT:
            return []
        if not self._heard([best]):
            return []
        self.setting, self._whole, self._is_within = here, in_blocks(self._whole), True
        self.remarks = (*self.remarks, WITHIN)
        return [best]

    def _asked_within(self, ranked: Sequence[Ranked]) -> set[str]:
        """Return the candidates that take much of the error of the records to fit."""
        new = [r for r in ranked if r.candidate.effect in self.catalogue]
        clocked = {
            r.candidate.effect
            for r in new
            if self.catalogue[r.candidate.effect].clocked and r.most_train_share >= _ASKED
        }
        most = sorted((r for r in new if r.train_share > _MOST_OF_IT), key=lambda r: r.train_share)
        return clocked | {r.candidate.effect for r in most[-_RIVALS_WITHIN:]}

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

    def _both_ways(self, state: State, ranked: Sequence[Ranked]) -> list[Ranked]:
        """Judge what the records to fit ask for with the roles of the records exchanged too."""
        here = exchanged(self.setting, self.dataset.holds_out_quarters)
        if here is None:
            return []
        asked = [r for r in ranked if r.train_share >= _ASKED and r.candidate.share > 0.0]
        now = assess(here, "", here.fit(state.hysteresis, state.effects, samples=SEARCH_SAMPLES))
        for r in self._heard([r for r in asked if not r.worse]):
            assert r.outcome.fit is not None
            start = r.outcome.fit.variant
            fit = here.fit(start.hysteresis, start.effects, samples=SEARCH_SAMPLES)
            turned_round = assess(here, r.candidate.effect, fit)
            kinds = [type(r.outcome.fitted)]
            again = rank(now, [turned_round], kinds, self.noise_um, self._seed)[0]
            if again.earned:
                return [r]
        return []

    def _heard(self, earned: Sequence[Ranked]) -> list[Ranked]:
        """Leave out what a test without a model denies, and what is not what its name says."""
        left = []
        for r in earned:
            assert r.outcome.fit is not None
            name = r.candidate.effect
            if r.outcome.fitted.is_idle(self.setting.scale):
                continue
            veto = hear(
                self.dataset, self.checks, r.outcome.fit.variant, name, self.noise_um, self._seed
            )
            if veto is None:
                left.append(r)
            else:
                self.remarks = tuple(dict.fromkeys((*self.remarks, f"{name} vetoed: {veto}")))
        return left

    def _pair(self, state: State, ranked: Sequence[Ranked]) -> list[Ranked]:
        """Try pairs of nominees: effects may help only together."""
        have = {effect.name for effect in state.effects}
        usable = [r for r in ranked if r.outcome.fit is not None and r.candidate.effect not in have]
        by_train = sorted(usable, key=lambda r: r.outcome.errors.train_rmse_um)
        nominees = {r.candidate.effect: r for r in (*usable[:2], *by_train[:_NOMINEES])}
        best: tuple[float, Outcome, list[str]] | None = None
        pairs = list(combinations(nominees, 2))
        for done, (first, second) in enumerate(pairs):
            self._progress("pairs", done, len(pairs))
            start = nominees[first].outcome.fit
            assert start is not None
            outcome = refit(
                self.setting, start.variant.hysteresis, start.variant.effects,
                self.catalogue[second],
            )  # fmt: skip
            if outcome.fit is not None and (best is None or outcome.mean_square < best[0]):
                best = (outcome.mean_square, outcome, [first, second])
        if best is None:
            return []
        kinds = [self.catalogue[name] for name in best[2]]
        together = rank(state.outcome, [best[1]], kinds, self.noise_um, self._seed)[0]
        alone = min(nominees[name].outcome.mean_square for name in best[2])
        if not together.earned or best[0] > alone - LEAST_GAIN * self.noise_um**2:
            return []
        return [
            Ranked(best[1], of_effect(together.candidate, best[1].fit, name), True)
            for name in best[2]
        ]

    def after(self, state: State, chosen: Sequence[Ranked]) -> State:
        """Return the model with what was chosen, refitted on the whole comb."""
        if not chosen or chosen[-1].outcome.fit is None:
            return state
        return self.on_whole_comb(State(chosen[-1].outcome))

    def on_whole_comb(self, state: State) -> State:
        """Return a model refitted on the whole comb."""
        whole = on_comb(state.hysteresis, self.setting.train)
        fit = self.setting.fit(whole, state.effects)
        return self._smoothed(State(assess(self.setting, "", fit)))

    def _is_explained(self, state: State) -> bool:
        return state.outcome.errors.validation_rmse_um <= EXPLAINED * self.noise_um

    def need(self, ranked: Sequence[Ranked], kind: type[Effect]) -> None:
        """Refuse where an effect that was asked for cannot be fitted."""
        if ranked[0].outcome.fit is None:
            raise InputError(f"{kind.name}: {ranked[0].outcome.remark}")

    def eliminate(self, state: State, added: Sequence[str]) -> tuple[State, tuple[str, ...]]:
        """Take out what is not missed when it is gone."""
        removed: list[str] = []
        for name in added if len(added) > 1 else ():
            self._progress("backward elimination", len(removed), len(added))
            without = self.without(state, [name])
            loss = without.outcome.mean_square - state.outcome.mean_square
            if loss < not_missed(self.noise_um):
                state, removed = without, [*removed, name]
        return state, tuple(removed)

    def rivals(
        self, state: State, chosen: Candidate, field: Sequence[Ranked]
    ) -> tuple[Effect, ...]:
        """Return what came so close to a chosen effect in its round that it is tried once more."""
        own = chosen.errors.validation_rmse_um**2
        gain = state.outcome.mean_square - own
        reach = max(_CLOSE_GAIN * gain, _CLOSE_NOISE * self.noise_um**2)
        barred = {chosen.effect, *self._like_rate, *(e.name for e in state.effects)}
        return tuple(
            r.outcome.fitted
            for r in field
            if r.outcome.fit is not None
            and r.candidate.effect not in barred
            and r.candidate.errors.validation_rmse_um**2 - own <= reach
            and not r.outcome.fitted.is_idle(self.setting.scale)
        )

    def recall(self, state: State) -> tuple[State, list[Candidate]]:
        """Try a memory that all records share where openings were left out, with all else there."""
        if not self._spared:
            return state, []
        state = self._respected(state)
        kind = self.catalogue.get("initial_memory")
        have = {effect.name for effect in state.effects}
        if kind is None or kind.name in have or not self._spared:
            return state, []
        whole = replace(self._whole, smoothness=self.setting.smoothness)
        now = refit(whole, state.hysteresis, state.effects, None)
        tried = [refit(whole, state.hysteresis, state.effects, k) for k in forms_of(kind)]
        ranked = rank(now, in_best_form(tried, self.noise_um), [kind], self.noise_um, self._seed)
        best = ranked[0]
        if best.outcome.fit is None or not best.earned:
            return state, []
        still = misleading(whole, best.outcome, self._openings, self.noise_um)
        self.setting = leaving_out(whole, still)
        state = State(refit(self.setting, state.hysteresis, best.outcome.fit.variant.effects, None))
        self._update_noise(state)
        return state, [replace(best.candidate, errors=state.outcome.errors)]

    def _respected(self, state: State) -> State:
        """Count the openings again that the model tells now, with all effects there."""
        whole = replace(self._whole, smoothness=self.setting.smoothness)
        still = missed(whole, state.outcome, self._spared, self.noise_um)
        if still.keys() == self._spared.keys():
            return state
        self.setting, self._spared = leaving_out(whole, still), still
        kept = tuple(f for f in self.findings if f.kind != "in motion")
        self.findings = (*kept, unknown_past(still)) if still else kept
        return self.again(state)

    def merge(self, state: State, added: Sequence[str]) -> tuple[State, tuple[str, ...]]:
        """Take out an effect that another one, in a better form, stands for as well."""
        gone: list[str] = []
        for name in added:
            here = {e.name: e for e in state.effects}
            if name not in here:
                continue
            kept = in_chain_order(e for e in state.effects if e.name != name)
            kin = [e for e in kept if name in e.mistaken_for or e.name in here[name].mistaken_for]
            trials = [
                t
                for t in better_forms(kept, self.setting.scale)
                if t.kind.name in {e.name for e in kin}
            ]
            for outcome in self._refit(state, trials, f"without {name}") if trials else []:
                loss = outcome.mean_square - state.outcome.mean_square
                if outcome.fit is not None and loss < AT_FLOOR * self.noise_um**2:
                    merged = State(replace(outcome, effect=""))
                    state, gone = merged, [*gone, name]
                    break
        return state, tuple(gone)

    def simplify(self, state: State) -> tuple[State, tuple[str, ...]]:
        """Try simpler forms of the effects back; return what was given up, in sentences."""
        outcome, given_up = simplified(
            self.setting, state.outcome, state.hysteresis, self.noise_um,
            lambda done, total: self._progress("simpler forms", done, total),
        )  # fmt: skip
        notes = [f"{name} does not need the form {form!r}" for name, form in given_up.items()]
        return State(outcome), tuple(notes)

    def sure(
        self, state: State, added: Sequence[Candidate], rivals: Mapping[str, Sequence[Effect]]
    ) -> list[Candidate]:
        """Return the steps with the confidence that splits of the records give them."""
        if not added:
            return []
        judged = {
            c.effect: [e for e in rivals.get(c.effect, ()) if e.name not in c.indistinguishable][
                :_SPLIT_RIVALS
            ]
            for c in added
        }
        found = stability(
            self.setting, state.outcome, judged, self.dataset.holds_out_quarters, self._seed,
            lambda done, total: self._progress("splits of the records", done, total),
        )  # fmt: skip
        known = [
            replace(c, confidence=found[c.effect].confidence, without_um=found[c.effect].without_um)
            for c in added
        ]
        return [_of_class(c, self._like_rate) if c.effect in self._like_rate else c for c in known]

    def settle(
        self, state: State, steps: Sequence[Candidate], rivals: Mapping[str, Sequence[Effect]]
    ) -> tuple[State, list[Candidate]]:
        """Try each added effect's rivals once more, now that all others are there."""
        settled: list[Candidate] = []
        for step in steps:
            others = in_chain_order(e for e in state.effects if e.name != step.effect)
            have = {e.name for e in state.effects}
            kinds = [type(e) for e in rivals.get(step.effect, ()) if e.name not in have]
            if not kinds:
                settled.append(replace(step, indistinguishable=()))
                continue
            self._progress(f"rivals of {step.effect}", 0, len(kinds))
            outcomes = [refit(self.setting, state.hysteresis, others, kind) for kind in kinds]
            # an effect is replaced only by one that fits the other records no worse either
            most = state.outcome.errors.train_rmse_um * (1.0 + SETTLED_GAIN)
            outcomes = [o for o in outcomes if o.errors.train_rmse_um <= most and not own_bounds(o)]
            own = replace(state.outcome, effect=step.effect, form=step.form)
            without = assess(self.setting, "", self.setting.fit(state.hysteresis, others))
            ranked = rank(
                without, [own, *outcomes], [*kinds, self.catalogue[step.effect]], self.noise_um,
                self._seed, SETTLED_GAIN,
            )  # fmt: skip
            best = ranked[0]
            if step.effect in (best.candidate.effect, *best.candidate.indistinguishable):
                best = next(r for r in ranked if r.candidate.effect == step.effect)
            else:
                state = State(best.outcome)
            settled.append(
                replace(
                    best.candidate, errors=step.errors, share=step.share, evidence=step.evidence
                )
                if best.candidate.effect == step.effect
                else best.candidate
            )
        return state, settled

    def less_sure(self, state: State, added: Sequence[Candidate]) -> tuple[State, tuple[str, ...]]:
        """Take out what contributes nothing, and what splits of the records do not choose again.

        Of the latter, what the error hangs on stays.
        """
        removed: list[str] = []
        least = LEAST_GAIN * self.noise_um**2
        for step in sorted(added, key=lambda c: c.confidence):
            gain = (step.without_um or math.inf) ** 2 - state.outcome.mean_square
            if step.confidence >= LEAST_STABLE and (gain > 2.0 * least or len(added) == 1):
                continue
            without = self.without(state, [step.effect])
            loss = without.outcome.mean_square - state.outcome.mean_square
            unstable = step.confidence < LEAST_STABLE
            hangs = without.outcome.mean_square > _HANGS * state.outcome.mean_square
            if loss < least or (unstable and not hangs):
                state, removed = without, [*removed, step.effect]
        return state, tuple(removed)

    def improbable(
        self, base: State, state: State, added: Sequence[Candidate], tried: Sequence[Candidate]
    ) -> tuple[State, tuple[str, ...], tuple[str, ...]]:
        """Take out what is less probable than not, with all that is indistinguishable from it.

        What the error hangs on stays, as little as its name may be believed. Returns the model, what
        went, and what it would have taken away, in sentences.
        """
        kept, removed, notes = list(added), list[str](), list[str]()
        needed: set[str] = set()
        while len(needed) < len(kept):
            chances = of_classes(self.course(base, state, kept, tried))
            asked = [k for k, step in enumerate(kept) if step.effect not in needed]
            least = min(asked, key=chances.__getitem__)
            if chances[least] >= LEAST_PROBABLE:
                break
            name, without = kept[least].effect, self.without(state, [kept[least].effect])
            if without.outcome.mean_square > _HANGS * state.outcome.mean_square:
                needed.add(name)
                continue
            with_um, without_um = (s.outcome.errors.validation_rmse_um for s in (state, without))
            notes.append(
                f"{name} was taken out again, as it is {100.0 * chances[least]:.0f} % probable: the "
                f"validation error is {with_um:.4g} µm with it and {without_um:.4g} µm without"
            )
            state, removed = without, [*removed, name]
            del kept[least]
        return state, tuple(removed), tuple(notes)

    def course(
        self, base: State, state: State, added: Sequence[Candidate], tried: Sequence[Candidate]
    ) -> Course:
        """Return how the search went, as far as probabilities are read from it."""
        floor_um = math.hypot(self.noise_um, self.numerical(state).total_um)
        base_um, end_um = (s.outcome.errors.validation_rmse_um for s in (base, state))
        return Course(base_um, end_um, floor_um, added, tried)

    def without(self, state: State, names: Sequence[str]) -> State:
        """Return the model without some effects, refitted."""
        kept = in_chain_order(e for e in state.effects if e.name not in names)
        fit = self.setting.fit(state.hysteresis, kept)
        return State(assess(self.setting, "", fit))

    def final(self, state: State, step: Candidate) -> Candidate:
        """Return a step with the parameters of the final model."""
        return of_effect(step, state.fit, step.effect)

    def at_floor(self, state: State) -> bool:
        """Whether so little exceeds noise and numerical floor that no effect can be earned."""
        variance = self.noise_um**2
        if state.outcome.mean_square - variance < AT_FLOOR * variance:
            return True
        variance += self.numerical(state).total_um ** 2
        return state.outcome.mean_square - variance < AT_FLOOR * variance

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

    def on_law(self, state: State, given: PlantModel[Any] | None) -> tuple[State, tuple[str, ...]]:
        """Return the model with a core of few numbers where that costs little, and remarks."""
        outcome, notes = in_few_numbers(self.setting, state.outcome, given, self.noise_um)
        return State(outcome), (*self.orientation, *notes)

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

    def read_all(self, base: State, end: State) -> tuple[State, State]:
        """Return two models refitted and judged on all samples, as everything is from here on."""
        if self._thinned is None:
            return base, end
        self._progress("all samples", 0, 2)
        self._searched, recorded = self.setting, self._recorded
        self.dataset, self._openings = recorded.dataset, recorded.openings
        setting = replace(_setting(self.dataset), smoothness=self.setting.smoothness)
        self._whole = setting = in_blocks(setting) if self._is_within else setting
        self._spared = {name: self._openings[name] for name in self._spared}
        self.setting, self.findings = leaving_out(setting, self._spared), recorded.findings
        if self._spared:
            kept = (f for f in self.findings if f.kind != "in motion")
            self.findings = (*kept, unknown_past(self._spared))
        self._least, self._whitest = math.inf, None
        base = self.again(base)
        self._progress("all samples", 1, 2)
        end = self.past_outliers(self.again(end))
        self._progress("all samples", 2, 2)
        return base, end

    def final_noise(self, state: State) -> None:
        """Take the noise's colour from the model that is saved."""
        self._least = math.inf
        self._update_noise(state)

    def _update_noise(self, state: State) -> None:
        # a record of which a part is held out is one record
        whole: dict[str, Record] = {}
        for r in (*self.setting.train, *self.setting.validation):
            other = whole.get(r.name, r)
            whole[r.name] = replace(r, error_mask=r.error_mask | other.error_mask)
        records = tuple(whole.values())
        residuals = [
            (r.y_um - simulate_effects([state.fit.variant], r)[:, 0])[r.error_mask] for r in records
        ]
        if state.outcome.mean_square < self._least:
            # what the best model leaves is most like the noise
            self._least, self._colour = state.outcome.mean_square, slowness(residuals)
        quiet = self.dataset.quiet
        white_um, _ = noise_floor(quiet, records, residuals, colour=1.0)
        if self._whitest is None or white_um < self._whitest[0]:
            self._whitest = (white_um, records, residuals)
        self.noise_um, self.noise_origin = noise_floor(
            quiet, *self._whitest[1:], colour=self._colour
        )


def _setting(dataset: Dataset) -> Setting:
    """Return the records to fit and to judge, and their size."""
    train, validation = _parts(dataset)
    return Setting(train, validation, data_scale((*train, *validation)))


def _parts(dataset: Dataset) -> tuple[tuple[Record, ...], tuple[Record, ...]]:
    """Records to fit and to judge; without any for the latter, blocks of the former in turn."""
    if not dataset.holds_out_quarters or min(r.error_mask.sum() for r in dataset.train) < _BLOCKS:
        return tuple(dataset.train), tuple(dataset.validation)
    whole = [r for r in dataset.records if r.role == "train" and not r.is_quiet]
    parts = [hold_out_blocks(record) for record in whole]
    return tuple(train for train, _ in parts), tuple(held for _, held in parts)


def _bounds_hit(ranked: Ranked) -> int:
    return len(own_bounds(ranked.outcome))


def _lags(ranked: Ranked, alike: Sequence[str]) -> Ranked:
    """Return a candidate that records of one rate cannot tell from others that lag."""
    candidate = _of_class(ranked.candidate, alike)
    remark = "one class with them and with δ2: all rates are alike"
    return replace(ranked, candidate=replace(candidate, remarks=(*candidate.remarks, remark)))


def _of_class(candidate: Candidate, alike: Sequence[str]) -> Candidate:
    """Return a candidate as a member of a class, and no surer than one can be."""
    names = dict.fromkeys((*candidate.indistinguishable, *alike))
    return replace(
        candidate,
        indistinguishable=tuple(name for name in names if name != candidate.effect),
        confidence=min(candidate.confidence, _ONE_CLASS),
    )
