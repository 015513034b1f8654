"""Results of the laboratory that are made up, for the pages that show them."""

from dataclasses import replace

import numpy as np
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
            "base": made_errors(0.8),
            "given": made_errors(0.9),
            "verdict": "explained",
            "unexplained_rmse_um": 0.006,
            "remainder": "What is left is the noise.",
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
            "views": (made_view(labels=("base model", "with creep")),),
            "notes": (),
        }
        return replace(whole, **{**settings, **changes})

    return build
