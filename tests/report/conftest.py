"""Results that are made up, for the pages that show them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from rdpi_gym.diagnosis.results import Candidate, Errors, SearchResult, Step, View
from rdpi_gym.plant import P5

FLOOR_UM = 0.02
HUGE = Errors(float("inf"), float("inf"), float("inf"), {})


def made_errors(validation_um, names=("sine", "validation-stairs")):
    return Errors(0.9 * validation_um, validation_um, validation_um, dict.fromkeys(names, 0.1))


def made_candidate(effect, validation_um, **keywords):
    settings = {
        "errors": made_errors(validation_um),
        "parameters": {"gain_per_decade": 0.02} if effect == "creep" else {},
        "standard_errors": {"gain_per_decade": None} if effect == "creep" else {},
        "confidence": 0.99,
        "share": 0.9,
        "indistinguishable": (),
        "evidence": f"{effect} makes the loops of validation-stairs meet",
    }
    return Candidate(effect, **{**settings, **keywords})


def made_view(name="sine", role="train", labels=("base model", "with effects"), samples=600):
    t = np.arange(samples) * 1e-3
    u = 10.0 * np.sin(2 * np.pi * 5.0 * t)
    if name.endswith("stairs"):
        u = 10.0 * np.sign(u)
    y = 1.2 * u + FLOOR_UM * np.random.default_rng(1).standard_normal(samples)
    models = {label: (1.2 - 0.01 / (1 + 9 * i)) * u for i, label in enumerate(labels)}
    counted = np.ones(samples, dtype=bool)
    counted[:50] = False
    return View(name, role, t, u, y, models, counted)


@pytest.fixture
def made_discovery():
    """Build a discovery of creep, then of a resonance that may as well be a delay."""

    def build(**changes):
        creep = made_candidate("creep", 0.1)
        resonance = made_candidate("resonance", 0.021, indistinguishable=("delay",))
        runaway = made_candidate(
            "thermal_drift", 64.0, share=-3e5, confidence=0.0, remarks=("rate at its bound",)
        )
        failed = made_candidate(
            "backlash", 0.0, errors=HUGE, share=-np.inf, remarks=("did not converge",)
        )
        settings = {
            "kind": "discovery",
            "title": "a stage",
            "plant": P5,
            "steps": (Step((creep,)), Step((resonance,))),
            "rounds": (
                (creep, made_candidate("delay", 0.3, share=0.5), runaway, failed),
                (resonance, made_candidate("delay", 0.0211), runaway),
                (made_candidate("asymmetry", 0.021, share=0.0, confidence=0.1),),
            ),
            "removed": (),
            "noise_floor_um": FLOOR_UM,
            "noise_origin": "noise floor 0.02 µm rms, from a quiet record",
            "numerical_floor_um": 0.0,
            "base": made_errors(0.8),
            "final": made_errors(0.021),
            "given": made_errors(0.9),
            "verdict": "explained",
            "sampling": None,
            "undecided": None,
            "unexplained_rmse_um": 0.006,
            "remainder": "The residual is noise.",
            "next_experiment": "A multisine below the first threshold.",
            "indistinguishable": (("delay", "sensor_lag"), ("creep", "thermal_drift")),
            "checks": ("Holds creep.", "No hum.", "No hum."),
            "views": (made_view(), made_view("validation-stairs", "validation")),
            "seconds": 1.5,
            "notes": ("thresholds of Eq. 8 with 10 plays",),
        }
        return SearchResult(**{**settings, **changes})

    return build


@pytest.fixture
def made_diagnosis(made_discovery):
    """Build the first round of that discovery as a diagnosis."""

    def build(**changes):
        whole = made_discovery()
        settings = {
            "kind": "diagnosis",
            "steps": (Step(whole.rounds[0][:1]),),
            "rounds": whole.rounds[:1],
            "verdict": "unexplained",
            "final": made_errors(0.1),
            "views": (made_view(labels=("base model", "with creep")),),
            "notes": (),
        }
        return replace(whole, **{**settings, **changes})

    return build


@dataclass(frozen=True)
class MadeScores:
    """Scores for the benchmark's page, made up."""

    rows: tuple
    ranking: pd.DataFrame
    where_trained: dict
    by_case: pd.DataFrame
    by_sampling_time: pd.DataFrame
    measured: object
    notes: tuple
    order: list
    own: list
    answer: str = "Best: one."
    first_seed: int = 0
    shown_setting: tuple = ("P5", 1e-4)
    noise_um: Mapping[str, float] = field(default_factory=lambda: {"P5": 0.01, "picma": 0.01})


