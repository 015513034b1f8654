"""Numbers for the page: no peak is lost, no number has more digits than a screen, cards in order."""

from dataclasses import replace

import numpy as np
import pytest

import rdpi_gym as rg
from rdpi_gym.laboratory import views
from rdpi_gym.laboratory.session import Ranking
from rdpi_gym.measurement import Quantities, Quantity, Record
from rdpi_gym.plant import RDPI

T = 50_000


@pytest.fixture(scope="module")
def record():
    t_s = np.arange(T) * 1e-3
    u_V = np.sin(t_s)
    y_um = 2.0 * u_V
    y_um[33_333] = 9.0
    mask = np.ones(T, dtype=bool)
    mask[:1000] = mask[2000:2500] = False
    return Record("run", t_s, u_V, y_um, ts_s=1e-3, error_mask=mask)


def test_a_thinned_trace_keeps_the_peak_and_a_close_look_every_sample(record):
    whole = views.trace(record, 2.0 * record.u_V, None, views.stretch(record, None, None))
    assert len(whole["t_s"]) <= 1.1 * views.POINTS
    assert (max(whole["y_um"]), max(whole["residual_um"])) == (9.0, pytest.approx(9.0, abs=2.1))
    assert whole["counted"] == [[0.0, 0.999], [2.0, 2.499]]
    near = views.trace(record, None, None, views.stretch(record, 33.3, 33.4))
    assert near["t_s"] == pytest.approx(np.arange(33_299, 33_402) * 1e-3)
    assert near["model_um"] is None


def test_a_stretch_outside_the_record_is_its_end(record):
    assert views.stretch(record, 1e9, 2e9) == slice(T - 2, T)
    assert views.stretch(record, -5.0, -1.0) == slice(0, 2)


def test_a_record_that_there_is_not_is_named_with_those_there_are(record):
    data = rg.Dataset("data", (record,))
    with pytest.raises(rg.InputError, match="there is no record 'rum'; there are run"):
        views.record_named(data, "rum")


def refit(effect, um, form="", plant=True):
    return {
        "effect": effect, "form": form, "validation_um": um, "train_um": um, "at_bound": [],
        "plant": {} if plant else None, "parameters": {}, "standard_errors": {}, "remark": "",
    }  # fmt: skip


def cards(*refits, **ranking):
    tried = {(r["effect"], r["form"]): r for r in refits}
    found = views.cards(Ranking("s1", refits=tried, **ranking), 1.0, 0.6, RDPI, {"delay"}, {})
    return {card["effect"]: card for card in found}


def test_cards_stand_in_the_order_of_what_they_leave_until_the_ranking_is_there():
    running = cards(refit("creep", 0.8), refit("creep", 0.6, "spectrum"), refit("backlash", 0.7),
                    refit("resonance", None, plant=False))  # fmt: skip
    assert list(running)[:2] == ["creep", "backlash"]
    assert (running["creep"]["form"], running["creep"]["state"]) == ("spectrum", "tried")
    assert running["creep"]["share"] == pytest.approx(1.0)  # all that exceeds the noise
    assert running["resonance"]["state"] == "failed"
    assert "delay" not in running  # the model has it
    assert [c["state"] for c in running.values()].count("refitting") == 2
    said = {
        "share_of_excess": 0.5,
        "confidence": 0.9,
        "indistinguishable": ["creep"],
        "remarks": [],
    }
    candidates = [
        {"effect": "backlash", "form": "", **said},
        {"effect": "creep", "form": "", **said},
    ]
    done = cards(refit("creep", 0.8), refit("creep", 0.6, "spectrum"), refit("backlash", 0.7),
                 status="done", result={"candidates": candidates, "chosen": ["backlash"]})  # fmt: skip
    assert list(done)[:2] == ["backlash", "creep"]
    assert (done["backlash"]["state"], done["backlash"]["recommended"]) == ("final", True)
    assert (done["creep"]["form"], done["creep"]["validation_um"]) == ("", 0.8)
    assert (done["creep"]["rivals"], done["creep"]["confidence"]) == (["creep"], 0.9)


def test_a_slider_holds_the_value_and_stays_physical():
    plant = rg.plants["P10"]
    (core,) = views.model_of(plant, ["delta2_s"])["core_parameters"]
    assert core["low"] <= core["value"] <= core["high"]
    assert (core["symbol"], core["held"], core["standard_error"]) == ("δ2", True, None)


def test_units_are_those_of_the_data():
    damper = Quantities(Quantity("displacement", "x", "mm"), Quantity("force", "F", "kN"))
    plant = replace(rg.plants["P5"], effects=(rg.effects["backlash"](),))
    (backlash,) = views.model_of(plant, [], damper.said)["effects"]
    assert [p["unit"] for p in backlash["parameters"]] == ["kN"]
