"""Sections of a page that show records: measured, and as each model sees them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.diagnosis.comparison.residual_views import residual_profiles, view_trace
from rdpi_gym.diagnosis.results import SearchResult, View
from rdpi_gym.report.discovery import view_figures
from rdpi_gym.report.page import Section
from rdpi_gym.report.thin import DISPLAY_SAMPLES

MOST_VIEWS = 24
"""Records whose traces stand on the page; of more, the first."""
_ALL_SAMPLES = 8 * DISPLAY_SAMPLES


def view_sections(result: SearchResult) -> list[Section]:
    """Show the records over time, as loops, and what is left of them; none without views."""
    views = [view for view in result.views if view.models_um and np.any(view.counted)][:MOST_VIEWS]
    if not views:
        return []
    floor = result.noise_floor_um
    samples = max(600, min(DISPLAY_SAMPLES, _ALL_SAMPLES // len(views)))
    names = _names(views)
    labels = list(views[0].models_um)
    pair = (
        f"Orange is the model “{labels[0]}”, blue is “{labels[-1]}”"
        if len(labels) > 1
        else f"Blue is the model “{labels[0]}”"
    )
    chosen = (
        f" Of {len(result.views)} records the first {len(views)} are here."
        if len(views) < len(result.views)
        else ""
    )
    residuals = {}
    for name, view in names.items():
        traces = {label: view_trace(view, label) for label in view.models_um}
        residuals[name] = view_figures.residuals(
            {label: residual_profiles(trace) for label, trace in traces.items()},
            floor,
            next(iter(traces.values())).ts_s,
        )
    return [
        Section(
            "Measurement against model",
            f"{pair}; below, what each leaves of the measurement, and the noise floor as a band: "
            "the last model should stay within about three times the band, without a pattern. "
            f"Other models are shown by a click in the legend.{chosen}",
            {n: view_figures.over_time(v, floor, samples) for n, v in names.items()},
        ),
        Section(
            f"Where the model “{labels[0]}” was farthest off",
            "The half-cycle of its largest difference with the one before and the one after: "
            "what the added effects change is seen best here.",
            {n: view_figures.largest_error(v, floor, samples // 2) for n, v in names.items()},
        ),
        Section(
            "Loops",
            "Displacement over command on the left; on the right the same difference as above along "
            "the loops, where a shape that repeats is physics that the model lacks.",
            {n: view_figures.loops(v, floor, samples) for n, v in names.items()},
        ),
        Section(
            "What is left, and where",
            "Means of what each model leaves, over the command (solid: rising, dotted: falling), over "
            "its rate and, in a record with holds, over the time since the command last moved "
            "(counted onward in the direction of that move: creep climbs steadily there); and its "
            "spectrum beside that of the noise (dashed), where resonances and hum are peaks.",
            residuals,
        ),
    ]


def _names(views: Sequence[View]) -> dict[str, View]:
    """Name each view by its record; the held-out part of a record has the role beside it."""
    return {f"{view.name} ({view.role})": view for view in views}
