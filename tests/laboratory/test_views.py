"""Numbers for the page: no peak is lost, no number has more digits than a screen, cards in order."""

from dataclasses import replace

import numpy as np
import pytest

import rdpi_gym as rg
from rdpi_gym.diagnosis import suitability
from rdpi_gym.diagnosis.beam import evidence
from rdpi_gym.face import search
from rdpi_gym.laboratory import jobs, views
from rdpi_gym.laboratory.session import Ranking, refit_of, result_of
from rdpi_gym.laboratory.work import Tell
from rdpi_gym.measurement import Quantities, Quantity, Record
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.effects import CATALOGUE

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


def test_cards_state_the_errors_of_terminal_file_and_comparison(monkeypatch):
    for module, name in ((suitability, "SEARCH_MOST"), (evidence, "READ_SAMPLES")):
        monkeypatch.setattr(module, name, 1_000)  # as with 50 times as many samples
    monkeypatch.setattr(suitability, "_FEWEST", 250)
    few = {name: CATALOGUE[name] for name in ("creep", "delay")}
    monkeypatch.setattr(search, "CATALOGUE", few)
    data = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)
    data = data.select("stairs", "validation-stairs", "quiet")
    told = []
    result = result_of(jobs.rank(Tell(told.append), data, rg.plants["P5"], None, 1))
    heard = [refit_of(message[2]) for message in told if message[0] == "news"]
    refits = {(refit["effect"], refit["form"]): refit for refit in heard}
    base, noise = refits["", ""], result["noise_floor"]
    made = {c["effect"]: c for c in views.cards(
        Ranking("s1", "done", refits, result), base["validation_um"], noise, RDPI, set(), {}
    )}  # fmt: skip
    assert any("the search read a stretch" in line for line in result["lines"])
    for candidate in result["candidates"]:
        card = made[candidate["effect"]]
        assert card["validation_um"] == pytest.approx(candidate["validation_rmse"], rel=1e-9)
        assert card["share"] == pytest.approx(candidate["share_of_excess"], rel=1e-6, abs=1e-9)
        if card["state"] == "final":
            model = Ranking("s1", "done", refits, result).plant_with(candidate["effect"])
            compared = rg.compare(data, model).rmse_um("validation")
            assert card["validation_um"] == pytest.approx(compared, rel=1e-6)
    (chosen,) = result["chosen"]
    after = made[chosen]["validation_um"]
    assert after == pytest.approx(result["final"]["validation_rmse"], rel=1e-9)
    assert f" {base['validation_um']:.3g} to {after:.3g} µm" in result["headline"]
