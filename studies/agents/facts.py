"""Numbers, tables and findings on the pages on agents, all from committed results."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from baselines import GUARDED, LEARNED
from rdpi_gym.plant import P10
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.words import number
from studies.agents import findings
from studies.agents.curves import cost_view, training_costs
from studies.agents.tables import ALL_GROUPS
from studies.agents.tasks import leaders, read_rankings, standing, standing_view
from studies.student_seeds import RESULTS as STUDENTS
from studies.student_seeds import RIVAL
from studies.training_race import FIRST, SHORT, best_fixed, by_entrant
from studies.training_race import RESULTS as RACE

FORMAT, VERSION = "walk", 1
FILE = "walk.json"
HYPERPARAMETERS = Path(__file__).parents[2] / "baselines" / "learned" / "hyperparameters"
HISTORY = "rdpi_gym.envs.wrappers.history.HistoryObservation"
_MADE_BY = {"summary": "score", "gap": "gap", "curves": "curves", "shipped": "ship"}
_SHOWN_ROWS = (0, 1, 2, 3, 5, 8, 12, 16)


def page_facts(results: Path) -> dict[str, Any]:
    """Return all that the pages quote."""
    summary, gap, curves, shipped = (
        _read(results, name) for name in ("summary", "gap", "curves", "shipped")
    )
    walk = read_json(results / FILE, FORMAT, VERSION)
    costs = training_costs(curves)
    groups = summary[summary["world"] != ALL_GROUPS]
    rankings = read_rankings()
    on_tasks = leaders(rankings)
    guarded = rankings[rankings["controller"].str.startswith(GUARDED)]
    student = rankings[rankings["controller"] == f"{LEARNED}imitation-stage"]
    worst = student[student["failed"] < 1.0].nlargest(1, "failed").iloc[0]
    reacting = leaders(rankings[~rankings["controller"].str.contains(":imitation")])
    return {
        "format": "agents",
        "version": 1,
        "zero_rad_s": P10.hysteresis.zero_rad_s,
        "default_steps": {
            name: f"{_yaml(name)['n_timesteps']:,}" for name in ("ppo", "sac", "td3")
        },
        "lanes": _yaml("ppo")["n_envs"],
        "history": _yaml("ppo")["env_wrapper"][0][HISTORY]["history"],
        "trainings": len(curves[["agent", "seed"]].drop_duplicates()),
        "plants": int(groups["plants"].max()),
        "shipped_kib": float(shipped["policy_bytes"].sum()) / 1024.0,
        "sac_over_ppo": findings.times_between(shipped, "sac", "ppo"),
        "walk": _walk(walk),
        "tasks": standing(on_tasks),
        "race": _race(rankings),
        "students": _students(),
        "guarded_failures": float(guarded["failed"].max()),
        "unguarded": {"task": str(worst["task"]), "percent": 100.0 * float(worst["failed"])},
        "student_us": float(student["microseconds_per_sample"].min()),
        "reacting_ahead": standing(reacting)["tasks_ahead"],
        "verdicts": {world: findings.verdict(leader) for world, leader in findings.leaders(groups)},
        "best_kinds": {
            str(world): findings.best_kind(part) for world, part in groups.groupby("world")
        },
        "unstable": {
            str(world): findings.unstable(part) for world, part in groups.groupby("world")
        },
        "tables": {
            "curve": frame_table(_curve_view(pd.DataFrame(walk["curve"]))),
            "groups": frame_table(findings.groups_view(groups)),
            "tasks": frame_table(standing_view(on_tasks)),
            "gap": frame_table(findings.gap_view(gap)),
            "costs": frame_table(cost_view(costs)),
            "shipped": frame_table(findings.shipped_view(shipped)),
        },
        "findings": {
            "standing": findings.standing(groups),
            "dither": findings.dither(gap),
        },
    }


def _race(rankings: pd.DataFrame) -> dict[str, Any]:
    table = _of_study(RACE / "race.csv", "training_race")
    lines = by_entrant(table)
    return lines[SHORT] | {
        "rival": best_fixed(rankings)["controller"],
        "first_seconds": lines[FIRST]["seconds"],
    }


def _students() -> dict[str, Any]:
    table = _of_study(STUDENTS / "student_seeds.csv", "student_seeds")
    own = table[table["student"] != RIVAL]
    shares = own.groupby("task")["over_rival"]
    return {
        "seeds": int(own.groupby("task").size().min()),
        "last_over_best": float(own["last_over_best"].max()),
        **{str(task): f"{number(part.min())} to {number(part.max())}" for task, part in shares},
    }


def _of_study(path: Path, name: str) -> pd.DataFrame:
    if not path.exists():
        raise InputError(f"{path} is missing; run python -m studies.{name}")
    return pd.read_csv(path)


def _read(results: Path, name: str) -> pd.DataFrame:
    path = results / f"{name}.csv"
    if not path.exists():
        raise InputError(f"{path} is missing; run --stage {_MADE_BY[name]}")
    return pd.read_csv(path)


def _yaml(algorithm: str) -> dict[str, Any]:
    text = (HYPERPARAMETERS / f"{algorithm}.yml").read_text(encoding="utf-8")
    values: dict[str, Any] = yaml.safe_load(text)["default"]
    return values


def _walk(walk: dict[str, Any]) -> dict[str, Any]:
    best = max(walk["curve"], key=lambda row: row["reward"])
    return {
        "minutes": walk["seconds"] / 60.0,
        "cores": walk["cores"],
        "training_seconds": walk["commands"][0]["seconds"],
        "rmse_um": best["rmse_um"],
        "compensator_rmse_um": best["compensator_rmse_um"],
        "rmse_ratio": best["rmse_um"] / best["compensator_rmse_um"],
        "untrained_rmse_um": walk["curve"][0]["rmse_um"],
        "crossing": next(
            (f"{row['timesteps']:,}" for row in walk["curve"] if _is_below(row)), "no"
        ),
    }


def _is_below(row: dict[str, Any]) -> bool:
    return bool(row["rmse_um"] < row["compensator_rmse_um"])


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
