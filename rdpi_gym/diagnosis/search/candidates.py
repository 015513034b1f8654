"""Candidates: an effect refitted together with everything else, and what that does to the error."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rdpi_gym.diagnosis.results import Errors
from rdpi_gym.diagnosis.search.checkpoint import Checkpoint
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import JointFit, fit_joint
from rdpi_gym.measurement import Record
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.effects.base import DataScale, Effect, in_chain_order
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.parallel import run_cases

# Pieces that a validation record is cut into: what the spread of an improvement is judged by.
PIECES = 8
# Samples in the squares of a search: a thousand for each number; the errors are of all samples.
SEARCH_SAMPLES = 24_000
# Passes in which every start of a candidate shows which optimum is worth the rest.
_FIRST_PASSES = 6
# Along a cusp: reach in the parameter's logarithm, sections, and passes for everything else.
_CUSP_REACH, _CUSP_STEPS, _CUSP_PASSES = 0.2, 16, 3
# Rounds along cusps of effects that are there already, ended by one that gains less than this.
_CUSP_ROUNDS, _CUSP_ENDS = 4, 0.9
# Passes at a start on the way to a cusp: everything else stands where it is already.
_SCAN_PASSES = 2
# Only where a start takes this much from the error without the effect is there a cusp to find.
_CUSP_SHOWS = 0.998


@dataclass(frozen=True)
class Outcome:
    """A refit and its squared errors.

    Parameters
    ----------
    effect
        Name of the candidate; empty for a refit without one.
    fit
        The refit; None where none converged.
    errors
        Of the refit.
    pieces : float64[R, PIECES]
        Mean squared error (µm²) of the pieces of each validation record, offset free.
    remark
        Why there is no refit.
    """

    effect: str
    fit: JointFit | None
    errors: Errors
    pieces: Array
    remark: str = ""

    @property
    def mean_square(self) -> float:
        """Mean squared validation error (µm²)."""
        return self.errors.validation_rmse_um**2


@dataclass(frozen=True)
class Setting:
    """What every refit of one data set shares.

    Parameters
    ----------
    train, validation
        Records to fit and to judge by.
    scale
        Size of the data.
    """

    train: tuple[Record, ...]
    validation: tuple[Record, ...]
    scale: DataScale


def assess(setting: Setting, name: str, fit: JointFit) -> Outcome:
    """Simulate a refit over all records.

    Parameters
    ----------
    setting
        The data.
    name
        Name of the candidate.
    fit
        The refit.
    """
    by_record: dict[str, float] = {}
    train, _ = _squares(fit.variant, setting.train, by_record)
    validation, pieces = _squares(fit.variant, setting.validation, by_record)
    spread = max(float(np.ptp(r.y_um[r.error_mask])) for r in setting.validation)
    relative = 100.0 * validation / spread if spread > 0.0 else math.inf
    errors = Errors(train, validation, relative, by_record)
    return Outcome(name, fit, errors, pieces)


def refit(
    setting: Setting, hysteresis: RDPI, present: Sequence[Effect], kind: type[Effect] | None
) -> Outcome:
    """Fit the weights, δ2, the effects present and a candidate together, from each of its starts.

    Parameters
    ----------
    setting
        The data.
    hysteresis
        Comb of thresholds with the weights to start from.
    present
        Effects added before, with their values.
    kind
        The candidate; None to refit without one.

    Returns
    -------
    Outcome
        Of the start with the smallest training error.
    """
    if kind is None:
        return assess(setting, "", fit_joint(setting.train, hysteresis, present))
    first: list[JointFit] = []
    troubles: list[str] = []
    held = frozenset() if kind.kinked is None else frozenset({f"{kind.name}.{kind.kinked}"})
    first_passes = _SCAN_PASSES if held else _FIRST_PASSES
    for start in kind.starts(setting.scale):
        effects = in_chain_order([*present, start])
        try:
            first.append(
                fit_joint(
                    setting.train,
                    hysteresis,
                    effects,
                    first_passes,
                    held=held,
                    samples=SEARCH_SAMPLES,
                )
            )
        except Exception as error:  # a user's effect may raise anything; the others go on
            troubles.append(f"{type(error).__name__}: {error}".splitlines()[0])
    first = [fit for fit in first if math.isfinite(fit.train_rmse_um)]
    if not first:
        nowhere = Errors(math.inf, math.inf, math.inf, {})
        reason = troubles[0] if troubles else "the error is not finite"
        return Outcome(
            kind.name, None, nowhere, np.zeros((0, PIECES)), f"did not converge: {reason}"
        )
    best = min(first, key=lambda fit: fit.train_rmse_um)
    if kind.kinked is not None:
        without = fit_joint(
            setting.train, hysteresis, present, _FIRST_PASSES, samples=SEARCH_SAMPLES
        ).train_rmse_um
        if best.train_rmse_um < _CUSP_SHOWS * without:
            best = _along_cusp(setting, best, kind.name, kind.kinked)
    if held or not best.converged:
        best = fit_joint(
            setting.train, best.variant.hysteresis, best.variant.effects, samples=SEARCH_SAMPLES
        )
    return assess(setting, kind.name, best)


def past_cusps(setting: Setting, outcome: Outcome, present: Sequence[Effect]) -> Outcome:
    """Move the effects that are there already along their cusps too, where no refit leads them.

    Parameters
    ----------
    setting
        The data.
    outcome
        A refit with `present`.
    present
        Effects added before.
    """
    kinked = [(e.name, e.kinked) for e in present if e.kinked is not None]
    if outcome.fit is None or not kinked:
        return outcome
    fit = outcome.fit
    for _ in range(_CUSP_ROUNDS):
        before = fit.train_rmse_um
        for name, parameter in kinked:
            fit = _along_cusp(setting, fit, name, parameter)
        fit = fit_joint(
            setting.train, fit.variant.hysteresis, fit.variant.effects, samples=SEARCH_SAMPLES
        )
        if fit.train_rmse_um > _CUSP_ENDS * before:
            break
    return assess(setting, outcome.effect, fit)


def _along_cusp(setting: Setting, fit: JointFit, effect: str, parameter: str) -> JointFit:
    """Search along one parameter, everything else refitted: no gradient leads into a cusp."""
    held = frozenset({f"{effect}.{parameter}"})
    best = fit

    def attempt(log_value: float) -> float:
        nonlocal best
        effects = [
            e.with_values({parameter: math.exp(log_value)}) if e.name == effect else e
            for e in best.variant.effects
        ]
        trial = fit_joint(
            setting.train, best.variant.hysteresis, effects, _CUSP_PASSES, held=held,
            samples=SEARCH_SAMPLES,
        )  # fmt: skip
        if trial.train_rmse_um < best.train_rmse_um:
            best = trial
        return trial.train_rmse_um

    here = {e.name: e for e in fit.variant.effects}[effect].values[parameter]
    low, high = math.log(here) - _CUSP_REACH, math.log(here) + _CUSP_REACH
    ratio = (math.sqrt(5.0) - 1.0) / 2.0
    left, right = high - ratio * (high - low), low + ratio * (high - low)
    at_left, at_right = attempt(left), attempt(right)
    for _ in range(_CUSP_STEPS):
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - ratio * (high - low)
            at_left = attempt(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + ratio * (high - low)
            at_right = attempt(right)
    return best


def _squares(
    variant: Variant, records: Sequence[Record], by_record: dict[str, float]
) -> tuple[float, Array]:
    total, samples, pieces = 0.0, 0, []
    for record in records:
        error = record.y_um - simulate_effects([variant], record)[:, 0]
        error = error[record.error_mask]
        squares = (error - error.mean()) ** 2
        label = record.name
        while label in by_record:  # the held-out part of a record that is also fitted
            label += " (held out)"
        by_record[label] = math.sqrt(float(squares.mean()))
        parts = np.array_split(squares, PIECES)  # empty ones where there are few samples
        pieces.append([(part if part.size else squares).mean() for part in parts])
        total += float(squares.sum())
        samples += len(squares)
    return math.sqrt(total / samples), np.array(pieces)


def refit_all(
    setting: Setting,
    hysteresis: RDPI,
    present: Sequence[Effect],
    kinds: Sequence[type[Effect]],
    checkpoint: Checkpoint,
    jobs: int,
    report: Callable[[int, int], None],
) -> list[Outcome]:
    """Refit every candidate, in parallel; best validation error first.

    Parameters
    ----------
    setting, hysteresis, present
        As :func:`refit`.
    kinds
        The candidates.
    checkpoint
        Where finished candidates are looked up and kept.
    jobs
        Processes.
    report
        Called with candidates done and in all.
    """
    outcomes: list[Outcome] = []
    open_kinds: list[type[Effect]] = []
    for kind in kinds:
        fit = checkpoint.get(hysteresis, present, kind)
        if fit is None:
            open_kinds.append(kind)
        else:
            outcomes.append(assess(setting, kind.name, fit))
    report(len(outcomes), len(kinds))
    by_name = {kind.name: kind for kind in open_kinds}
    for outcome in _run(setting, hysteresis, present, open_kinds, jobs):
        if outcome.fit is not None:
            checkpoint.put(hysteresis, present, by_name[outcome.effect], outcome.fit)
        outcomes.append(outcome)
        report(len(outcomes), len(kinds))
    return sorted(outcomes, key=lambda o: o.mean_square)


def _run(
    setting: Setting,
    hysteresis: RDPI,
    present: Sequence[Effect],
    kinds: Sequence[type[Effect]],
    jobs: int,
) -> Iterator[Outcome]:
    one = partial(_refit_kind, setting, hysteresis, present)
    yield from run_cases(one, kinds, 1 if len(kinds) < 2 else jobs)


def _refit_kind(
    setting: Setting, hysteresis: RDPI, present: Sequence[Effect], kind: type[Effect]
) -> Outcome:
    return refit(setting, hysteresis, present, kind)
