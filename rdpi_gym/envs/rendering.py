"""A frame of an episode: the hysteresis loop, and the tracking of the last moments."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.support.arrays import Array

_INK, _REFERENCE, _DISPLACEMENT, _ERROR = "#30343b", "#e07b39", "#1f6fb4", "#b8336a"
_LOOP_SAMPLES, _TRACE_SAMPLES = 2000, 1000


class LiveFigure:
    """Draws frames of one episode after the other, with the same artists.

    What stays from frame to frame (axes, labels, grid) is drawn once and copied; axes grow with
    what they have to show and never shrink within an episode.
    """

    def __init__(self, layout: ObservationLayout, title: str) -> None:
        self._layout, self._title = layout, title
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=_LOOP_SAMPLES)
        self._figure = Figure(figsize=(9.6, 4.8), dpi=100, facecolor="white")
        self._canvas: Any = FigureCanvasAgg(self._figure)  # its methods carry no types
        grid = self._figure.add_gridspec(
            2, 2, width_ratios=(1.0, 1.35), height_ratios=(2.0, 1.0),
            left=0.075, right=0.985, top=0.86, bottom=0.115, wspace=0.2, hspace=0.16,
        )  # fmt: skip
        self._loop_axes = self._figure.add_subplot(grid[:, 0])
        self._trace_axes = self._figure.add_subplot(grid[0, 1])
        self._error_axes = self._figure.add_subplot(grid[1, 1], sharex=self._trace_axes)
        self._label()
        loop, trace, error = self._loop_axes, self._trace_axes, self._error_axes
        self._past = _line(loop, color=_DISPLACEMENT, alpha=0.3, lw=1.0)
        self._loop = _line(loop, color=_DISPLACEMENT, lw=1.6)
        self._head = _line(loop, color=_DISPLACEMENT, marker="o", ms=7, mec="white", mew=1.2)
        self._reference = _line(trace, color=_REFERENCE, lw=2.4, alpha=0.85, label="reference")
        self._displacement = _line(trace, color=_DISPLACEMENT, lw=1.3, label="displacement")
        self._error = _line(error, color=_ERROR, lw=1.3)
        self._lines = (
            (loop, self._past), (loop, self._loop), (loop, self._head),
            (trace, self._reference), (trace, self._displacement), (error, self._error),
        )  # fmt: skip
        trace.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, fontsize=9,
            borderaxespad=0.1, handlelength=1.6,
        )  # fmt: skip
        self._status = self._figure.text(
            0.985, 0.955, "", ha="right", va="center", fontsize=10, color=_INK, animated=True,
            family="monospace",
        )  # fmt: skip
        self._count = 0
        self._background: Any = None
        self.reset()

    def reset(self) -> None:
        """Forget the episode, and its axes."""
        self._samples.clear()
        self._count = 0
        layout = self._layout
        low, high = layout.command_range_V
        middle, half = 0.5 * (low + high), 0.25 * (high - low)
        self._loop_axes.set_xlim(middle - half, middle + half)
        for axes in (self._loop_axes, self._trace_axes):
            spread = 1.15 * layout.scale_um
            axes.set_ylim(layout.centre_um - spread, layout.centre_um + spread)
        self._error_axes.set_ylim(-0.02 * layout.scale_um, 0.02 * layout.scale_um)
        self._background = None

    def __getstate__(self) -> tuple[ObservationLayout, str, list[tuple[float, float, float]], int]:
        # A canvas and its pixels cannot be pickled; they follow from the samples.
        return self._layout, self._title, list(self._samples), self._count

    def __setstate__(
        self, state: tuple[ObservationLayout, str, list[tuple[float, float, float]], int]
    ) -> None:
        layout, title, samples, count = state
        LiveFigure.__init__(self, layout, title)
        self._samples.extend(samples)
        self._count = count

    def record(self, command_V: float, reference_um: float, displacement_um: float) -> None:
        """Remember a sample."""
        self._samples.append((command_V, reference_um, displacement_um))
        self._count += 1

    def draw(self) -> NDArray[np.uint8]:
        """Return the frame of the samples so far, ``uint8[480, 960, 3]``."""
        command, reference, displacement = np.array(self._samples).reshape(-1, 3).T
        recent = slice(-_TRACE_SAMPLES, None)
        error = reference[recent] - displacement[recent]
        self._past.set_data(command, displacement)
        self._loop.set_data(command[recent], displacement[recent])
        self._head.set_data(command[-1:], displacement[-1:])
        before_ms = 1e3 * self._layout.ts_s * np.arange(1 - len(error), 1)
        self._reference.set_data(before_ms, reference[recent])
        self._displacement.set_data(before_ms, displacement[recent])
        self._error.set_data(before_ms, error)
        if len(error):
            rmse = np.sqrt(np.mean(error**2))
            time_ms = 1e3 * self._layout.ts_s * (self._count - 1)
            self._status.set_text(
                f"t = {time_ms:7.1f} ms   u = {command[-1]:7.2f} V   RMS error = {rmse:6.3f} µm"
            )
        self._grow(command, np.concatenate([displacement, reference]), error)
        return self._composed()

    def _composed(self) -> NDArray[np.uint8]:
        if self._background is None:
            self._canvas.draw()
            self._background = self._canvas.copy_from_bbox(self._figure.bbox)
        self._canvas.restore_region(self._background)
        for axes, line in self._lines:
            axes.draw_artist(line)
        self._figure.draw_artist(self._status)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _grow(self, command: Array, displacement: Array, error: Array) -> None:
        """Widen the axes that no longer hold their data, by a margin that makes it rare."""
        loop, trace = self._loop_axes, self._trace_axes
        grown = [
            _widen(loop.get_xlim, loop.set_xlim, command),
            _widen(loop.get_ylim, loop.set_ylim, displacement),
            _widen(trace.get_ylim, trace.set_ylim, displacement),
            _widen(self._error_axes.get_ylim, self._error_axes.set_ylim, np.append(error, -error)),
        ]
        if any(grown):
            self._background = None

    def _label(self) -> None:
        self._figure.text(
            0.075,
            0.955,
            self._title,
            ha="left",
            va="center",
            fontsize=12,
            weight="bold",
            color=_INK,
        )
        self._loop_axes.set(xlabel="command (V)", ylabel="displacement (µm)")
        self._trace_axes.set(ylabel="µm")
        self._error_axes.set(ylabel="error (µm)", xlabel="time before now (ms)")
        self._error_axes.set_xlim(-1e3 * self._layout.ts_s * (_TRACE_SAMPLES - 1), 0.0)
        self._trace_axes.tick_params(labelbottom=False)
        for axes in (self._loop_axes, self._trace_axes, self._error_axes):
            axes.grid(color="#e3e6ea", lw=0.8)
            axes.set_axisbelow(True)
            axes.tick_params(labelsize=9, colors=_INK, length=3)
            axes.spines[["top", "right"]].set_visible(False)
            axes.spines[["left", "bottom"]].set_color("#9aa1ab")
        self._error_axes.axhline(0.0, color="#9aa1ab", lw=0.8)
        self._figure.align_ylabels([self._trace_axes, self._error_axes])


def _line(axes: Axes, **style: Any) -> Line2D:
    """Add an empty line that is drawn by hand, over what stays."""
    (line,) = axes.plot([], [], animated=True, **style)
    return line


def _widen(
    get: Callable[[], tuple[float, float]], set_: Callable[[float, float], Any], data: Array
) -> bool:
    """Widen limits that do not hold the data, and say whether they were widened."""
    low, high = get()
    lowest, highest = data.min(initial=low), data.max(initial=high)
    if lowest >= low and highest <= high:
        return False
    margin = 0.15 * (highest - lowest)
    set_(lowest - margin if lowest < low else low, highest + margin if highest > high else high)
    return True
