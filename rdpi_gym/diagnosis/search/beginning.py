"""How a search begins: the core of hysteresis and the base model, and another core where it ends nowhere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rdpi_gym.diagnosis.results import CoreChoice
from rdpi_gym.diagnosis.search.base_models import begun
from rdpi_gym.diagnosis.search.bench import Bench, State
from rdpi_gym.diagnosis.search.candidates import assess
from rdpi_gym.diagnosis.search.core_choice import (
    AUTO,
    Fitted,
    choose,
    fit_kinds,
    instead,
    simpler,
    turning,
)
from rdpi_gym.diagnosis.search.ranking import AT_FLOOR
from rdpi_gym.diagnosis.search.separability import RATE, separability, typical_effects
from rdpi_gym.identification.kinds import orientation
from rdpi_gym.plant import CORES, RDPI, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import joined

# Noise floors from which on much is left, and what the first steps of another core have to leave of
# the error of the records to fit: there, and where less is left.
_NOWHERE, _HOPEFUL, _NO_WORSE = 2.0, 0.7, 1.0
# It takes the place of RDPI where it leaves so few noise floors and so much less, or far less.
_NEAR, _BESIDES, _FAR = 1.5, 0.6, 0.1
# Where all rates are alike, an effect at this cosine to that of δ2 is indistinguishable from it.
_LIKE_RATE = 0.9


class Beginning(Bench):
    """A search with its core and its base model."""

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
        ways = fit_kinds(self.setting, [RDPI, *turning(clockwise)], self._progress, say=self.say)
        if asked is None or not ways:  # RDPI as long as no other kind is clearly better
            own = next((way.outcome for way in ways if way.kind is RDPI), None)
            if not ways or (own is not None and not instead(ways, own, self._seed)):
                return CoreChoice(RDPI.name, clockwise=clockwise)
        return choose(self.setting, ways, clockwise, self._seed)

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
        much = left > _NOWHERE**2 * variance and not self.at_floor(state)
        least_um = (_HOPEFUL if much else _NO_WORSE) * state.outcome.errors.train_rmse_um
        # a kind of very many numbers is none of no more, and slow beside some effects
        kinds = [k for k in turning(self.core.clockwise) if much or not k.loose]

        def better(ways: Sequence[Fitted]) -> list[Fitted]:
            if much and instead(ways, state.outcome, self._seed):
                return list(ways)
            return simpler(ways, Fitted(RDPI, state.outcome), self.noise_um, self._seed)

        ways = better(fit_kinds(self.setting, kinds, self._progress, (), least_um, self.say))
        if state.effects and not ways:
            # effects that stand in for the core are none beside it, but others may be
            beside = fit_kinds(
                self.setting, kinds, self._progress, state.effects, least_um, self.say
            )
            ways = better(beside)
        if not ways:
            return None
        every = [*ways, Fitted(RDPI, state.outcome)] if much else ways
        return choose(self.setting, every, self.core.clockwise, self._seed)

    def gives_way(self, state: State, other: State) -> bool:
        """Whether a model of another core is at the noise, or so much better that it takes the place of one.

        Many gains make up for an effect that was not found: to be better is not enough.
        """
        left, its = state.outcome.mean_square, other.outcome.mean_square
        near = its <= _NEAR**2 * self.noise_um**2
        if its < _FAR * left or (near and its < _BESIDES * left):
            return True
        own, others = (Fitted(type(s.hysteresis), s.outcome) for s in (state, other))
        return near and bool(simpler([others], own, self.noise_um, self._seed))

    def left_by(self, core: CoreChoice, state: State, other: State) -> str:
        """Say what a search with another core left, which did not take the place of this one."""
        own_um, its_um = (s.outcome.errors.validation_rmse_um for s in (state, other))
        return (
            f"the core {core.kind} with its own effects leaves {its_um:.4g} {{output_unit}} held out, {RDPI.name} "
            f"{own_um:.4g} {{output_unit}}: --core {core.kind} shows it"
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
        fit = self.setting.fit(begun(self.setting, kind, present), present)
        state = State(assess(self.setting, "", fit))
        self._update_noise(state)
        state = self.past_outliers(self.past_openings(state))
        state = self._smoothed(state)
        if self._rates_alike:
            bare = typical_effects(self.catalogue, self.setting.scale)
            found = separability(self.setting.train, state.hysteresis, (), bare)
            self._like_rate = found.alike(RATE, _LIKE_RATE)
        self._progress("base model", 1, 1)
        self._seen(state.outcome)
        return state
