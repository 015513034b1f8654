"""The result of a search in words, for the page and for the terminal."""

from __future__ import annotations

from rdpi_gym.diagnosis.results import Candidate, Errors, SearchResult
from rdpi_gym.support.words import closed, joined, micrometres

AS_GIVEN = "model as given"
"""Name of the model that a search started from, in the list of models."""


def staircase(result: SearchResult) -> list[tuple[str, Errors]]:
    """List the models in order, each with its errors: as given, base, and with what was found."""
    stairs = [] if result.given is None else [(AS_GIVEN, result.given)]
    stairs.append(("base model, refitted", result.base))
    for step in result.steps:
        stairs.append((" ".join(f"+ {effect}" for effect in step.effects), step.errors))
    return stairs


def candidate_sentence(candidate: Candidate) -> str:
    """State how sure an effect is, its rivals, what speaks for it and what speaks against it."""
    form = f", {candidate.form}" if candidate.form else ""
    sure = f"{candidate.effect}{form}: confidence {100 * candidate.confidence:.0f} %"
    if candidate.without_um is not None:
        sure += f"; without it, with all else refitted, {micrometres(candidate.without_um)}"
    if candidate.indistinguishable:
        sure += f", indistinguishable from {joined(candidate.indistinguishable)} on these records"
    text = closed(sure)
    if candidate.evidence:
        text += f" {closed(candidate.evidence)}"
    if candidate.remarks:
        text += closed(f" But: {'; '.join(candidate.remarks)}")
    return text


def lines(result: SearchResult) -> list[str]:
    """Say the result: the answer, how sure it is, what is left, and what would tell more."""
    next_experiment = result.next_experiment and f"Next experiment: {result.next_experiment}"
    undecided = result.undecided is not None
    said = [
        result.headline,
        *(f"- {candidate_sentence(candidate)}" for candidate in result.added),
        result.sampling,
        "" if undecided else result.remainder,
        confounded_sentence(result),
        *(finding.sentence for finding in result.findings),
        *(f"Cannot be told: {sentence}" for sentence in result.limits),
        next_experiment,
    ]
    return [closed(sentence) for sentence in said if sentence]


def confounded_sentence(result: SearchResult) -> str:
    """Name the effects that are indistinguishable on these records; empty where there are none."""
    classes = "; ".join(joined(names) for names in result.indistinguishable)
    return f"Indistinguishable on these records: {classes}." if classes else ""
