"""Forms before names: each candidate in its best form, and better forms of what is there already."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

from rdpi_gym.diagnosis.search.candidates import Outcome, Setting, Trial, refit
from rdpi_gym.diagnosis.search.ranking import LEAST_GAIN, not_missed
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, forms_of, in_chain_order

# A form of more freedom takes at least this share of what the simpler one leaves over the noise,
# and so much again for each parameter more.
_PRICE, _PRICE_EACH = 0.10, 0.03
# The same for a form of no more freedom.
_AS_FREE = 0.02
# Of that price, what it has to be worth on the records to fit too.
_TRAINS = 0.3
# Candidates of a round that are tried in their further forms.
_LEADERS = 4
# Of the error without it, what the simplest form leaves at most to be worth another.
_SHOWS = 0.995


def further_forms(
    current: Outcome,
    simple: Sequence[Outcome],
    kinds: Mapping[str, type[Effect]],
    present: tuple[Effect, ...],
    scale: DataScale,
    suspects: Collection[str] = (),
) -> list[Trial]:
    """Return the further forms of the leading candidates as trials."""
    shown = [o.effect for o in simple if o.fit and o.mean_square < _SHOWS**2 * current.mean_square]
    # what the best of them is mistaken for may be better in another form
    kin = [name for first in shown[:1] for name in kinds[first].mistaken_for]
    others = (n for n in (*kin, *suspects) if n in kinds)
    names = dict.fromkeys((*shown[:_LEADERS], *others))
    fitted = {o.effect: o for o in simple}
    return [
        Trial(form, present, _starts(form, fitted.get(name), scale))
        for name in names
        for form in forms_of(kinds[name])[1:]
    ]


def _starts(
    form: type[Effect], simple: Outcome | None, scale: DataScale
) -> tuple[Effect, ...] | None:
    if simple is None or simple.fit is None:
        return None
    own = next(e for e in simple.fit.variant.effects if e.name == simple.effect)
    return _distinct((*form.from_simpler(own, scale), *form.starts(scale)))


def _distinct(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    return tuple(dict.fromkeys(effects))


def better_forms(present: tuple[Effect, ...], scale: DataScale) -> list[Trial]:
    """Return every further form of the effects that are there, each begun from the present one."""
    trials = []
    for effect in present:
        others = tuple(e for e in present if e is not effect)
        forms = forms_of(type(effect))
        further = forms[[f.form for f in forms].index(effect.form) + 1 :]
        trials += [
            Trial(form, others, _distinct((*form.from_simpler(effect, scale), *form.starts(scale))))
            for form in further
        ]
    return trials


def in_best_form(outcomes: Sequence[Outcome], noise_um: float) -> list[Outcome]:
    """Return one refit for each name: the form whose held-out error pays for its freedom."""
    by_name: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        by_name.setdefault(outcome.effect, []).append(outcome)
    best = [_worth_its_freedom(forms, noise_um) for forms in by_name.values()]
    return sorted(best, key=lambda o: o.mean_square)


def _worth_its_freedom(forms: Sequence[Outcome], noise_um: float) -> Outcome:
    variance = noise_um**2
    ordered = sorted(forms, key=_freedom)
    best = ordered[0]
    for outcome in ordered[1:]:
        if outcome.fit is None:
            continue
        more = _freedom(outcome) - _freedom(best)
        left = max(best.mean_square - variance, 0.0)
        share = _PRICE + _PRICE_EACH * more if more > 0 else _AS_FREE
        price = max(LEAST_GAIN * variance, share * left)
        before, after = (o.errors.train_rmse_um**2 for o in (best, outcome))
        least = _TRAINS if more > 0 else -_TRAINS
        trains = before - after > least * price * max(before - variance, 0.0) / max(left, 1e-300)
        if best.fit is None or (trains and best.mean_square - outcome.mean_square > price):
            best = outcome
    return best


def _freedom(outcome: Outcome) -> int:
    if outcome.fit is None:
        return 0
    effects = (e for e in outcome.fit.variant.effects if e.name == outcome.effect)
    return sum(not p.fixed for effect in effects for p in effect.parameters)


def simplified(
    setting: Setting,
    outcome: Outcome,
    hysteresis: Core,
    noise_um: float,
    report: Callable[[int, int], None],
) -> tuple[Outcome, dict[str, str]]:
    """Try simpler forms back, now that all other effects are there."""
    assert outcome.fit is not None
    given_up: dict[str, str] = {}
    rich = [effect for effect in outcome.fit.variant.effects if effect.form]
    for done, effect in enumerate(rich):
        report(done, len(rich))
        forms = forms_of(type(effect))
        for form in forms[: [f.form for f in forms].index(effect.form)]:
            assert outcome.fit is not None
            others = in_chain_order(e for e in outcome.fit.variant.effects if e.name != effect.name)
            simpler = refit(setting, hysteresis, others, form)
            loss = simpler.mean_square - outcome.mean_square
            if simpler.fit is not None and loss < not_missed(noise_um):
                outcome, given_up[effect.name] = simpler, effect.form
                break
    return outcome, given_up
