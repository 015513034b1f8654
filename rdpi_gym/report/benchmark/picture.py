"""The result of the benchmark in one picture, for a page of text."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.figure import Figure

from rdpi_gym.report.benchmark.figures import (
    look,
    off_axis,
    ranked_names,
    ranking_range,
)
from rdpi_gym.report.benchmark.results import BenchmarkResults
from rdpi_gym.report.style import INK, MUTED, matplotlib_style
from rdpi_gym.support.words import number

_MARKERS = {"x": "x", "circle": "o", "square": "s", "diamond": "D", "triangle-up": "^"}
_LINES = (
    "none", "pi", "inversion-free-literal", "inversion-free-reference-rate",
    "classical-reference-rate", "pi-classical-reference-rate", "pi-inversion-free-reference-rate",
)  # fmt: skip


def leaderboard_picture(results: BenchmarkResults) -> bytes:
    """Draw the ranking, and beside it the error over the frequency of some controllers."""
    style: Any = matplotlib_style()
    with rc_context(style):
        width = 12.5 if len(_sines(results)) else 7.0
        figure = Figure(figsize=(width, 4.9), layout="constrained")
        draw_leaderboard(figure, results)
        stream = io.BytesIO()
        # no version of the library in the file: the same result is the same picture
        figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


def draw_leaderboard(figure: Figure, results: BenchmarkResults) -> Any:
    """Draw what :func:`leaderboard_picture` shows into an empty figure."""
    sines = _sines(results)
    panels = figure.subplots(1, 2 if len(sines) else 1, squeeze=False)[0]
    _draw_ranking(panels[0], results.ranking.dropna(subset=["rmse_percent"]))
    if len(sines):
        _draw_lines(panels[1], sines, results.order)
    return panels


def _sines(results: BenchmarkResults) -> pd.DataFrame:
    """Return the cases with a sine on the first plant at its shortest sampling time."""
    plant, ts_s = results.shown_setting
    cases = results.by_case
    wanted = (
        (cases["plant"] == plant)
        & np.isclose(cases["ts_s"], ts_s)
        & (cases["reference"] == "sine")
        & cases["rmse_percent"].notna()
    )
    return cases[wanted]


def _draw_ranking(axes: Any, ranking: pd.DataFrame) -> None:
    place = np.arange(len(ranking))
    mean = ranking["rmse_percent"].to_numpy()
    axes.errorbar(mean, place, xerr=_interval(ranking), fmt="none", ecolor=MUTED, elinewidth=1.1)
    colours = [look(name)["color"] for name in ranking["controller"]]
    axes.scatter(mean, place, c=colours, s=34, zorder=3, label="plant within ±5 % of the belief")
    axes.scatter(
        ranking["seed_0_rmse_percent"], place, marker="|", s=70, c=INK, zorder=3, label="plant equals belief",
    )  # fmt: skip
    axes.set_yticks(place, ranked_names(ranking))
    axes.invert_yaxis()
    if len(ranking):
        low, high = ranking_range(ranking)
        axes.set_xscale("log")
        axes.set_xlim(low, high)
        names = ranked_names(ranking)
        for name, value in off_axis(ranking, names, low):
            axes.annotate(
                f"\N{BLACK LEFT-POINTING TRIANGLE} {number(value, 2)} %",
                (low, names.index(name)),
                (3, 0),
                textcoords="offset points",
                va="center",
                fontsize="x-small",
            )
    if "status" in ranking.columns:
        beside = axes.get_yaxis_transform()
        for row, said in enumerate(["status: rows of all", *ranking["status"]], start=-1):
            axes.text(
                1.02, row, said, transform=beside, va="center", fontsize="xx-small", color=MUTED
            )
    axes.set_xlabel("RMSE (% of peak to peak), geometric mean of the cases")
    axes.set_title("Ranking", loc="left")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14))


def _draw_lines(axes: Any, sines: pd.DataFrame, order: Sequence[str]) -> None:
    for name in [name for name in _LINES if name in order] or order[:6]:
        line = sines[sines["controller"] == name].sort_values("frequency_hz")
        style = look(name)
        axes.errorbar(
            line["frequency_hz"],
            line["rmse_percent"],
            yerr=_interval(line),
            label=name,
            color=style["color"],
            linestyle="-" if style["dash"] == "solid" else ":",
            marker=_MARKERS[style["symbol"]],
            markersize=4.5,
            elinewidth=0.8,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("Frequency (Hz)")
    axes.set_ylabel("RMSE (% of peak to peak)")
    plant, ts_s = sines[["plant", "ts_s"]].iloc[0]
    axes.set_title(f"Sines on {plant}, Ts = {1e6 * ts_s:g} µs", loc="left")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)


def _interval(means: pd.DataFrame) -> list[pd.Series]:
    mean = means["rmse_percent"]
    below, above = mean - means["rmse_percent_low"], means["rmse_percent_high"] - mean
    return [below.fillna(0.0), above.fillna(0.0)]
