"""The pages on agents, filled from committed results, and the walk of the page on training: its commands and what they print."""

from __future__ import annotations

import os
import re
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from baselines import GUARDED, LEARNED
from baselines.core_bank import AdaptiveCoreBank
from rdpi_gym.plant import P10
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, write_json
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.words import joined, number
from studies.agents.tables import ALL_GROUPS, cost_view, ranged, training_costs
from studies.agents.training import Study
from studies.pages import FENCE, TEMPLATES, Session, fill
from studies.student_seeds import RESULTS as STUDENTS
from studies.student_seeds import RIVAL
from studies.training_race import FIRST, SHORT, best_fixed, by_entrant, read_rankings
from studies.training_race import RESULTS as RACE

FORMAT, VERSION = "walk", 1
FILE = "walk.json"
HYPERPARAMETERS = Path(__file__).parents[2] / "baselines" / "learned" / "hyperparameters"
HISTORY = "rdpi_gym.envs.wrappers.history.HistoryObservation"
ROUGH = 1.5
"""Command variation over that of the best causal compensator from which on a command is rough."""
UNSTABLE_PERCENT = 100.0
"""A tracking error (% of peak to peak) above which a loop is called unstable."""
_CAUSAL = ("feedforward", "feedback")
_MADE_BY = {
    "summary": "studies.agents --stage score",
    "gap": "studies.agents --stage gap",
    "curves": "studies.agents --stage curves",
    "shipped": "studies.agents --stage ship",
    "race": "studies.training_race",
    "student_seeds": "studies.student_seeds",
}
_VERDICTS = {
    "ahead": "ahead of every causal compensator",
    "behind": "behind the best compensator",
    "level": "not to be told from the best compensator",
}
_SHOWN_ROWS = (0, 1, 2, 3, 5, 8, 12, 16)


def page_facts(results: Path) -> dict[str, Any]:
    """Return numbers, tables and findings of the pages."""
    summary, gap, curves, shipped = (
        _read(results, name) for name in ("summary", "gap", "curves", "shipped")
    )
    walk = read_json(results / FILE, FORMAT, VERSION)
    groups = summary[summary["world"] != ALL_GROUPS]
    rankings = read_rankings()
    names = rankings["controller"]
    on_tasks = task_leaders(rankings)
    students = rankings[names.str.startswith(f"{LEARNED}imitation-")]
    worst = students[students["failed"] < 1.0].nlargest(1, "failed").iloc[0]
    race = by_entrant(_read(RACE, "race"))
    by_world = [(str(world), part) for world, part in groups.groupby("world")]
    ppo: dict[str, Any] = _hyperparameters("ppo")
    return {
        "format": "agents",
        "version": 1,
        "zero_rad_s": P10.hysteresis.zero_rad_s,
        "default_steps": {
            name: f"{_hyperparameters(name)['n_timesteps']:,}" for name in ("ppo", "sac", "td3")
        },
        "lanes": ppo["n_envs"],
        "history": ppo["env_wrapper"][0][HISTORY]["history"],
        "trainings": len(curves[["agent", "seed"]].drop_duplicates()),
        "plants": int(groups["plants"].max()),
        "shipped_kib": float(shipped["policy_bytes"].sum()) / 1024.0,
        "sac_over_ppo": times_between(shipped, "sac", "ppo"),
        "walk": _walk(walk),
        "tasks": tasks_standing(on_tasks),
        "race": race[SHORT]
        | {
            "rival": best_fixed(rankings)["controller"],
            "first_seconds": race[FIRST]["seconds"],
        },
        "students": _students(),
        "guarded_failures": float(rankings.loc[names.str.startswith(GUARDED), "failed"].max()),
        "unguarded": {
            "student": str(worst["controller"]).removeprefix(LEARNED),
            "task": str(worst["task"]),
            "percent": 100.0 * float(worst["failed"]),
        },
        "strangest": {
            role: strangest(rankings, f"{prefix}imitation-")
            for role, prefix in (("alone", LEARNED), ("guarded", GUARDED))
        },
        "student_us": float(students["microseconds_per_sample"].min()),
        "reacting_ahead": tasks_standing(task_leaders(rankings[~names.str.contains(":imitation")]))[
            "tasks_ahead"
        ],
        "verdicts": {world: verdict(leader) for world, leader in leaders(groups)},
        "best_kinds": {
            world: str(part.loc[part["contestant"] == part["best"], "kind"].iloc[0])
            for world, part in by_world
        },
        "unstable": {world: unstable(part) for world, part in by_world},
        "tables": {
            "curve": frame_table(_curve_view(pd.DataFrame(walk["curve"]))),
            "groups": frame_table(groups_view(groups)),
            "tasks": frame_table(standing_view(on_tasks)),
            "gap": frame_table(gap_view(gap)),
            "costs": frame_table(cost_view(training_costs(curves))),
            "shipped": frame_table(shipped_view(shipped)),
        },
        "findings": {"standing": standing(groups), "dither": dither(gap)},
    }


