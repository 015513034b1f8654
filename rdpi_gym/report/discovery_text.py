"""The result of a search in words, for the page and for the terminal."""

from __future__ import annotations

import math

from rdpi_gym.diagnosis.notices import statement
from rdpi_gym.diagnosis.results import Candidate, Errors, Probabilities, SearchResult
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.measurement.quantities import in_output
from rdpi_gym.support.words import closed, joined

AS_GIVEN = "model as given"
"""Name of the model that a search started from, in the list of models."""
# Probability from which on it is said that something outside the catalogue may be missing, or nothing.
_WORTH_SAYING = 0.05
# Reasons that stand between an answer and its next experiment.
_REASONS = 2


def staircase(result: SearchResult) -> list[tuple[str, Errors]]:
    """List the models in order, each with its errors: as given, base, and with what was found."""
    stairs = [] if result.given is None else [(AS_GIVEN, result.given)]
    stairs.append(("base model, refitted", result.base))
    for step in result.steps:
        stairs.append((" ".join(f"+ {effect}" for effect in step.effects), step.errors))
    return stairs


def probability_phrase(candidate: Candidate, chances: Probabilities | None) -> str:
    """State an effect with the one number for its certainty, and the share that it removes."""
    known = {} if chances is None else chances.effects
    form = f", {candidate.form}" if candidate.form else ""
    own = known.get(candidate.effect)
    if candidate.grade == "stand-in":
        sure = "a stand-in"
    elif own is None:
        sure = f"confidence {_percent(candidate.confidence)}"
    else:
        sure = f"{_percent(own)} probable"
    text = f"{candidate.effect}{form}: {sure}"
    if math.isfinite(candidate.share) and candidate.share > 0.0:
        text += f", removes {_percent(candidate.share)} of the squared error above noise"
    return text


def candidate_sentence(
    candidate: Candidate, chances: Probabilities | None = None, beside_others: bool = True
) -> str:
    """State how sure an effect is, and the reasons: rivals, evidence, what speaks against it.

    Its error without it is that of the base model where it is not `beside_others`.
    """
    text = probability_phrase(candidate, chances)
    if candidate.without_um is not None and beside_others:
        text += f"; error without it, all else refitted, {in_output(candidate.without_um)}"
    if candidate.grade == "stand-in":
        text += "; a free block in its place leaves less, or it takes less than is left"
    if candidate.indistinguishable:
        text += f"; indistinguishable from {joined(candidate.indistinguishable)} on these records"
    text = closed(text)
    if candidate.evidence:
        text += f" {closed(candidate.evidence)}"
    if candidate.remarks:
        text += closed(f" But: {'; '.join(candidate.remarks)}")
    return text


def chances_sentence(result: SearchResult) -> str:
    """State further probable effects; empty where no probabilities are known."""
    chances = result.probabilities
    if chances is None:
        return ""
    added = {candidate.effect for candidate in result.added}
    said = [f"{n} {_percent(chances.effects[n])}" for n in chances.probable if n not in added]
    if chances.other >= _WORTH_SAYING:
        said.append(f"something outside the catalogue {_percent(chances.other)}")
    if not added and chances.none >= _WORTH_SAYING:
        said.append(f"nothing {_percent(chances.none)}")
    return (
        f"{'Further effects' if added else 'Missing'}, by probability: {joined(said)}"
        if said
        else ""
    )


def _percent(chance: float) -> str:
    return f"{100 * chance:.0f} %"


def lines(result: SearchResult) -> list[str]:
    """Return the result in lines: answer, reasons, residual, limits, next experiment."""
    several = len(result.added) > 1
    said = [
        result.headline,
        *(
            f"- {candidate_sentence(c, result.probabilities, several)}"
            for c in result.stated.values()
        ),
        chances_sentence(result),
        result.core.sentence,
        result.sampling,
        "" if result.undecided is not None else result.remainder,
        *(() if result.portrait is None else (f"- {s}" for s in result.portrait.sentences)),
        confounded_sentence(result),
        *(finding.sentence for finding in result.findings),
        *result.limits,
        _next_experiment(result),
    ]
    return [closed(result.quantities.fill(sentence)) for sentence in said if sentence]


def evidence(result: SearchResult) -> list[str]:
    """Return what supports the answer, in at most three sentences: effects, residual or limit, next step."""
    left = result.left if result.undecided is None else None
    reasons = [
        "; ".join(probability_phrase(c, result.probabilities) for c in result.stated.values()),
        ""
        if left is None or left.low <= 0.0
        else text_of(statement("left/low", low=100.0 * left.low)),
        chances_sentence(result),
        *result.limits,
    ]
    said = [*[reason for reason in reasons if reason][:_REASONS], _next_experiment(result)]
    return [closed(result.quantities.fill(sentence)) for sentence in said if sentence]


def _next_experiment(result: SearchResult) -> str:
    return f"Next experiment: {result.next_experiment}" if result.next_experiment else ""


def confounded_sentence(result: SearchResult) -> str:
    """Name the effects that are indistinguishable on these records; empty where there are none."""
    classes = "; ".join(joined(names) for names in result.indistinguishable)
    return f"Indistinguishable on these records: {classes}." if classes else ""