CONTROLLERS = (
    "pi-classical-reference-rate", "pi-inversion-free-reference-rate", "full-preview-inversion", "none",
    "classical-literal", "inversion-free-low-passed", "learned:ppo-increment", "my.package:Own",
)  # fmt: skip


@pytest.fixture
def made_benchmark():
    """Build a benchmark with every kind of column, figure and row."""

    def build(**changes):
        rng = np.random.default_rng(2)
        rmse = np.sort(rng.uniform(0.05, 4.0, len(CONTROLLERS)))
        ranking = pd.DataFrame(
            {
                "rank": ["1=", "1=", *map(str, range(3, len(rmse) + 1))],
                "controller": CONTROLLERS,
                "status": [
                    "ok",
                    "unstable in 300 of 530 rows, saturated, extrapolated",
                    *["ok"] * 6,
                ],
                "cautions": [
                    "ok",
                    "unstable in 300 of 530 rows, saturated, extrapolated",
                    *["ok"] * 6,
                ],
                "rmse_percent": rmse,
                "rmse_percent_low": 0.7 * rmse,
                "rmse_percent_high": 1.4 * rmse,
                "rmse_um": 0.1 * rmse,
                "optimality_gap": rmse / rmse[2],
                "optimality_gap_low": rmse / rmse[2],
                "optimality_gap_high": rmse / rmse[2],
                "seed_0_rmse_percent": 0.5 * rmse,
                "mean_rank": np.arange(1.0, len(rmse) + 1.0),
                "mean_rank_half_width": 1.0,
                "command_total_variation": 1.01,
                "microseconds_per_sample": 14.4,
                "rows": 530,
                "failed": 0,
                "warnings": ["", "extrapolated, saturated, unstable", *[""] * 6],
            }
        )
        cases = pd.DataFrame(
            [
                (name, plant, "sine", hz, 1e-4, rmse[i], 0.7 * rmse[i], 1.4 * rmse[i], 1.1, 0.1 * rmse[i])
                for i, name in enumerate(CONTROLLERS)
                for plant in ("P5", "picma")
                for hz in (1.0, 10.0, 100.0)
            ],
            columns=[
                "controller", "plant", "reference", "frequency_hz", "ts_s", "rmse_percent",
                "rmse_percent_low", "rmse_percent_high", "command_total_variation", "rmse_um",
            ],
        )  # fmt: skip
        cases["extrapolated"] = cases["plant"] == "picma"
        t = np.arange(400) * 1e-4
        lists = ("reference_um", "displacement_um", "error_um", "command_V")
        trace = {"step_s": 1e-4, **{key: np.sin(30.0 * t).tolist() for key in lists}}
        rows = tuple(
            {
                "controller": name, "plant": "P5", "reference": "sine", "frequency_hz": 10.0,
                "ts_s": 1e-4, "seed": 0, "trace": trace,
            }
            for name in CONTROLLERS
        )  # fmt: skip
        commands = {name: np.cos(t) for name in CONTROLLERS[:4]}
        measured = SimpleNamespace(
            table=pd.DataFrame({"controller": CONTROLLERS[:4], "rms_V": 0.1}),
            traces={"stairs": {"t_s": t, "applied": np.sin(t), **commands}},
            note="Records: stairs.",
        )
        settings = {
            "rows": rows,
            "ranking": ranking,
            "where_trained": {1e-4: ranking},
            "by_case": cases,
            "by_sampling_time": cases.drop(columns="extrapolated"),
            "measured": measured,
            "notes": ("Not run at Ts = 0.001 s on P5: sine 200 Hz.",),
            "order": list(CONTROLLERS),
            "own": ["my.package:Own"],
        }
        return MadeScores(**{**settings, **changes})

    return build