def _read(results: Path, name: str) -> pd.DataFrame:
    path = results / f"{name}.csv"
    if not path.exists():
        raise InputError(f"{path} is missing; run python -m {_MADE_BY[name]}")
    return pd.read_csv(path)


def _hyperparameters(algorithm: str) -> dict[str, Any]:
    text = (HYPERPARAMETERS / f"{algorithm}.yml").read_text(encoding="utf-8")
    values: dict[str, Any] = yaml.safe_load(text)["default"]
    return values


def _students() -> dict[str, Any]:
    table = _read(STUDENTS, "student_seeds")
    own = table[table["student"] != RIVAL]
    shares = own.groupby("task")["over_rival"]
    return {
        "seeds": int(own.groupby("task").size().min()),
        "last_over_best": float(own["last_over_best"].max()),
        **{str(task): _span(part) for task, part in shares},
    }


def _walk(walk: dict[str, Any]) -> dict[str, Any]:
    curve = walk["curve"]
    best = max(curve, key=lambda row: row["reward"])
    below = (row["timesteps"] for row in curve if row["rmse_um"] < row["compensator_rmse_um"])
    crossing = next(below, None)
    return {
        "minutes": walk["seconds"] / 60.0,
        "cores": walk["cores"],
        "training_seconds": walk["commands"][0]["seconds"],
        "rmse_um": best["rmse_um"],
        "compensator_rmse_um": best["compensator_rmse_um"],
        "rmse_ratio": best["rmse_um"] / best["compensator_rmse_um"],
        "untrained_rmse_um": curve[0]["rmse_um"],
        "crossing": "no" if crossing is None else f"{crossing:,}",
    }


def _curve_view(curve: pd.DataFrame) -> pd.DataFrame:
    last = len(curve) - 1
    shown = curve.iloc[[k for k in _SHOWN_ROWS if k < last] + [last]]
    ratio = shown["command_variation_V_s"] / shown["compensator_command_variation_V_s"]
    return pd.DataFrame(
        {
            "timesteps": shown["timesteps"].map("{:,}".format),
            "seconds": shown["seconds"].map("{:.0f}".format),
            "reward": shown["reward"],
            "rmse_um": shown["rmse_um"],
            "compensator_rmse_um": shown["compensator_rmse_um"],
            "command variation over the compensator's": ratio,
        }
    )


def task_leaders(rankings: pd.DataFrame) -> pd.DataFrame:
    """Return a line for each task: the best policy, the best with a monitor, the best without learning."""
    lines = []
    for task, part in rankings.groupby("task", sort=False):
        names = part["controller"]
        learned, guarded = names.str.startswith(LEARNED), names.str.startswith(GUARDED)
        line: dict[str, Any] = {"task": task}
        for role, rows, kind in (
            ("learned", part[learned], f"{LEARNED} policy"),
            ("guarded", part[guarded], f"{GUARDED} policy"),
            ("other", part[~learned & ~guarded], "controller without learning"),
        ):
            if rows.empty:
                raise InputError(f"{task} has no {kind}; score those that ship, too")
            first: dict[str, Any] = rows.to_dict("records")[0]  # type: ignore[assignment]
            line[role] = first["controller"]
            line |= {
                f"{role}_{name}": first[name] for name in ("failed", "p90_percent", "iqm_percent")
            }
        line["ratio"] = line["learned_iqm_percent"] / line["other_iqm_percent"]
        lines.append(line)
    return pd.DataFrame(lines)


def tasks_standing(found: pd.DataFrame) -> dict[str, Any]:
    """Return the tasks on which a policy is ahead, those on which none runs, and ratios of the errors."""
    runs = found["learned_failed"] < 1.0
    ahead = found.loc[runs & (found["ratio"] < 1.0), "task"].tolist()
    return {
        "ahead": joined(ahead) if ahead else "no task",
        "tasks_ahead": len(ahead),
        "not_run": found.loc[~runs, "task"].tolist(),
        "ratios": dict(zip(found["task"], found["ratio"], strict=True)),
    }


def strangest(rankings: pd.DataFrame, prefix: str) -> dict[str, Any]:
    """Return which student, where none of its plants fails, leaves the most times the error of what it corrects."""
    names = rankings["controller"]
    base = rankings[names == AdaptiveCoreBank.name].set_index("task")["iqm_percent"]
    own = rankings[names.str.startswith(prefix) & (rankings["failed"] == 0.0)]
    own = own.assign(times=own["iqm_percent"] / own["task"].map(base))
    row = own.nlargest(1, "times").iloc[0]
    student = str(row["controller"]).partition(":")[2]
    return {"student": student, "task": str(row["task"]), "times": float(row["times"])}


