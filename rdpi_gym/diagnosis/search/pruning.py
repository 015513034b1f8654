"""After the rounds: what was added is taken out, simplified, and tried against its rivals once more."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from rdpi_gym.diagnosis.results import Candidate
from rdpi_gym.diagnosis.search.bench import State
from rdpi_gym.diagnosis.search.candidates import refit
from rdpi_gym.diagnosis.search.forms import better_forms, in_best_form, simplified
from rdpi_gym.diagnosis.search.openings import leaving_out, misleading, missed, unknown_past
from rdpi_gym.diagnosis.search.ranking import AT_FLOOR, SETTLED_GAIN, not_missed, own_bounds, rank
from rdpi_gym.diagnosis.search.rounds import Rounds
from rdpi_gym.plant.effects.base import Effect, forms_of, in_chain_order


class Pruning(Rounds):
    """A search that gives up what is not needed."""

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
        tried = [refit(whole, state.hysteresis, state.effects, k) for k in forms_of(kind)]
        ranked = rank(now, in_best_form(tried, self.noise_um), [kind], self.noise_um, self._seed)
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
                self._seed, SETTLED_GAIN,
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
