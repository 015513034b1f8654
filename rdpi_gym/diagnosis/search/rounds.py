"""One round of a search: every candidate refitted and ranked, and what of it is added."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from rdpi_gym.diagnosis.checks import Check, run_checks
from rdpi_gym.diagnosis.portrait.trials import learn_forms
from rdpi_gym.diagnosis.results import Candidate, Errors, share_of_excess
from rdpi_gym.diagnosis.search.candidates import (
    CHANCE,
    SEARCH_SAMPLES,
    Outcome,
    Setting,
    Trial,
    assess,
    attempt,
    of_effect,
    past_cusps,
    refit,
    refit_kinds,
    taken_by,
)
from rdpi_gym.diagnosis.search.plants import on_comb
from rdpi_gym.diagnosis.search.ranking import (
    AT_FLOOR,
    LEAST_GAIN,
    Ranked,
    better_forms,
    exchanged,
    further_forms,
    in_best_form,
    in_blocks,
    own_bounds,
    rank,
    share_of_train,
)
from rdpi_gym.diagnosis.search.record_clocks import missed
from rdpi_gym.diagnosis.search.refitting import Refitting, State
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.cores import FIRST_SAMPLES
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import NO_FIT, FirstSteps, JointFit
from rdpi_gym.measurement import Dataset
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect, forms_of
from rdpi_gym.support.errors import InputError

_NOMINEES = 4
# Others that a drift is compared with where it is judged within the records, and the share of the
# excess that it has to take there.
_RIVALS_WITHIN, _MOST_OF_IT = 3, 0.5
# Of what the best candidate takes from the records to fit, what a drift takes that is as good.
_AS_WELL = 0.98
# Of the training error's excess, what a candidate's first steps have to take for it to be refined.
_GLIMPSE = 0.01
# Of the training error's excess, what a candidate takes that is judged with exchanged roles too.
_ASKED = 0.2
# Largest confidence in one member of a class that records of one rate do not tell apart.
_ONE_CLASS = 0.5
# Rivals that are tried once more in the end: by the gain of the effect chosen, or by the noise.
_CLOSE_GAIN, _CLOSE_NOISE = 0.03, 1.0
# Candidates of a round for which the effects that are there already are moved past their cusps.
_LEADERS = 4
# The best candidates of a round show the noise floor; what others leave is no smaller.
_FLOOR_FROM = 3


class Rounds(Refitting):
    """A search that refits, ranks and chooses candidates."""

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
        bare = self._bare(state)
        try:
            begun = bare.begun
        except NO_FIT as error:
            self.say(template("nothing tried", error=error))
            return []
        least_um = self._least_um(begun)
        simple = self._refit(bare, [*new, *better_forms(state.effects, scale)], task, least_um)
        leaders = simple[:_LEADERS]
        if any(effect.kinked for effect in state.effects):
            along = partial(past_cusps, self.setting, present=state.effects)
            leaders = self._pool.map(along, leaders)
        for before, moved in zip(simple, leaders, strict=False):
            if moved.errors != before.errors:
                self.seen(moved)
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
            outcomes += self._refit(bare, trials, f"forms {task}", least_um)
            self._floor_from(sorted(outcomes, key=lambda o: o.mean_square))
        tried = [*kinds.values(), *(type(e) for e in state.effects)]
        best = in_best_form(outcomes, self.noise_um)
        most = self._most_trained(state, outcomes)
        ranked = [
            replace(r, most_train_share=most.get(r.candidate.effect, 0.0), within=self.is_within)
            for r in rank(state.outcome, best, tried, self.noise_um, self.seed)
        ]
        if not self._rates_alike:
            return ranked
        alike = set(self._like_rate) - have
        return [_lags(r, self._like_rate) if r.candidate.effect in alike else r for r in ranked]

    def learned(self, state: State, kind: type[Effect]) -> list[Ranked]:
        """Refit every form of a block that records teach, and return the one worth its freedom."""
        outcomes = learn_forms(
            self.setting, self._plays(state), state.effects, kind, self.progress
        )  # fmt: skip
        best = in_best_form(outcomes, self.noise_um)
        return rank(state.outcome, best, [kind], self.noise_um, self.seed)

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

    def after(self, state: State, chosen: Sequence[Ranked]) -> State:
        """Return the model with what was chosen, refitted on the whole comb."""
        if not chosen or chosen[-1].outcome.fit is None:
            return state
        return self.on_whole_comb(State(chosen[-1].outcome))

    def need(self, ranked: Sequence[Ranked], kind: type[Effect]) -> None:
        """Refuse where an effect that was asked for cannot be fitted."""
        if not ranked or ranked[0].outcome.fit is None:
            remarks = [r.outcome.remark for r in ranked] or [*self.remarks]
            raise InputError(f"{kind.name}: {remarks[-1]}")

    def stated(
        self, ranked: Sequence[Ranked], before: Errors | None = None
    ) -> tuple[Candidate, ...]:
        """Return the candidates of a round with their errors and shares as they are stated.

        Those that were judged on a stretch of a record, or before blocks of every record were held
        out, are judged again, each refitted from where it stands.
        """
        if self.reads_in_part or (self.is_within and not all(r.within for r in ranked)):
            ranked = self._judged_again(ranked)
        found = []
        for r in ranked:
            if r.outcome.fit is None or r.without is None:
                found.append(r.candidate)
                continue
            if before is None:
                before = self.errors_of(r.without)
            errors = self.errors_of(r.outcome)
            share = share_of_excess(before, errors, self.noise_um)
            found.append(replace(r.candidate, errors=errors, share=share))
        return tuple(found)

    def _judged_again(self, ranked: Sequence[Ranked]) -> list[Ranked]:
        """Judge the candidates of a round by the samples that count in the end."""
        every = [r for r in ranked if r.outcome.fit is not None and r.without is not None]
        if not every:
            return [*ranked]
        assert every[0].without is not None
        stand = partial(_outcome_as_it_stands, self.setting)
        now, *moved = self._pool.map(stand, [every[0].without, *(r.outcome for r in every)])
        if now.fit is None:
            return [*ranked]
        for outcome in moved:
            self.seen(outcome)
        failed = [r.outcome for r in ranked if r.outcome.fit is None]
        kinds = [type(o.fitted) for o in moved if o.fit is not None]
        again = rank(now, [*moved, *failed], kinds, self.noise_um, self.seed)
        place = [r.candidate.effect for r in ranked]
        return sorted(again, key=lambda r: place.index(r.candidate.effect))

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
        if self.dataset.holds_out_quarters or self.is_within:
            return []
        asked = self._asked_within(ranked)
        if not asked:
            return []
        kinds = [self.catalogue[name] for name in asked]
        here = in_blocks(self.setting)
        now = refit(here, state.hysteresis, state.effects, None)
        if now.fit is None:
            return []
        core = type(state.hysteresis)
        forms = [form for kind in kinds for form in forms_of(kind) if form.fits_in(core)]
        others = [r for r in ranked if r.candidate.effect not in asked and r.outcome.fit]
        for r in sorted(others, key=lambda r: r.train_share)[-_RIVALS_WITHIN:]:
            kinds.append(type(r.outcome.fitted))
            forms.append(kinds[-1])
        tried = refit_kinds(self._pool, here, state.hysteresis, state.effects, forms)
        again = rank(now, in_best_form(tried, self.noise_um), kinds, self.noise_um, self.seed)
        best = max(again, key=lambda r: r.worth)
        if best.candidate.effect not in asked or best.worth <= _MOST_OF_IT:
            return []
        if not self._heard([best]):
            return []
        self.setting, self.is_within = here, True
        self._whole, self._stated = map(in_blocks, (self._whole, self._stated))
        self.say(template("within records"))
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

    def _both_ways(self, state: State, ranked: Sequence[Ranked]) -> list[Ranked]:
        """Judge what the records to fit ask for with the roles of the records exchanged too."""
        here = exchanged(self.setting, self.dataset.holds_out_quarters)
        if here is None:
            return []
        asked = [r for r in ranked if r.train_share >= _ASKED and r.candidate.share > 0.0]
        now = _as_it_stands(here, state.fit)
        if now.fit is None:
            return []
        for r in self._heard([r for r in asked if not r.worse]):
            assert r.outcome.fit is not None
            turned_round = _as_it_stands(here, r.outcome.fit, r.candidate.effect)
            if turned_round.fit is None:
                continue
            kinds = [type(r.outcome.fitted)]
            again = rank(now, [turned_round], kinds, self.noise_um, self.seed)[0]
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
                self.dataset, self.checks, r.outcome.fit.variant, name, self.noise_um, self.seed
            )
            if veto is None:
                left.append(r)
            else:
                self.say(veto)
        return left

    def _pair(self, state: State, ranked: Sequence[Ranked]) -> list[Ranked]:
        """Try pairs of nominees: effects may help only together."""
        have = {effect.name for effect in state.effects}
        usable = [r for r in ranked if r.outcome.fit is not None and r.candidate.effect not in have]
        by_train = sorted(usable, key=lambda r: r.outcome.errors.train_rmse_um)
        nominees = {r.candidate.effect: r for r in (*usable[:2], *by_train[:_NOMINEES])}
        pairs = list(combinations(nominees, 2))
        cases = [(nominees[first].outcome, self.catalogue[second]) for first, second in pairs]
        done = 0

        def seen(outcome: Outcome) -> None:
            nonlocal done
            done += 1
            self.progress("pairs", done, len(pairs))

        self.progress("pairs", 0, len(pairs))
        outcomes = self._pool.map(partial(_with_another, self.setting), cases, seen)
        tried = [(o, names) for o, names in zip(outcomes, pairs, strict=True) if o.fit is not None]
        if not tried:
            return []
        best, names = min(tried, key=lambda pair: pair[0].mean_square)
        kinds = [self.catalogue[name] for name in names]
        together = rank(state.outcome, [best], kinds, self.noise_um, self.seed)[0]
        alone = min(nominees[name].outcome.mean_square for name in names)
        if not together.earned or best.mean_square > alone - LEAST_GAIN * self.noise_um**2:
            return []
        return [Ranked(best, of_effect(together.candidate, best.fit, name), True) for name in names]


def _with_another(setting: Setting, pair: tuple[Outcome, type[Effect]]) -> Outcome:
    """Refit a model with an effect more."""
    fit = pair[0].fit
    assert fit is not None
    return refit(setting, fit.variant.hysteresis, fit.variant.effects, pair[1])


def _as_it_stands(setting: Setting, fit: JointFit, effect: str = "") -> Outcome:
    """Refit a model to other data from where it stands; without a fit where that fails."""
    core, effects = fit.variant.hysteresis, fit.variant.effects
    return attempt(
        lambda: assess(setting, effect, setting.fit(core, effects, samples=SEARCH_SAMPLES)), effect
    )


def _outcome_as_it_stands(setting: Setting, outcome: Outcome) -> Outcome:
    """Refit an outcome as :func:`_as_it_stands` does, on the whole comb."""
    assert outcome.fit is not None
    variant = outcome.fit.variant
    whole = replace(variant, hysteresis=on_comb(variant.hysteresis, setting.train))
    return _as_it_stands(setting, replace(outcome.fit, variant=whole), outcome.effect)


def _bounds_hit(ranked: Ranked) -> int:
    return len(own_bounds(ranked.outcome))


def _lags(ranked: Ranked, alike: Sequence[str]) -> Ranked:
    """Return a candidate that records of one rate cannot tell from others that lag."""
    candidate = of_class(ranked.candidate, alike)
    remark = template("one class")
    return replace(ranked, candidate=replace(candidate, remarks=(*candidate.remarks, remark)))


def of_class(candidate: Candidate, alike: Sequence[str]) -> Candidate:
    """Return a candidate as a member of a class, and no surer than one can be."""
    names = dict.fromkeys((*candidate.indistinguishable, *alike))
    return replace(
        candidate,
        indistinguishable=tuple(name for name in names if name != candidate.effect),
        confidence=min(candidate.confidence, _ONE_CLASS),
    )


MOST_UNSEEN = 0.5
"""Largest confidence in an effect that no test without a model can see in the records."""


def capped(
    candidate: Candidate, measured: Sequence[Check], catalogue: Mapping[str, type[Effect]]
) -> Candidate:
    """Return a candidate no surer than it can be where no test without a model can see its effect.

    Notes
    -----
    A fit names an effect from its trace among everything else. Where each test that could show
    that trace by itself says ``cannot tell``, or that the command does not hold what would show
    it, a wrong form of something else may leave the same trace.
    """
    said = {check.name: check for check in measured}
    kind = catalogue.get(candidate.effect)
    tests = [said[name] for name in (kind.seen_by if kind else ()) if name in said]
    if not tests or candidate.confidence <= MOST_UNSEEN or any(map(_sees, tests)):
        return candidate
    remark = template("unseen", effect=candidate.effect, reason=tests[0].found)
    return replace(candidate, confidence=MOST_UNSEEN, remarks=(*candidate.remarks, remark))


def _sees(check: Check) -> bool:
    """Whether a test tells an effect's presence or absence.

    A test of the commands says yes where something is missing.
    """
    return check.zone == "no" or (check.zone == "yes" and bool(check.suggests))


def hear(
    dataset: Dataset,
    measured: Sequence[Check],
    variant: Variant[Core],
    effect: str,
    noise_um: float,
    seed: int,
) -> str | None:
    """Compare the tests on the measurement with the same tests on the model with the effect.

    Notes
    -----
    A threshold alone would veto an effect that is there and small. So the model with the effect
    goes through the same tests: only where they say yes to what the fit claims, and no to what was
    measured, do they contradict the fit.
    """
    said = {check.name: check for check in measured}
    rng = np.random.default_rng(seed)
    records = []
    for record in dataset.records:
        if record.is_quiet:
            records.append(record)
            continue
        y = simulate_effects([variant], record)[:, 0]
        y += float(np.mean((record.y_um - y)[record.error_mask]))
        records.append(replace(record, y_um=y + noise_um * rng.standard_normal(y.size)))
    claimed = run_checks(replace(dataset, records=tuple(records)))
    own = [c for c in claimed if c.zone == "yes" and c.suggests[:1] == (effect,)]
    denied = [c for c in own if said[c.name].zone == "no"]
    agreed = [c for c in own if said[c.name].zone == "yes"]
    if not denied or agreed:
        return None
    return template("vetoed", effect=effect, reason=said[denied[0].name].found)
