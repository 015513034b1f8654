"""A diagnosis or a discovery in words, for the page and for the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby

from rdpi_gym.diagnosis.results import Diagnosis, Discovery, Errors, Finding

VERDICTS = {
    "explained": "Explained",
    "no missing effect": "No missing effect",
    "unexplained": "Unexplained",
}

AS_GIVEN = "model as given"
"""Name of the model that a search started from, in the list of models."""


def joined(names: Sequence[str]) -> str:
    """Write a list of names in words.

    Examples
    --------
    >>> joined(["creep"]), joined(["creep", "delay", "resonance"])
    ('creep', 'creep, delay and resonance')
    """
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def micrometres(value: float) -> str:
    """Write an error with three digits and its unit.

    Examples
    --------
    >>> micrometres(0.012345), micrometres(float("inf"))
    ('0.0123 µm', 'no finite error')
    """
    return f"{value:.3g} µm" if math.isfinite(value) else "no finite error"


def found(result: Diagnosis | Discovery) -> tuple[Finding, ...]:
    """Return what was added, or what a diagnosis would add."""
    return result.steps if isinstance(result, Discovery) else result.chosen


def stages(result: Diagnosis | Discovery) -> list[tuple[Finding, ...]]:
    """Group what was found by what was added at once: two of a pair have the same errors."""
    return [tuple(group) for _, group in groupby(found(result), key=lambda step: step.errors)]


def staircase(result: Diagnosis | Discovery) -> list[tuple[str, Errors]]:
    """List the models in order, each with its errors: as given, base, and with what was found."""
    stairs = [] if result.given is None else [(AS_GIVEN, result.given)]
    stairs.append(("base model, refitted", result.base))
    for stage in stages(result):
        stairs.append((" ".join(f"+ {step.effect}" for step in stage), stage[0].errors))
    return stairs


def verdict_sentence(result: Diagnosis | Discovery) -> str:
    """State the verdict with the errors that it stands on."""
    base = micrometres(result.base.validation_rmse_um)
    floor = f"the noise floor is {micrometres(result.noise_floor_um)}"
    head = f"{VERDICTS[result.verdict]}: "
    names = [finding.effect for finding in found(result)]
    if result.verdict == "no missing effect":
        return (
            f"{head}the model without further effects leaves {base} on the validation records, "
            f"{floor}, and no candidate earns its place."
        )
    left = f"{micrometres(result.unexplained_rmse_um)} rms over the noise floor"
    if not names:
        tried = result.rounds if isinstance(result, Discovery) else result.candidates
        why = "no candidate earns its place" if tried else "no candidate was tried"
        return f"{head}{left} is left on the validation records, and {why}."
    verb = "would bring" if isinstance(result, Diagnosis) else f"bring{'s'[: len(names) < 2]}"
    after = micrometres(staircase(result)[-1][1].validation_rmse_um)
    moved = f"adding {joined(names)} {verb} the validation error from {base} to {after}"
    if result.verdict == "explained":
        return f"{head}{moved}; {floor}."
    return f"{head}{moved}, yet {left} is left."


def finding_sentence(finding: Finding) -> str:
    """State one effect with its confidence, its rivals, its evidence and its reservations."""
    text = f"{finding.effect}, confidence {100 * finding.confidence:.0f} %"
    text = closed(f"{text}: {finding.evidence}" if finding.evidence else text)
    if finding.indistinguishable:
        text += f" These data cannot tell it from {joined(finding.indistinguishable)}."
    if finding.remarks:
        text += closed(f" But: {'; '.join(finding.remarks)}")
    return text


def confounded_sentence(result: Diagnosis | Discovery) -> str:
    """Name the effects that the records cannot tell apart; empty where they can."""
    classes = "; ".join(joined(names) for names in result.indistinguishable)
    return f"These records cannot tell apart: {classes}." if classes else ""


def closed(sentence: str) -> str:
    """End a sentence with a full stop where it has none.

    Examples
    --------
    >>> closed("creep"), closed("Is it?")
    ('creep.', 'Is it?')
    """
    return sentence if sentence.rstrip().endswith((".", "!", "?")) else f"{sentence}."
