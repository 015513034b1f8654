"""A beam ends in the result that terminal, page, laboratory and files read, with the moves offered alone."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.diagnosis.search.discover import add_effect, diagnose, discover, remove_effect
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P10, Plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.errors import InputError

TS_S = 2e-3
FEW = {name: CATALOGUE[name] for name in ("creep", "backlash")}
LAG = CATALOGUE["sensor_lag"](time_constant_s=5e-3)


@pytest.fixture(scope="module")
def crept():
    """Two records of steps with creep and noise of 10 nm."""
    creep = CATALOGUE["creep"].forms[0](gain=0.05, time_constant_s=0.3)
    plant = replace(P10, effects=(creep,))
    records = []
    for k, role in enumerate(("train", "validation")):
        rng = np.random.default_rng(k)
        levels = np.repeat(40.0 * rng.uniform(-1.0, 1.0, 20), 60)
        u = np.convolve(np.r_[np.zeros(60), levels], np.full(15, 1.0 / 15))[: levels.size]
        y = Plant(plant, TS_S).simulate(u) + 0.01 * rng.normal(size=u.size)
        records.append(Record(f"steps-{k}", np.arange(u.size) * TS_S, u, y, ts_s=TS_S, role=role))
    return Dataset("creep is hidden", tuple(records))


@pytest.fixture(scope="module")
def found(crept):
    return discover(crept, replace(P10, effects=(LAG,)), catalogue=FEW)


def test_a_given_model_keeps_its_core_and_effects_and_gets_what_is_offered(found):
    assert [c.effect for c in found.added] == ["creep"]
    assert {e.name for e in found.plant.effects} == {"creep", "sensor_lag"}
    assert (found.plant.hysteresis.name, found.verdict) == ("rdpi", "explained")
    assert set(found.probabilities.effects) <= {*FEW, "sensor_lag"}
    assert found.plant.effects[-1].values["time_constant_s"] < 1e-3  # refitted: there is no lag


def test_the_last_step_ends_at_the_model_that_is_saved_and_the_file_is_read_again(found, tmp_path):
    assert found.steps[-1].errors == found.final
    assert found.final.validation_rmse_um == pytest.approx(0.01, rel=0.1)
    assert found.stated["creep"].share > 0.99
    again = SearchResult.load(found.save(tmp_path / "found.json"))
    assert again == replace(found, views=())


def test_each_effect_is_ranked_alone_and_whoever_watches_is_told_of_all(crept):
    seen = []
    ranked = diagnose(crept, catalogue=FEW, core="rdpi", on_candidate=seen.append)
    assert [c.effect for c in ranked.ranking] == ["creep", "backlash"]
    assert (ranked.plant.hysteresis.name, ranked.verdict) == ("rdpi", "explained")
    assert seen[0].effect == ""
    assert {refit.effect for refit in seen[1:]} == set(FEW)


def test_an_effect_is_added_and_taken_out_on_request(crept):
    added = add_effect(crept, CATALOGUE["creep"], P10)
    assert [e.name for e in added.plant.effects] == ["creep"]
    taken = remove_effect(
        crept, replace(added.plant, effects=(*added.plant.effects, LAG)), LAG.name
    )
    assert ([e.name for e in taken.plant.effects], taken.removed) == (["creep"], (LAG.name,))
    with pytest.raises(InputError, match="has creep already"):
        add_effect(crept, CATALOGUE["creep"], added.plant)


@pytest.mark.parametrize("stages", [1, 2])
def test_an_interrupted_search_goes_on_from_its_last_stage_to_the_same_result(
    crept, tmp_path, stages
):
    path = tmp_path / "candidates.jsonl"
    whole = discover(crept, catalogue=FEW, checkpoint=path)
    first = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(first[: stages + 1]))  # the first line is that of the format
    again = discover(crept, catalogue=FEW, checkpoint=path)
    left_out = {"seconds": 0.0, "views": ()}
    assert replace(again, **left_out) == replace(whole, **left_out)
    assert len(path.read_bytes().splitlines()) == len(first)
