"""Learning curves of the trainings, and what they cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from rdpi_gym.report.chart import Axis, Chart, Level, Mark, Panel, Series
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.report.style import INK, PALETTE
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table
from studies.agents.training import BASELINE, Training

COLUMNS = (
    "agent", "seed", "timesteps", "seconds", "rmse_um", "rmse_percent", "command_variation_V_s",
    "reward", "compensator_rmse_um", "compensator_rmse_percent", "compensator_command_variation_V_s",
)  # fmt: skip
"""Of a table of curves: a row is one evaluation of a training, on the held-out plants of
:mod:`baselines.learned.environments`, which are not those of the scores."""
PICTURE = "learning-curves.png"

METHOD = f"""\
- **Curves.** Between two stretches of a training its policy is evaluated on 24 held-out plants with references of their own, drawn as in training, always the same; an average of their RMSE (µm) and of the command's total variation. A line is the median over the trainings, its bars reach from the least to the greatest. A line that comes from below the axis is a network that hardly moves the command yet.
- **Compensator.** `{BASELINE}` on the same plants and references: what corrections correct, and what increments do without.
- **Seconds** are those of a training with one thread, its evaluations included, with as many side by side as the machine had cores.
"""


def learning_curves(trainings: Sequence[Training]) -> pd.DataFrame:
    """Read the curves of finished trainings."""
    parts = []
    for each in trainings:
        path = each.folder / "training.csv"
        if not path.exists():
            continue
        try:
            curve = pd.read_csv(path).assign(agent=each.agent.name, seed=each.seed)
            parts.append(curve[list(COLUMNS)])
        except (KeyError, ValueError) as error:
            raise InputError(f"{path} is no learning curve, perhaps cut off ({error})") from error
    if not parts:
        raise InputError("no training has a curve, training.csv; run --stage train")
    return pd.concat(parts, ignore_index=True)


def learning_bands(curves: pd.DataFrame) -> pd.DataFrame:
    """Return the median, the least and the greatest of each agent's trainings, step by step."""
    curves = curves.assign(
        variation_ratio=curves["command_variation_V_s"]
        / curves["compensator_command_variation_V_s"]
    )
    lines = []
    for agent, own in curves.groupby("agent", sort=False):
        trainings = own["seed"].nunique()
        for timesteps, at in own.groupby("timesteps"):
            if at["seed"].nunique() < trainings:
                continue
            line: dict[str, object] = {"agent": agent, "timesteps": timesteps}
            for name in ("rmse_um", "variation_ratio"):
                low, middle, high = np.percentile(at[name], (0.0, 50.0, 100.0))
                line |= {name: middle, f"{name}_low": low, f"{name}_high": high}
            lines.append(line)
    return pd.DataFrame(lines)


def training_costs(curves: pd.DataFrame) -> pd.DataFrame:
    """Return what a training of each agent took."""
    last = curves.sort_values("timesteps").groupby(["agent", "seed"], sort=False).tail(1)
    lines = []
    for agent in curves["agent"].unique():
        own = last[last["agent"] == agent]
        lines.append(
            {
                "agent": agent,
                "trainings": len(own),
                "timesteps": int(own["timesteps"].median()),
                "seconds": float(own["seconds"].median()),
                "steps_per_s": float((own["timesteps"] / own["seconds"]).median()),
                "rmse_um": float(own["rmse_um"].median()),
                "compensator_rmse_um": float(own["compensator_rmse_um"].median()),
            }
        )
    return pd.DataFrame(lines)


def cost_view(costs: pd.DataFrame) -> pd.DataFrame:
    """Return the costs with the headings that a reader sees."""
    return pd.DataFrame(
        {
            "agent": costs["agent"],
            "trainings": costs["trainings"],
            "steps": costs["timesteps"].map("{:,}".format),
            "seconds, median": costs["seconds"].map("{:.0f}".format),
            "steps/s, median": costs["steps_per_s"].map("{:,.0f}".format),
            "last RMSE, median (µm)": costs["rmse_um"],
            "compensator's (µm)": costs["compensator_rmse_um"],
        }
    )


def curves_text(curves: pd.DataFrame) -> str:
    """Write picture and costs as Markdown."""
    parts = [
        "# Learning curves",
        f"![RMSE and command variation over the steps of the trainings]({PICTURE})",
        METHOD,
        "## What a training costs",
        frame_table(cost_view(training_costs(curves))),
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"


_ROWS = {
    "rmse_um": "RMSE on held-out plants (µm)",
    "variation_ratio": "command variation\nover the compensator's",
}


def learning_picture(bands: pd.DataFrame, compensator: str, compensator_rmse_um: float) -> bytes:
    """Draw error and command variation over the steps, one column an algorithm, one line an agent."""
    named = bands["agent"].str.split("-", n=1, expand=True)
    bands = bands.assign(algorithm=named[0], action=named[1])
    actions, algorithms = (list(bands[name].unique()) for name in ("action", "algorithm"))
    # a factor of two about 1 at least, and no idle network far below
    low, high = bands["variation_ratio_low"].min(), bands["variation_ratio_high"].max()
    limits = {"variation_ratio": (min(max(0.8 * low, 0.1), 0.5), max(1.2 * high, 2.0))}
    panels = []
    for column, algorithm in enumerate(algorithms, start=1):
        part = bands[bands["algorithm"] == algorithm]
        for row, (name, label) in enumerate(_ROWS.items(), start=1):
            marks: list[Mark] = []
            for action, lines in part.groupby("action", sort=False):
                y = lines[name].to_numpy()
                ends = y - lines[f"{name}_low"].to_numpy(), lines[f"{name}_high"].to_numpy() - y
                marks.append(
                    Series(
                        lines["timesteps"].to_numpy(), y, str(action), PALETTE[actions.index(str(action))],
                        marker="circle", size=4.0, errors=ends,
                    )
                )  # fmt: skip
            level = compensator_rmse_um if name == "rmse_um" else 1.0
            marks.append(Level(level, compensator, INK))
            y_axis = Axis(
                label if column == 1 else "", log=True, ticks="1-2-5", limits=limits.get(name)
            )
            x_axis = Axis("environment steps" if row == 2 else "", powers=True)
            title = algorithm.upper() if row == 1 else ""
            panels.append(Panel(marks, x_axis, y_axis, title, row, column))
    panels.sort(key=lambda panel: (panel.row, panel.column))
    inches = 2.2 + 3.4 * len(algorithms), 5.6
    return chart_png(Chart(panels, shared="xy", legend="below"), inches)
