"""The pages of `rdpi diagnose`, `rdpi add` and `rdpi discover`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.comparison.traces import Trace, residual_profiles, view_trace
from rdpi_gym.diagnosis.results import Candidate, Probabilities, SearchResult, Step, View
from rdpi_gym.measurement.quantities import in_output, template_of, unit_template
from rdpi_gym.plant.effects import CATALOGUE, Effect, Parameter, forms_of
from rdpi_gym.report import discovery_charts as charts
from rdpi_gym.report.discovery_charts import ranking
from rdpi_gym.report.discovery_text import lines, staircase
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.traces import DISPLAY_SAMPLES, peak_um, rms_um, worst_first
from rdpi_gym.support.words import capital, closed, joined

_CERTAINTY = "Confidence (%)"
MOST_VIEWS = 24
"""Records whose traces stand on the page; of more, those with the largest errors."""
_ALL_SAMPLES = 8 * DISPLAY_SAMPLES


def view_sections(result: SearchResult) -> list[Section]:
    """Show the records over time, as loops, and what is left of them; none without views."""
    views = [view for view in result.views if view.models_um and np.any(view.counted)]
    if not views:
        return []
    floor = result.noise_floor_um
    # the held-out part of a record has the role beside its name
    every = {f"{view.name} ({view.role})": view for view in views}
    names = worst_first(every, lambda view: rms_um(_first_trace(view)), most=MOST_VIEWS)
    samples = max(600, min(DISPLAY_SAMPLES, _ALL_SAMPLES // len(names)))
    labels = list(views[0].models_um)
    pair = (
        f"Orange is the model “{labels[0]}”, blue is “{labels[-1]}”"
        if len(labels) > 1
        else f"Blue is the model “{labels[0]}”"
    )
    chosen = (
        f" The record that the model “{labels[0]}” fits worst comes first."
        if len(every) > 1
        else ""
    )
    if len(names) < len(every):
        chosen += f" Of {len(every)} records the {len(names)} with the largest errors are here."
    residuals = {}
    for name, view in names.items():
        traces = {label: view_trace(view, label) for label in view.models_um}
        residuals[name] = charts.residuals(
            {label: residual_profiles(trace) for label, trace in traces.items()},
            floor,
            next(iter(traces.values())).ts_s,
        )
    return [
        Section(
            "Measurement against model",
            f"{pair}. Below stands the error of each, measured minus model, with the noise floor as a "
            "band: the error of the last model should stay within about three times the band and show "
            f"no pattern. Click on the legend to show other models.{chosen}",
            {n: charts.view_over_time(v, floor, samples) for n, v in names.items()},
        ),
        Section(
            f"Where the model “{labels[0]}” was farthest off",
            "The half-cycle of its largest error, with the one before and the one after. What the "
            "added effects change is seen best here.",
            {
                n: charts.view_largest_error(v, floor, samples // 2)
                for n, v in worst_first(names, lambda view: peak_um(_first_trace(view))).items()
            },
        ),
        Section(
            "Loops",
            "On the left {output} over command, on the right measured minus model along the same "
            "loops. A shape that repeats there is physics that the model lacks.",
            {n: charts.view_loops(v, floor, samples) for n, v in names.items()},
        ),
        Section(
            "Where the remaining error is",
            "Mean error of each model over the command (solid: rising, dotted: falling), over its rate "
            "and, in a record with holds, over the time since the command last moved, positive in the "
            "direction of that move: creep climbs steadily there. In the spectrum, beside that of the "
            "noise (dashed), resonances and hum are peaks.",
            residuals,
        ),
    ]


def _first_trace(view: View) -> Trace:
    return view_trace(view, next(iter(view.models_um)))


_HOW = (
    "- Every model and every candidate is refitted as a whole, hysteresis included, to the training "
    "records. It is judged by its RMS error on the validation records, with one free offset in each.\n"
    "- The noise floor is the part of the error that no model can explain. A model whose error has "
    "reached it cannot be improved on these records.\n"
    "- The probability of an effect, of a discovery, is the weight of the sets that have it, of all sets "
    "that were refitted. Two effects can be there at once, so they do not add up to 100 %.\n"
    "- An effect is found from 90 % on and likely from 50 %. A stand-in lowers the error and is not the "
    "cause: a free block in its place leaves less, or it takes less than is left.\n"
    "- The confidence, of a diagnosis, is that in the effect or one that is indistinguishable from it on "
    "these records. Where such rivals are named, the next experiment decides between them.\n"
    "- The share is the part of the squared error above noise that an effect removes on the validation "
    "records. Where it is negative, the candidate makes them worse.\n"
    "- Unexplained means that a systematic error is left that no effect of the catalogue accounts "
    "for. The best candidate is then not its cause."
)


def write_discovery_page(
    path: Path | str,
    title: str,
    result: SearchResult,
    catalogue: Mapping[str, type[Effect]] = CATALOGUE,
) -> Path:
    """Write the result of a search as a self-contained page."""
    # what was added on request stands in no list
    asked = {c.effect: CATALOGUE[c.effect] for c in result.added if c.effect in CATALOGUE}
    sections = [
        _steps(result),
        *candidate_sections(result),
        *view_sections(result),
        *parameter_sections(result, {**asked, **catalogue}),
        _checks(result),
        _residual(result),
        *_portrait(result),
        Section("How to read this page", _HOW),
    ]
    return write_page(path, title, _summary(result), sections, result.quantities)


def _summary(result: SearchResult) -> str:
    points = groupby(lines(result), key=lambda line: line.startswith("- "))
    paragraphs = [("\n" if is_list else "\n\n").join(said) for is_list, said in points]
    origin = closed(capital(result.noise_origin)) if result.noise_origin else ""
    paragraphs.append(f"{origin} Computed in {result.seconds:.3g} s.")
    return "\n\n".join(paragraphs)


def _steps(result: SearchResult) -> Section:
    stairs = staircase(result)
    floor = result.noise_floor_um
    last = stairs[-1]
    times = last[1].validation_rmse_um / floor if floor > 0 else float("inf")
    names = joined([candidate.effect for candidate in result.added])
    text = (
        f"The RMS error on the validation records is {in_output(last[1].validation_rmse_um)} "
        f"{f'with {names}' if names else 'without further effects'}, "
        f"{times:.2f} times the noise floor."
    )
    if result.kind == "diagnosis" and result.steps:
        text += (
            " Nothing has been added to the model yet: this is the error that adding it would give."
        )
    table = pd.DataFrame(
        [
            {
                "model": name,
                "train_rmse_um": errors.train_rmse_um,
                "validation_rmse_um": errors.validation_rmse_um,
                "validation_nrmse_percent": errors.validation_nrmse_percent,
                "Times the noise floor": errors.validation_rmse_um / floor if floor > 0 else None,
            }
            for name, errors in stairs
        ]
    )
    shown = [view.name for view in result.views]
    roles = {view.name: view.role for view in result.views if shown.count(view.name) == 1}
    figures = [charts.staircase_figure(stairs, floor)]
    if any(errors.by_record_um for _, errors in stairs):
        text += (
            " The first figure shows the error of each model, the second the error of the first and "
            "of the last model on each record. An effect that is really there makes no record worse."
        )
        figures.append(charts.record_errors(stairs, roles, floor))
    return Section("The error, step by step", text, figures, table)


def _checks(result: SearchResult) -> Section:
    # a sentence may answer for several effects
    said = "\n".join(f"- {check}" for check in dict.fromkeys(result.checks))
    return Section(
        "Tests without a model",
        f"These tests use the measurement alone, before anything is fitted.\n\n{said}"
        if said
        else "No test applied to these data.",
    )


def _residual(result: SearchResult) -> Section:
    paragraphs = [
        f"{_above_noise(result)} % of the squared error of the final model is above noise.",
        result.remainder,
    ]
    if result.removed:
        paragraphs.append(
            f"Removed again, because the others explain as much without: {joined(result.removed)}."
        )
    paragraphs.append("\n".join(f"- {note}" for note in result.notes))
    if result.next_experiment:
        paragraphs.append(f"Next experiment: {result.next_experiment}")
    elif result.verdict == "explained":
        paragraphs.append("No further experiment is needed to distinguish the effects.")
    return Section("Residual and next experiment", "\n\n".join(filter(None, paragraphs)))


def _above_noise(result: SearchResult) -> int:
    error, floor = result.final.validation_rmse_um, result.noise_floor_um
    return round(100.0 * max(1.0 - (floor / error) ** 2, 0.0)) if error > 0.0 else 0


def _portrait(result: SearchResult) -> list[Section]:
    drawn = result.portrait
    if drawn is None:
        return []
    asked = [
        *((f"{place} the hysteresis", share) for place, share in drawn.places.items()),
        ("with a memory", drawn.memories),
        *(("of both parities" if p == "both" else p, share) for p, share in drawn.parities.items()),
    ]
    table = pd.DataFrame(
        [{"The best block is": what, "Share of draws (%)": 100.0 * share} for what, share in asked]
    )
    return [
        Section(
            "Portrait of the unknown effect",
            "A free block was refitted with the hysteresis, in every place of the chain, with and "
            "without memory, even and odd; what it says stands at the top. Shares are those of draws of "
            "pieces of the records in which a block of that kind is the best.",
            table=table,
        )
    ]


def candidate_sections(result: SearchResult) -> list[Section]:
    """Show the candidates of each step, best first; none where no candidate was tried."""
    rounds = tuple(candidates for candidates in result.stated_rounds if candidates)
    if not rounds:
        return []
    figures, tables = {}, []
    without, present = result.base, list[str]()
    for number, candidates in enumerate(rounds, start=1):
        taken = _chosen(result, candidates, present)
        name = f"Step {number}: added to {joined(present)}" if present else "Step 1"
        figures[name] = ranking(candidates, result.noise_floor_um, without, taken)
        tables.append(_candidate_table(candidates, number, result.probabilities))
        present += taken
        reached = [*result.steps, *(Step((c,)) for c in candidates)]
        without = next((s.errors for s in reached if list(s.effects) == taken), without)
    table = pd.concat(tables, ignore_index=True)
    if len(rounds) == 1:
        table = table.drop(columns="Step")
    best = rounds[0][0]
    least = in_output(best.errors.validation_rmse_um)
    seen = (
        f"The smallest validation error of the first step is {least}, with {best.effect}. Each "
        "candidate was added alone and refitted with the model: shares of those that explain the same "
        "error add up to more than 100 %."
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
    """Return the evidence for each candidate of a diagnosis; of a discovery it is in the summary."""
    if result.kind != "diagnosis":
        return []
    said = [c for c in result.ranking if c.evidence and c.share > 0]
    if not said:
        return []
    lines = "\n".join(f"- {c.effect}: {closed(c.evidence)}" for c in said)
    text = (
        "For each candidate that lowers the validation error: what the refit changed, and what to "
        f"look for in the figures below.\n\n{lines}"
    )
    return [Section("Evidence for each candidate", text)]


def _chosen(
    result: SearchResult, candidates: Sequence[Candidate], present: Sequence[str]
) -> list[str]:
    """Name the candidates that were taken in a step, also those taken out again later."""
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
                "Step": number,
                "effect": c.effect,
                "grade": c.grade,
                "validation_rmse_um": _known(c.errors.validation_rmse_um),
                "train_rmse_um": _known(c.errors.train_rmse_um),
                "Removed of the squared error above noise (%)": _known(100.0 * c.share),
                _CERTAINTY: 100.0 * c.confidence,
                "Indistinguishable from": ", ".join(c.indistinguishable),
                "remarks": "; ".join(c.remarks),
            }
            for c in candidates
        ]
    )
    if chances is not None:  # they are of the whole search, and known in every step
        table[_CERTAINTY] = [100.0 * chances.effects.get(c.effect, math.nan) for c in candidates]
        table = table.rename(columns={_CERTAINTY: "Probability (%)"})
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
