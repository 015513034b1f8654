"""Tables of the study: summaries of scores with bootstrapped intervals, and learning curves with their costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from benchmarks.tracking.stages import NOISE_UM
from rdpi_gym.envs.truth import RATE_BANDWIDTH_HZ
from rdpi_gym.report.chart import Axis, Chart, Level, Mark, Panel, Series
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.report.style import INK, PALETTE
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.markdown import frame_table, leading_rows
from rdpi_gym.support.words import number
from studies.agents.scores import LITERAL, PREVIEW_INVERSION, TS_S
from studies.agents.training import BASELINE, Study, Training

ALL_GROUPS = "all groups"
CONFIDENCE = 0.95
_CUT = 0.25
_ERROR, _VARIATION = "rmse_percent", "command_variation_V_s"
_RIVALS = ("feedforward", "feedback")  # what is causal and was not trained


@dataclass(frozen=True)
class Estimate:
    """An interquartile mean and the same of every resample."""

    value: float  # of the scores
    draws: Array  # of the resamples, ``(R,)``

    def over(self, other: Estimate) -> Estimate:
        """Return the ratio to another one, resample by resample."""
        with np.errstate(invalid="ignore"):
            return Estimate(float(self.value / other.value), self.draws / other.draws)

    def row(self, name: str) -> dict[str, float]:
        """Return value and interval as columns."""
        tail = 50.0 * (1.0 - CONFIDENCE)
        # an order statistic: between two infinities there is nothing to interpolate
        low, high = np.percentile(self.draws, [tail, 100.0 - tail], method="nearest")
        return {name: self.value, f"{name}_low": float(low), f"{name}_high": float(high)}


def interquartile_mean(scores: Array) -> Array:
    """Return the mean of the middle half along the last axis: exactly a quarter is cut at each end."""
    edges = np.linspace(0.0, 1.0, scores.shape[-1] + 1)
    shares = np.diff(np.clip(edges, _CUT, 1.0 - _CUT)) / (1.0 - 2.0 * _CUT)
    counted = shares > 0.0  # an infinite score that is cut must not make the mean NaN
    return np.asarray(np.sort(scores, axis=-1)[..., counted] @ shares[counted], dtype=np.float64)


def estimate(matrices: Sequence[Array], resamples: int, seed: int = 0) -> Estimate:
    """Return the interquartile mean of scores and of their resamples."""
    plants_rng, trainings_rng = np.random.default_rng([seed, 0]), np.random.default_rng([seed, 1])
    trainings = len(matrices[0])
    again = trainings_rng.integers(trainings, size=(resamples, trainings, 1))
    drawn = []
    for matrix in matrices:
        plants = plants_rng.integers(matrix.shape[1], size=(resamples, 1, matrix.shape[1]))
        drawn.append(matrix[again, plants].reshape(resamples, -1))
    value = interquartile_mean(np.concatenate([matrix.ravel() for matrix in matrices]))
    return Estimate(float(value), interquartile_mean(np.concatenate(drawn, axis=1)))


def summarise(table: pd.DataFrame, resamples: int) -> pd.DataFrame:
    """Summarise a table of scores, world by world and all together."""
    worlds = list(table["world"].unique())
    parts = [(ALL_GROUPS, worlds)] if len(worlds) > 1 else []
    parts += [(world, [world]) for world in worlds]
    lines: list[dict[str, object]] = []
    for name, chosen in parts:
        lines += _summary(name, table[table["world"].isin(chosen)], chosen, resamples)
    return pd.DataFrame(lines)


def gap_summary(table: pd.DataFrame, resamples: int) -> pd.DataFrame:
    """Put each domain beside its twin with a literal rate."""
    lines: list[dict[str, object]] = []
    for domain in [name for name in table["world"].unique() if not name.endswith(LITERAL)]:
        limited = _estimates(table, [domain], resamples)
        literal = _estimates(table, [domain + LITERAL], resamples)
        best = limited[_best(limited)][_VARIATION]
        for (name, kind), own in limited.items():
            other = literal[name, kind]
            lines.append(
                {
                    "domain": domain, "contestant": name, "kind": kind,
                    **own[_ERROR].row(_ERROR),
                    **other[_ERROR].row(f"literal_{_ERROR}"),
                    **other[_ERROR].over(own[_ERROR]).row("literal_ratio"),
                    **own[_VARIATION].over(best).row("variation_ratio"),
                    **other[_VARIATION].over(best).row("literal_variation_ratio"),
                }
            )  # fmt: skip
    order = pd.DataFrame(lines)
    place = order["domain"].map({name: i for i, name in enumerate(order["domain"].unique())})
    ranked = order.assign(place=place).sort_values(["place", _ERROR], ignore_index=True)
    return ranked.drop(columns="place")


_Estimates = Mapping[tuple[str, str], Mapping[str, Estimate]]


def _summary(
    name: str, table: pd.DataFrame, worlds: Sequence[str], resamples: int
) -> list[dict[str, object]]:
    found = _estimates(table, worlds, resamples)
    leader = _best(found)
    best = found[leader]
    leading_feedforward = _best(found, ("feedforward",))
    feedforward = found[leading_feedforward]
    lines: list[dict[str, object]] = []
    for (contestant, kind), own in found.items():
        rows = table[table["contestant"] == contestant]
        lines.append(
            {
                "world": name, "contestant": contestant, "kind": kind,
                "trainings": rows["training_seed"].nunique(),
                "plants": len(rows[["world", "plant_seed"]].drop_duplicates()),
                **own[_ERROR].row(_ERROR),
                **own[_VARIATION].row(_VARIATION),
                "best": leader[0],
                **own[_ERROR].over(best[_ERROR]).row("rmse_ratio"),
                **own[_VARIATION].over(best[_VARIATION]).row("variation_ratio"),
                "best_feedforward": leading_feedforward[0],
                **own[_ERROR].over(feedforward[_ERROR]).row("rmse_over_feedforward"),
                **own[_VARIATION].over(feedforward[_VARIATION]).row("variation_over_feedforward"),
                "failed": int(rows[_ERROR].isna().sum()),
            }
        )  # fmt: skip
    return sorted(lines, key=lambda line: float(str(line[_ERROR])))


def _best(found: _Estimates, kinds: Sequence[str] = _RIVALS) -> tuple[str, str]:
    return min((one for one in found if one[1] in kinds), key=lambda one: found[one][_ERROR].value)


def _estimates(table: pd.DataFrame, worlds: Sequence[str], resamples: int) -> _Estimates:
    table = table[table["world"].isin(worlds)]
    return {
        (str(name), str(kind)): {
            column: estimate([_matrix(rows, world, column) for world in worlds], resamples)
            for column in (_ERROR, _VARIATION)
        }
        for (name, kind), rows in table.groupby(["contestant", "kind"], sort=False)
    }


def _matrix(rows: pd.DataFrame, world: str, column: str) -> Array:
    part = rows[rows["world"] == world].assign(training=rows["training_seed"].fillna(-1))
    wide = part.pivot(index="training", columns="plant_seed", values=column)
    return np.asarray(wide.astype(float).fillna(np.inf).to_numpy(), dtype=np.float64)


METHOD = f"""\
- **Agents.** Each is trained with several seeds by `python -m studies.agents --stage train`. `correction`: its action is added to the command of `{BASELINE}`; `increment`: its action changes the command, and nothing else tracks.
- **Belief.** Every controller holds the nominal P10 without effects; so does the baseline that an agent corrects.
- **Held-out plants.** Drawn about P10 with the effects of the group, from seeds of which no training draws: weights, gaps between thresholds and δ2 within 1 ± 0.05, parameters of the effects within 1 ± 0.4. `all`: a lag of the amplifier, creep and a mode at 739 Hz; `lag`, `resonance` and `creep` one of them, a combination that no training had; `bare` none. The rate is low-passed at {RATE_BANDWIDTH_HZ:g} Hz; {1e3 * NOISE_UM:g} nm of noise is measured. Ts is {1e6 * TS_S:g} µs.
- **References.** Sines of 25, 50, 80 and 100 Hz, triangle, raster and nested loops of 20 Hz, multisine of 10 to 100 Hz, as far as they were asked for. Raster and nested loops were in no training.
- **Score of a plant.** Mean over the references of the RMSE of the noise-free displacement after the smooth start, in percent of the reference's peak to peak, and of the command's total variation (V/s).
- **Interquartile mean.** As rliable defines it: the mean of the middle half of the scores of all trainings on all plants (where a quarter of them is no whole number, the scores at its ends count in part). Brackets hold its {100 * CONFIDENCE:g} % bootstrap interval: trainings and plants are drawn again, plants within their group. A run that failed counts as infinite.
- **Ratios** are to the best causal compensator in the same group, feedforward or with feedback, by its interquartile mean, and to the best feedforward; `{PREVIEW_INVERSION}` knows the whole reference beforehand and is not among them.
"""

GAP_METHOD = f"""\
- **Domains.** `bare`: P10 without effects; `with effects`: with lag, creep and mode; `picma`: the plant identified from the measured PICMA record, on which a policy runs in proportion to amplitude and command range. That record has 1 Hz, so 20 to 100 Hz are extrapolated; `picma at 1 Hz` is within it. Plants are drawn about each of them as in the scores.
- **Literal.** The same plants with the rate as Eq. (5) writes it, in place of low-passed at {RATE_BANDWIDTH_HZ:g} Hz; agents and beliefs are the same. A command that exploits the artefact of the literal model dithers: its ratio lies far below those of the smooth compensators, and its command variation far above theirs.
- **Command variation** is over that of the best causal compensator on the low-passed plants of the domain.
- **Numbers** are interquartile means with bootstrap intervals, as in `agents.md`.
"""


def agents_text(study: Study, summary: pd.DataFrame, trainings: pd.DataFrame) -> str:
    """Write scores and trainings as Markdown."""
    worlds = [ALL_GROUPS, *(name for name in summary["world"].unique() if name != ALL_GROUPS)]
    parts = [
        "# Trained agents beside the compensators",
        _trained(study, trainings),
        METHOD,
    ]
    for world in worlds:
        part = summary[summary["world"] == world]
        if part.empty:
            continue
        best, feedforward = part["best"].iloc[0], part["best_feedforward"].iloc[0]
        parts += [
            f"## Plants: {world}",
            f"Best causal compensator: `{best}`; best feedforward: `{feedforward}`.",
            leading_rows(_score_view(part), "summary.csv"),
        ]
    parts += ["## Trainings", leading_rows(trainings, "trainings.csv")]
    return _joined(parts)


def gap_text(study: Study, summary: pd.DataFrame, trainings: pd.DataFrame) -> str:
    """Write the domain gap as Markdown."""
    parts = ["# The same agents elsewhere", _trained(study, trainings), GAP_METHOD]
    for domain, part in summary.groupby("domain", sort=False):
        parts += [f"## {domain}", frame_table(_gap_view(part))]
    return _joined(parts)


def _trained(study: Study, trainings: pd.DataFrame) -> str:
    """Say which trainings the tables are made of, and which are missing."""
    there = {(str(agent), int(seed)) for agent, seed in zip(*_named(trainings), strict=True)}
    wanted = [(agent.name, seed) for agent in study.agents for seed in study.seeds]
    missing = [f"{name} with seed {seed}" for name, seed in wanted if (name, seed) not in there]
    text = (
        f"{len(there)} trainings, {study.plants} plants a group with seeds 0 to {study.plants - 1}, "
        f"references {', '.join(study.references)}. Made by `python -m studies.agents`."
    )
    return text + (f" Not trained: {', '.join(missing)}." if missing else "")


def _named(trainings: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    return trainings["agent"], trainings["seed"]


def _score_view(part: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "controller": part["contestant"],
            "kind": part["kind"],
            "trainings": part["trainings"],
            "RMSE (%)": ranged(part, "rmse_percent"),
            "RMSE over the best": ranged(part, "rmse_ratio"),
            "RMSE over the best feedforward": ranged(part, "rmse_over_feedforward"),
            "command variation (V/s)": ranged(part, "command_variation_V_s"),
            "variation over the best": ranged(part, "variation_ratio"),
            "variation over the best feedforward": ranged(part, "variation_over_feedforward"),
            "failed": part["failed"],
        }
    )


def _gap_view(part: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "controller": part["contestant"],
            "RMSE (%)": ranged(part, "rmse_percent"),
            "literal: RMSE (%)": ranged(part, "literal_rmse_percent"),
            "literal over low-passed": ranged(part, "literal_ratio"),
            "command variation": ranged(part, "variation_ratio"),
            "literal: command variation": ranged(part, "literal_variation_ratio"),
        }
    )


def ranged(frame: pd.DataFrame, column: str) -> list[str]:
    """Return the estimates of a column with their intervals, row by row."""
    parts = [frame[name] for name in (column, f"{column}_low", f"{column}_high")]
    return [
        f"{number(value)} ({number(low)} to {number(high)})" if np.isfinite(value) else "failed"
        for value, low, high in zip(*parts, strict=True)
    ]


def _joined(parts: list[str]) -> str:
    return "\n\n".join(part.strip() for part in parts) + "\n"


CURVE_COLUMNS = (
    "agent", "seed", "timesteps", "seconds", "rmse_um", "rmse_percent", "command_variation_V_s",
    "reward", "compensator_rmse_um", "compensator_rmse_percent", "compensator_command_variation_V_s",
)  # fmt: skip
"""Columns of a table of curves: a row is one evaluation of a training, on the held-out plants of
:mod:`baselines.learned.environments`, which are not those of the scores."""
PICTURE = "learning-curves.png"

CURVE_METHOD = f"""\
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
            parts.append(curve[list(CURVE_COLUMNS)])
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
        CURVE_METHOD,
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
