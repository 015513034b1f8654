"""Sections of a page that show candidates and their parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import pandas as pd

from rdpi_gym.diagnosis.probability import Probabilities
from rdpi_gym.diagnosis.results import Candidate, SearchResult, Step
from rdpi_gym.measurement.quantities import in_output, template_of, unit_template
from rdpi_gym.plant.effects import Effect, Parameter, forms_of
from rdpi_gym.report.discovery_charts import ranking
from rdpi_gym.report.page import Section
from rdpi_gym.support.words import closed, joined


def candidate_sections(result: SearchResult) -> list[Section]:
    """Show the candidates of each round, best first; none where no candidate was tried."""
    rounds = tuple(candidates for candidates in result.rounds if candidates)
    if not rounds:
        return []
    figures, tables = {}, []
    without, present = result.base, list[str]()
    for number, candidates in enumerate(rounds, start=1):
        taken = _taken(result, candidates, present)
        name = f"Round {number}: added to {joined(present)}" if present else "Round 1"
        figures[name] = ranking(candidates, result.noise_floor_um, without, taken)
        tables.append(_candidate_table(candidates, number, result.probabilities))
        present += taken
        reached = [*result.steps, *(Step((c,)) for c in candidates)]
        without = next((s.errors for s in reached if list(s.effects) == taken), without)
    table = pd.concat(tables, ignore_index=True)
    if len(rounds) == 1:
        table = table.drop(columns="Round")
    best = rounds[0][0]
    least = in_output(best.errors.validation_rmse_um)
    seen = (
        f"The smallest validation error of the first round is {least}, with {best.effect}. Each "
        "candidate was refitted together with the rest of the model."
        if len(rounds[0]) > 1
        else f"The validation error is {least} with {best.effect}, refitted together with the rest of "
        "the model."
    )
    return [
        Section(
            "The candidates",
            f"{seen} Dark blue: chosen. Light blue: indistinguishable from it on these records. "
            "An exclamation mark refers to a remark in the table, an arrow to an error beyond the axis.",
            figures if len(figures) > 1 else next(iter(figures.values())),
            table,
        ),
        *_evidence(result),
    ]


def _evidence(result: SearchResult) -> list[Section]:
    """Say what speaks for each candidate of a diagnosis; a discovery says it of what it added."""
    if result.kind != "diagnosis":
        return []
    said = [c for c in result.candidates if c.evidence and c.share > 0]
    if not said:
        return []
    lines = "\n".join(f"- {c.effect}: {closed(c.evidence)}" for c in said)
    text = (
        "For each candidate that lowers the validation error: what the refit changed, and what to "
        f"look for in the figures below.\n\n{lines}"
    )
    return [Section("Evidence for each candidate", text)]


def _taken(
    result: SearchResult, candidates: Sequence[Candidate], present: Sequence[str]
) -> list[str]:
    """Name the candidates that were taken in a round, also those taken out again later."""
    groups = [list(step.effects) for step in result.steps]
    following = next((group for group in groups if group[0] not in present), [])
    for candidate in candidates:
        if candidate.effect in following:
            return following
        if candidate.effect in result.removed and candidate.effect not in present:
            return [candidate.effect]
    return []


def _candidate_table(
    candidates: Sequence[Candidate], number: int, chances: Probabilities | None
) -> pd.DataFrame:
    table = pd.DataFrame(
        [
            {
                "Round": number,
                "effect": c.effect,
                "validation_rmse_um": _known(c.errors.validation_rmse_um),
                "train_rmse_um": _known(c.errors.train_rmse_um),
                "Share of the excess gone (%)": _known(100.0 * c.share),
                "Confidence (%)": 100.0 * c.confidence,
                "Indistinguishable from": ", ".join(c.indistinguishable),
                "remarks": "; ".join(c.remarks),
            }
            for c in candidates
        ]
    )
    if chances is not None:  # they are of the whole search, and known in every round
        said = [100.0 * chances.effects.get(c.effect, math.nan) for c in candidates]
        table.insert(list(table).index("Confidence (%)"), "Probability (%)", said)
    return table


def _known(value: float) -> float:
    """Return a number, or NaN where a refit without end left infinity."""
    return value if math.isfinite(value) else math.nan


def parameter_sections(
    result: SearchResult, catalogue: Mapping[str, type[Effect]]
) -> list[Section]:
    """List the parameters of what was added, or of every candidate of a diagnosis."""
    if result.kind == "diagnosis":
        listed, final = result.candidates, {}
    else:
        listed, final = result.added, {e.name: e.values for e in result.plant.effects}
    rows = [
        _parameter_row(candidate, name, catalogue, final)
        for candidate in listed
        for name in candidate.parameters
    ]
    if not rows:
        return []
    table = pd.DataFrame(rows)
    if not final:
        table = table.drop(columns="In the final model")
    return [
        Section(
            "Parameters",
            "Values with their standard errors. A fitted value without one is not determined by the "
            "data, and a value at a physical bound is not a measurement of it.",
            table=table,
        )
    ]


def _parameter_row(
    candidate: Candidate,
    name: str,
    catalogue: Mapping[str, type[Effect]],
    final: Mapping[str, Mapping[str, float]],
) -> dict[str, object]:
    kind = catalogue.get(candidate.effect)
    forms = forms_of(kind) if kind is not None else ()
    stated = {p.name: p for form in forms if form.form == candidate.form for p in form.parameters}
    parameter = stated.get(name)
    return {
        "effect": candidate.effect,
        "parameter": name,
        "value": candidate.parameters[name],
        "Standard error": candidate.standard_errors.get(name),
        "In the final model": final.get(candidate.effect, {}).get(name),
        "unit": "" if parameter is None or parameter.unit == "1" else unit_template(parameter.unit),
        "bounds": "" if parameter is None else _bounds(parameter),
        "meaning": "" if parameter is None else template_of(parameter.meaning),
    }


def _bounds(parameter: Parameter) -> str:
    if parameter.fixed:
        return "chosen, not fitted"
    return f"{parameter.low:g} to {parameter.high:g}".replace("-", "\N{MINUS SIGN}")