def standing_view(found: pd.DataFrame) -> pd.DataFrame:
    """Return the leaders of the tasks with the headings of the page."""

    def best(line: Mapping[Any, Any], role: str, prefix: str) -> str:
        error, failed = line[f"{role}_iqm_percent"], line[f"{role}_failed"]
        name = line[role].removeprefix(prefix)
        return f"`{name}`: {number(error)} ({number(100.0 * failed)} % fail)"

    return pd.DataFrame(
        [
            {
                "task": line["task"],
                "best policy": best(line, "learned", LEARNED),
                "best with its monitor": best(line, "guarded", GUARDED),
                "best without learning": best(line, "other", ""),
                "policy's IQM over that": number(line["ratio"]) if line["learned_failed"] < 1.0 else "–",
            }
            for line in found.to_dict("records")
        ]
    )  # fmt: skip


def _kind(part: pd.DataFrame, kind: str) -> pd.DataFrame:
    return part[part["kind"] == kind].sort_values("rmse_percent")


def groups_view(groups: pd.DataFrame) -> pd.DataFrame:
    """Return one line a group of plants: the best compensators, and every agent; RMSE (%)."""
    agents = list(groups.loc[groups["kind"] == "agent", "contestant"].sort_values().unique())
    lines = []
    for world, part in groups.groupby("world", sort=False):
        line = {
            "plants": world,
            "best feedforward": _best(part, "feedforward"),
            "best with feedback": _best(part, "feedback"),
            "with feedback, unstable": f"{unstable(part)} of {len(_kind(part, 'feedback'))}",
        }
        errors = part.set_index("contestant")["rmse_percent"]
        lines.append(line | {name: _percent(errors[name]) for name in agents})
    return pd.DataFrame(lines)


def _best(part: pd.DataFrame, kind: str) -> str:
    for own in _kind(part, kind).to_dict("records"):
        return f"{own['contestant']}: {_percent(own['rmse_percent'])}"
    return "–"


def unstable(part: pd.DataFrame) -> int:
    """Count the controllers with feedback that do not track in a group, or fail there."""
    return int((_kind(part, "feedback")["rmse_percent"] > UNSTABLE_PERCENT).sum())


def _percent(value: float) -> str:
    return number(value) if np.isfinite(value) else "failed"


