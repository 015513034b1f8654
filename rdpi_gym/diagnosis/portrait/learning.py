"""Free blocks refitted together with the hysteresis, each judged on held-out records."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from rdpi_gym.diagnosis.search.candidates import Outcome, Setting, assess, attempt
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, forms_of, in_chain_order
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.support.progress import Progress

# Passes and samples in which every start shows which are worth the rest: two of many where they are as near as this.
_FIRST_PASSES, _FIRST_SAMPLES, _MANY, _AS_NEAR = 4, 4_000, 3, 1.1
_PASSES, SAMPLES = 20, 10_000
# A memory that is shorter than so many samples is none.
_LEAST_SAMPLES = 2.0
# Times the least squared error, on the records held out, that a memory may leave to be worth a second.
_NEAR = 2.0


def learn(
    setting: Setting,
    hysteresis: Core,
    present: Sequence[Effect],
    starts: Sequence[Effect],
    held: frozenset[str] = frozenset(),
) -> Outcome:
    """Refit a block with the hysteresis and all effects, from the best of some starts."""
    fields = [in_chain_order([*present, start]) for start in starts]
    begun = [(hysteresis, effects) for effects in fields]
    if len(fields) > 1:
        first = [
            fit_joint(
                setting.train, hysteresis, effects, _FIRST_PASSES, held=held,
                samples=_FIRST_SAMPLES, smoothness=setting.smoothness,
            )
            for effects in fields
        ]  # fmt: skip
        best = sorted(first, key=lambda fit: fit.train_rmse_um)[: 2 if len(first) >= _MANY else 1]
        near = _AS_NEAR * best[0].train_rmse_um
        begun = [
            (fit.variant.hysteresis, fit.variant.effects)
            for fit in best
            if fit.train_rmse_um <= near
        ]
    fits = [setting.fit(core, effects, _PASSES, held, SAMPLES) for core, effects in begun]
    return assess(setting, Unknown.name, min(fits, key=lambda fit: fit.train_rmse_um))


def learn_forms(
    setting: Setting,
    hysteresis: Core,
    present: Sequence[Effect],
    kind: type[Effect],
    progress: Progress,
) -> list[Outcome]:
    """Refit the forms of the block; those with two memories where one memory comes near the best.

    A form that does not converge has no fit. Forms whose memory came out shorter than the samples are left out: they are static ones that a
    compensator takes for what they are not.
    """
    kinds = forms_of(kind)
    found: dict[str, Outcome] = {}
    for done, form in enumerate(kinds):
        progress(f"forms of {form.name}", done, len(kinds))
        simpler = found.get(form.form.replace("two memories", "memory"))
        starts: Sequence[Effect] = form.starts(setting.scale)
        if simpler is not None:
            if simpler.fit is None or simpler.mean_square > _NEAR * min(
                o.mean_square for o in found.values()
            ):
                continue
            starts = form.from_simpler(simpler.fitted, setting.scale)
        make = partial(learn, setting, hysteresis, present, starts)
        found[form.form] = attempt(make, form.name, form.form)
    progress(f"forms of {kind.name}", len(kinds), len(kinds))
    return [
        outcome
        for outcome in found.values()
        if outcome.fit is None or are_shown(outcome.fitted, setting.scale)
    ]


def are_shown(block: Effect, scale: DataScale) -> bool:
    """Whether the samples show all memories that a block has."""
    taus = (v for name, v in block.values.items() if name.startswith("time_constant"))
    return all(tau >= _LEAST_SAMPLES * scale.shortest_s for tau in taus)
