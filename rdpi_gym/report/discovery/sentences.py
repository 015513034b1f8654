"""The result of a search in words, for the page and for the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rdpi_gym.diagnosis.results import Candidate, Errors, SearchResult

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


def staircase(result: SearchResult) -> list[tuple[str, Errors]]:
    """List the models in order, each with its errors: as given, base, and with what was found."""
    stairs = [] if result.given is None else [(AS_GIVEN, result.given)]
    stairs.append(("base model, refitted", result.base))
    for step in result.steps:
        stairs.append((" ".join(f"+ {effect}" for effect in step.effects), step.errors))
    return stairs


def verdict_sentence(result: SearchResult) -> str:
    """State the verdict with the errors that it stands on."""
    base = micrometres(result.base.validation_rmse_um)
    floor = f"the noise floor is {micrometres(result.noise_floor_um)}"
    head = f"{VERDICTS[result.verdict]}: "
    names = [candidate.effect for candidate in result.added]
    if result.verdict == "no missing effect":
        return (
            f"{head}the model without further effects leaves {base} on the validation records, "
            f"{floor}, and no candidate earns its place."
        )
    left = f"{micrometres(result.unexplained_rmse_um)} rms over the noise floor"
    if not names:
        why = "no candidate earns its place" if result.candidates else "no candidate was tried"
        return f"{head}{left} is left on the validation records, and {why}."
    verb = "would bring" if result.kind == "diagnosis" else f"bring{'s'[: len(names) < 2]}"
    after = micrometres(staircase(result)[-1][1].validation_rmse_um)
    moved = f"adding {joined(names)} {verb} the validation error from {base} to {after}"
    if result.verdict == "explained":
        return f"{head}{moved}; {floor}."
    return f"{head}{moved}, yet {left} is left."


def candidate_sentence(candidate: Candidate) -> str:
    """State one effect with its confidence, its rivals, its evidence and its reservations."""
    text = f"{candidate.effect}, confidence {100 * candidate.confidence:.0f} %"
    text = closed(f"{text}: {candidate.evidence}" if candidate.evidence else text)
    if candidate.indistinguishable:
        text += f" These data cannot tell it from {joined(candidate.indistinguishable)}."
    if candidate.remarks:
        text += closed(f" But: {'; '.join(candidate.remarks)}")
    return text


def confounded_sentence(result: SearchResult) -> str:
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