def leaders(groups: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield the best agent of each group, a table of one row."""
    for world, part in groups.groupby("world", sort=False):
        yield str(world), _kind(part, "agent").head(1)


def verdict(leader: pd.DataFrame) -> str:
    """Name the side of 1 on which the interval of the ratio to the best compensator lies."""
    if leader["rmse_ratio_high"].iloc[0] < 1.0:
        return "ahead"
    return "behind" if leader["rmse_ratio_low"].iloc[0] > 1.0 else "level"


def standing(groups: pd.DataFrame) -> str:
    """Compare the best agent with the best compensator, group by group."""
    lines = []
    for world, leader in leaders(groups):
        (error,), (variation,) = ranged(leader, "rmse_ratio"), ranged(leader, "variation_ratio")
        lines.append(
            f"- **{world}**: {_VERDICTS[verdict(leader)]}. `{leader['contestant'].iloc[0]}` has {error} "
            f"times the error of `{leader['best'].iloc[0]}`, at {variation} times its command variation."
        )
    return "\n".join(lines)


def gap_view(gap: pd.DataFrame) -> pd.DataFrame:
    """Return the agents of each domain below its best compensator."""
    parts = []
    for _, part in gap.groupby("domain", sort=False):
        causal = part[part["kind"].isin(_CAUSAL)].sort_values("rmse_percent")
        parts += [causal.head(1), _kind(part, "agent")]
    shown = pd.concat(parts)
    return pd.DataFrame(
        {
            "domain": shown["domain"],
            "controller": shown["contestant"],
            "RMSE (%)": shown["rmse_percent"].map(_percent),
            "literal over low-passed": shown["literal_ratio"],
            "command variation": shown["variation_ratio"],
            "literal: command variation": shown["literal_variation_ratio"],
        }
    )


def dither(gap: pd.DataFrame) -> str:
    """Report domain by domain whether the agents' commands dither, or exploit the literal rate."""
    lines = []
    for domain, part in gap.groupby("domain", sort=False):
        agents = part[part["kind"] == "agent"]
        rough = agents.loc[agents["variation_ratio"] > ROUGH, "contestant"]
        smoothness = "smooth, all of them"
        if len(rough):
            names = ", ".join(f"`{name}`" for name in rough)
            smoothness = f"above {ROUGH:g} are {names}: they dither, or pass noise on"
        lines.append(
            f"- **{domain}**: command variation {_span(agents['variation_ratio'])} times that of the best "
            f"compensator, {smoothness}. Error on the literal plants {_span(agents['literal_ratio'])} times that "
            "on the low-passed ones."
        )
    smooth = gap[gap["kind"].isin(_CAUSAL) & (gap["rmse_percent"] < UNSTABLE_PERCENT)]
    lines.append(
        f"- Of the compensators that track (RMSE below {UNSTABLE_PERCENT:g} %), over all domains: error on the "
        f"literal plants {_span(smooth['literal_ratio'])} times that on the low-passed ones."
    )
    return "\n".join(lines)


def _span(values: pd.Series) -> str:
    return f"{number(values.min())} to {number(values.max())}"


def times_between(shipped: pd.DataFrame, algorithm: str, other: str) -> str:
    """Return the ratios of the errors of two algorithms' median policies, action by action."""
    own = shipped.set_index("agent")["rmse_percent"]
    ways = [name.partition("-")[2] for name in own.index if name.startswith(f"{algorithm}-")]
    ratios = sorted(own[f"{algorithm}-{way}"] / own[f"{other}-{way}"] for way in ways)
    return " and ".join(f"{ratio:.2g}" for ratio in ratios)


def shipped_view(shipped: pd.DataFrame) -> pd.DataFrame:
    """Return the median policies, and which of them ship, with the headings of the page."""
    both = zip(shipped["best_percent"], shipped["worst_percent"], strict=True)
    return pd.DataFrame(
        {
            "policy": shipped["agent"],
            "seed": shipped["seed"],
            "RMSE (%)": shipped["rmse_percent"],
            "trainings": shipped["trainings"],
            "best to worst of them (%)": [
                f"{number(best)} to {_percent(worst)}" for best, worst in both
            ],
            "ships": [f"{b:,} bytes" if b else "no" for b in shipped["policy_bytes"]],
        }
    )


STEPS = 1_500_000
"""The training that the page begins with."""
RUN = "results/first-agent"
"""Its folder."""
_BLOCK = re.compile(rf"^{FENCE}\w.*?^{FENCE}$", re.M | re.S)


class _Timed(Session):
    """Runs commands, and keeps what each printed and took (s)."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.taken: list[dict[str, Any]] = []

    def run(self, command: str) -> list[str]:
        began = time.perf_counter()
        printed = super().run(command)
        seconds = round(time.perf_counter() - began, 1)
        self.taken.append({"command": command, "seconds": seconds, "printed": printed})
        return printed


class Recorded(Session):
    """Replays the printed lines of the commands of a walk."""

    def __init__(self, folder: Path, walk: Mapping[str, Any]) -> None:
        super().__init__(folder)
        self._printed = {each["command"]: each["printed"] for each in walk["commands"]}

    def run(self, command: str) -> list[str]:
        """Return what the command printed."""
        if command not in self._printed:
            raise InputError(f"{FILE} has no {command!r}; run --stage walk again")
        return list(self._printed[command])


def take_walk(template: str) -> dict[str, Any]:
    """Run the commands of a template in an empty folder."""
    with tempfile.TemporaryDirectory() as folder:
        session = _Timed(Path(folder))
        fill("\n\n".join(_BLOCK.findall(template)), session, no_picture)
        curve = pd.read_csv(session.folder / RUN / "training.csv")
    return {
        "format": FORMAT,
        "version": VERSION,
        "cores": os.cpu_count(),
        "seconds": round(sum(each["seconds"] for each in session.taken), 1),
        "commands": session.taken,
        "curve": curve.drop(columns="training_reward").to_dict("records"),
    }


def no_picture(page: Path, section: str, choice: str) -> bytes:
    """Refuse to draw: these pages show committed pictures alone."""
    raise InputError(f"{page}, {section}: the pages of agents take no picture from a page")


WALK = "train-an-agent"
"""The page whose commands are run."""
PAGES = ("agents", WALK)


def walk_template(study: Study) -> str:
    """Return the template of the walk, its training as long as those of the study where that says so."""
    text = TEMPLATES[WALK].read_text(encoding="utf-8")
    return text if study.timesteps is None else text.replace(str(STEPS), str(study.timesteps))


def page_texts(study: Study, results: Path) -> dict[str, str]:
    """Return the pages by their names."""
    walk = read_json(results / FILE, FORMAT, VERSION)
    texts = {}
    with tempfile.TemporaryDirectory() as folder:
        session = Recorded(Path(folder), walk)
        write_json(session.folder / "agents.json", page_facts(results))
        for name in PAGES:
            text = TEMPLATES[name].read_text(encoding="utf-8")
            template = walk_template(study) if name == WALK else text
            texts[name], _ = fill(template, session, no_picture)
    return texts
