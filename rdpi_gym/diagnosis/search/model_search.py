"""A search on one data set: rounds, pruning, confidence and probability of its result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from rdpi_gym.diagnosis.probability import LEAST_PROBABLE, Course, of_classes
from rdpi_gym.diagnosis.results import Candidate
from rdpi_gym.diagnosis.search.candidates import assess, of_effect, refit, refit_kinds
from rdpi_gym.diagnosis.search.plants import in_few_numbers
from rdpi_gym.diagnosis.search.ranking import (
    AT_FLOOR,
    LEAST_GAIN,
    LEAST_STABLE,
    SETTLED_GAIN,
    better_forms,
    in_best_form,
    not_missed,
    own_bounds,
    rank,
    simplified,
    stability,
)
from rdpi_gym.diagnosis.search.record_clocks import leaving_out, misleading, missed, unknown_past
from rdpi_gym.diagnosis.search.refitting import State
from rdpi_gym.diagnosis.search.rounds import Rounds, of_class
from rdpi_gym.diagnosis.words import template
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.effects.base import Effect, forms_of, in_chain_order


class Pruning(Rounds):
    """A search that gives up what is not needed."""

    def eliminate(self, state: State, added: Sequence[str]) -> tuple[State, tuple[str, ...]]:
        """Take out what is not missed when it is gone."""
        removed: list[str] = []
        for name in added if len(added) > 1 else ():
            self.progress("backward elimination", len(removed), len(added))
            without = self.without(state, [name])
            loss = without.outcome.mean_square - state.outcome.mean_square
            if loss < not_missed(self.noise_um):
                state, removed = without, [*removed, name]
        return state, tuple(removed)

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
        if now.fit is None:
            return state, []
        tried = refit_kinds(self._pool, whole, state.hysteresis, state.effects, forms_of(kind))
        ranked = rank(now, in_best_form(tried, self.noise_um), [kind], self.noise_um, self.seed)
        best = ranked[0]
        if best.outcome.fit is None or not best.earned:
            return state, []
        still = misleading(whole, best.outcome, self._openings, self.noise_um)
        self.setting = leaving_out(whole, still)
        outcome = refit(self.setting, state.hysteresis, best.outcome.fit.variant.effects, None)
        state = self._moved(State(best.outcome), outcome)
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
            for outcome in (
                self._refit(self._bare(state), trials, f"without {name}") if trials else []
            ):
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
            lambda done, total: self.progress("simpler forms", done, total),
        )  # fmt: skip
        notes = [template("simpler", effect=n, form=repr(form)) for n, form in given_up.items()]
        return State(outcome), tuple(notes)

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
            self.progress(f"rivals of {step.effect}", 0, len(kinds))
            outcomes = refit_kinds(self._pool, self.setting, state.hysteresis, others, kinds)
            instead = {
                o.effect: o.errors.validation_rmse_um
                for o in (*outcomes, replace(state.outcome, effect=step.effect))
                if math.isfinite(o.errors.validation_rmse_um)
            }
            # an effect is replaced only by one that fits the other records no worse either
            most = state.outcome.errors.train_rmse_um * (1.0 + SETTLED_GAIN)
            outcomes = [o for o in outcomes if o.errors.train_rmse_um <= most and not own_bounds(o)]
            own = replace(state.outcome, effect=step.effect, form=step.form)
            without = refit(self.setting, state.hysteresis, others, None)
            if without.fit is None:  # there is nothing to compare with
                settled.append(step)
                continue
            ranked = rank(
                without, [own, *outcomes], [*kinds, self.catalogue[step.effect]], self.noise_um,
                self.seed, SETTLED_GAIN,
            )  # fmt: skip
            best = ranked[0]
            if step.effect in (best.candidate.effect, *best.candidate.indistinguishable):
                best = next(r for r in ranked if r.candidate.effect == step.effect)
            else:
                state = State(best.outcome)
            chosen = best.candidate
            if chosen.effect == step.effect:
                chosen = replace(
                    chosen, errors=step.errors, share=step.share, evidence=step.evidence
                )
            others_um = {n: um for n, um in instead.items() if n != chosen.effect}
            settled.append(replace(chosen, instead=others_um))
        return state, settled


# Ratio of the mean squares without and with an effect from which on it is essential.
_ESSENTIAL_RATIO = 1.7
# Rivals of an effect in each split of the records.
_SPLIT_RIVALS = 2


class ModelSearch(Pruning):
    """One data set, from its beginning to its end.

    Arguments are those of :func:`rdpi_gym.diagnosis.search.discover.diagnose`.
    """

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
            self.setting, state.outcome, judged, self.dataset.holds_out_quarters, self.seed,
            lambda done, total: self.progress("splits of the records", done, total),
            self._pool,
        )  # fmt: skip
        known = [
            replace(c, confidence=found[c.effect].confidence, without_um=found[c.effect].without_um)
            for c in added
        ]
        return [of_class(c, self._like_rate) if c.effect in self._like_rate else c for c in known]

    def less_sure(self, state: State, added: Sequence[Candidate]) -> tuple[State, tuple[str, ...]]:
        """Take out what contributes nothing, and what splits of the records do not choose again.

        Effects whose removal raises the mean square more than 1.7-fold are kept.
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
            is_essential = (
                without.outcome.mean_square > _ESSENTIAL_RATIO * state.outcome.mean_square
            )
            if loss < least or (unstable and not is_essential):
                state, removed = without, [*removed, step.effect]
        return state, tuple(removed)

    def improbable(
        self, base: State, state: State, added: Sequence[Candidate], tried: Sequence[Candidate]
    ) -> tuple[State, tuple[str, ...], tuple[str, ...]]:
        """Take out what is less probable than not, with all that is indistinguishable from it.

        Effects whose removal raises the mean square more than 1.7-fold are kept. Returns the model, what
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
            if without.outcome.mean_square > _ESSENTIAL_RATIO * state.outcome.mean_square:
                needed.add(name)
                continue
            with_um, without_um = (s.outcome.errors.validation_rmse_um for s in (state, without))
            notes.append(
                template(
                    "improbable",
                    effect=name,
                    percent=100.0 * chances[least],
                    with_it=with_um,
                    without=without_um,
                )
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

    def final(self, state: State, step: Candidate) -> Candidate:
        """Return a step with the parameters of the final model."""
        return of_effect(step, state.fit, step.effect)

    def on_law(self, state: State, given: PlantModel[Any] | None) -> tuple[State, tuple[str, ...]]:
        """Return the model with a core of few numbers where that costs little, and remarks."""
        outcome, notes = in_few_numbers(
            self.setting, state.outcome, given, self.noise_um, self._pool
        )
        return State(outcome), (*self.orientation, *notes)

    def read_all(self, base: State, end: State) -> tuple[State, State]:
        """Return two models judged on all samples, as everything is from here on.

        The second is refitted, and the first too where a stretch alone was read of some record.
        """
        if self._thinned is None:
            return base, end
        self.progress("all samples", 0, 1)
        self._searched, recorded = self.setting, self._recorded
        self.dataset, self._openings = recorded.dataset, recorded.openings
        self._whole = setting = replace(self._stated, smoothness=self.setting.smoothness)
        self._spared = {name: self._openings[name] for name in self._spared}
        self.setting, self.findings = leaving_out(setting, self._spared), recorded.findings
        if self._spared:
            kept = (f for f in self.findings if f.kind != "in motion")
            self.findings = (*kept, unknown_past(self._spared))
        self._least, self._whitest = math.inf, None
        if self.reads_in_part:
            base = self.again(base)
            self.seen(base.outcome)
        else:
            base = State(assess(self.setting, "", base.fit))
            self._update_noise(base)
        end = self.past_outliers(self.again(end))
        self.progress("all samples", 1, 1)
        return base, end

    def final_noise(self, state: State) -> None:
        """Take the noise's colour from the model that is saved."""
        self._least = math.inf
        self._update_noise(state)
