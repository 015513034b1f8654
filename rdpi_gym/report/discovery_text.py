"""The result of a search in words, for the page and for the terminal."""

from __future__ import annotations

from rdpi_gym.diagnosis.probability import Probabilities
from rdpi_gym.diagnosis.results import Candidate, Errors, SearchResult
from rdpi_gym.measurement.quantities import in_output
from rdpi_gym.support.words import closed, joined

AS_GIVEN = "model as given"
"""Name of the model that a search started from, in the list of models."""
# Probability from which on it is said that something outside the catalogue may be missing, or nothing.
_WORTH_SAYING = 0.05


def staircase(result: SearchResult) -> list[tuple[str, Errors]]:
    """List the models in order, each with its errors: as given, base, and with what was found."""
    stairs = [] if result.given is None else [(AS_GIVEN, result.given)]
    stairs.append(("base model, refitted", result.base))
    for step in result.steps:
        stairs.append((" ".join(f"+ {effect}" for effect in step.effects), step.errors))
    return stairs


def candidate_sentence(candidate: Candidate, chances: Probabilities | None = None) -> str:
    """State how sure an effect is, its rivals, what speaks for it and what speaks against it."""
    form = f", {candidate.form}" if candidate.form else ""
    sure = f"{candidate.effect}{form}: {_how_sure(candidate, chances)}"
    if candidate.without_um is not None:
        sure += f"; without it, with all else refitted, {in_output(candidate.without_um)}"
    if candidate.indistinguishable:
        sure += f", indistinguishable from {joined(candidate.indistinguishable)} on these records"
    text = closed(sure)
    if candidate.evidence:
        text += f" {closed(candidate.evidence)}"
    if candidate.remarks:
        text += closed(f" But: {'; '.join(candidate.remarks)}")
    return text


def _how_sure(candidate: Candidate, chances: Probabilities | None) -> str:
    wins = f"{100 * candidate.confidence:.0f} %"
    if chances is None or candidate.effect not in chances.effects:
        return f"confidence {wins}"
    own = chances.effects[candidate.effect]
    said = f"{100 * own:.0f} % probable"
    of_class = max(chances.classes[candidate.effect], own)
    if candidate.indistinguishable:
        said += f", {100 * of_class:.0f} % that it or an indistinguishable one is there"
    return f"{said} (best in {wins} of the ways to split the records)"


def chances_sentence(result: SearchResult) -> str:
    """State further probable effects; empty where no probabilities are known."""
    chances = result.probabilities
    if chances is None:
        return ""
    added = {candidate.effect for candidate in result.added}
    said = [f"{n} {_percent(chances.effects[n])}" for n in chances.probable if n not in added]
    if chances.other >= _WORTH_SAYING:
        said.append(f"something outside the catalogue {_percent(chances.other)}")
    sentences = [f"May be missing{' besides' if added else ''}: {joined(said)}"] if said else []
    if not added and chances.none >= _WORTH_SAYING:
        sentences.append(f"That nothing is missing is {_percent(chances.none)} probable")
    return ". ".join(sentences)


def _percent(chance: float) -> str:
    return f"{100 * chance:.0f} %"


def lines(result: SearchResult) -> list[str]:
    """Return the result in lines: answer, confidence, residual, next experiment."""
    next_experiment = result.next_experiment and f"Next experiment: {result.next_experiment}"
    undecided = result.undecided is not None
    said = [
        result.headline,
        *(f"- {candidate_sentence(c, result.probabilities)}" for c in result.added),
        chances_sentence(result),
        result.core.sentence,
        result.sampling,
        "" if undecided else result.remainder,
        *(() if result.portrait is None else (f"- {s}" for s in result.portrait.sentences)),
        confounded_sentence(result),
        *(finding.sentence for finding in result.findings),
        *(f"Cannot be told: {sentence}" for sentence in result.limits),
        next_experiment,
    ]
    return [closed(result.quantities.fill(sentence)) for sentence in said if sentence]


def confounded_sentence(result: SearchResult) -> str:
    """Name the effects that are indistinguishable on these records; empty where there are none."""
    classes = "; ".join(joined(names) for names in result.indistinguishable)
    return f"Indistinguishable on these records: {classes}." if classes else ""
