"""What a verdict stands on: splits of the records, the numerical floor, tests that deny, openings."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.checks import run_checks
from rdpi_gym.diagnosis.results import Candidate, Errors
from rdpi_gym.diagnosis.search.candidates import Setting, refit
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.diagnosis.search.ranking import LEAST_STABLE, splits, stability
from rdpi_gym.diagnosis.search.record_clocks import (
    leaving_out,
    misleading,
    missed,
    unknown_past,
)
from rdpi_gym.diagnosis.search.rounds import MOST_UNSEEN, capped, hear
from rdpi_gym.diagnosis.search.verdict import numerical_floor
from rdpi_gym.diagnosis.suitability import comb
from rdpi_gym.identification.jacobian import Variant, simulate_between, simulate_effects
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record, hold_out_blocks
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE, load_effect
from rdpi_gym.report.discovery_text import lines
from rdpi_gym.virtual_lab import Truth, simulate_dataset
from tests.looping import over

NOISE_UM = 0.012
BARE = Variant(P10.hysteresis, ())
BENT = Variant(P10.hysteresis, (CATALOGUE["asymmetry"](0.02, 40.0),))


def record(name, variant, u, ts_s=1e-3, seed=0, role="train", t0=0.0):
    t = t0 + np.arange(u.size) * ts_s
    still = Record(name, t, u, np.zeros_like(u), ts_s=ts_s, role=role)
    noise = NOISE_UM * np.random.default_rng(seed).standard_normal(u.size)
    return replace(still, y_um=simulate_effects([variant], still)[:, 0] + noise)


def sine(amplitude_V, frequency_hz, samples=2000, ts_s=1e-3, phase=0.0):
    return amplitude_V * np.sin(2 * np.pi * frequency_hz * np.arange(samples) * ts_s + phase)


def setting_of(variant, seed=0):
    train = (
        record("one", variant, sine(40.0, 3.0), seed=seed),
        record("two", variant, sine(15.0, 7.0), seed=seed + 1),
    )
    validation = (record("three", variant, sine(30.0, 2.0), seed=seed + 2, role="validation"),)
    return Setting(train, validation, data_scale((*train, *validation)))


def test_splits_never_fit_what_they_judge():
    setting = setting_of(BARE)
    for split in splits(setting, quarters=False)[1:]:
        fitted = {r.name: r.error_mask for r in split.train}
        for held in split.validation:
            if held.name in fitted:
                assert not (fitted[held.name] & held.error_mask).any()
            assert held.error_mask.any()
    whole = setting.train[0]
    train, held = hold_out_blocks(whole)
    turns = splits(Setting((train,), (held,), setting.scale), quarters=True)[1:]
    assert len(turns) == 3
    for turn in turns:
        fit, judged = turn.train[0].error_mask, turn.validation[0].error_mask
        np.testing.assert_array_equal(fit ^ judged, whole.error_mask)
        assert judged.sum() == pytest.approx(whole.error_mask.sum() / 4, abs=1)


def quiet_report(done: int, total: int) -> None:
    assert 0 <= done < total


def test_an_effect_that_is_there_is_chosen_in_every_split_and_one_that_is_not_in_few():
    setting = setting_of(BENT)
    start = comb(setting.train)
    fit = refit(setting, start, (), CATALOGUE["asymmetry"])
    both = refit(setting, fit.fit.variant.hysteresis, fit.fit.variant.effects, CATALOGUE["creep"])
    found = stability(setting, both, {"asymmetry": (), "creep": ()}, False, 0, quiet_report)
    assert found["asymmetry"].confidence > 0.99
    assert found["asymmetry"].without_um > 5.0 * NOISE_UM
    assert found["creep"].confidence < 0.8
    assert found["creep"].without_um < 1.05 * NOISE_UM


def test_an_effect_is_as_sure_as_its_strongest_rival_leaves_it():
    setting = setting_of(BENT)
    fit = refit(setting, comb(setting.train), (), CATALOGUE["asymmetry"])
    (own,) = fit.fit.variant.effects
    idle = CATALOGUE["creep"](1e-9)
    for rivals in ((idle,), (own, idle)):  # one explains nothing, the other all that it does
        found = stability(setting, fit, {"asymmetry": rivals}, False, 0, quiet_report)
        confidence = found["asymmetry"].confidence
        assert confidence < 0.6 if own in rivals else confidence > 0.99, rivals


def test_the_numerical_floor_falls_with_the_square_of_the_sampling_time():
    mode = Variant(P10.hysteresis, (CATALOGUE["resonance"](60.0, 0.1),))
    slow, fast = (
        record("run", mode, sine(30.0, 9.0, n, ts), ts) for n, ts in ((1000, 2e-3), (4000, 5e-4))
    )
    floors = [numerical_floor(mode, [each]) for each in (slow, fast)]
    assert floors[0].step_um / floors[1].step_um == pytest.approx(16.0, rel=0.25)
    finer = simulate_between(mode, fast, 8) - simulate_effects([mode], fast)[:, 0]
    assert floors[1].step_um == pytest.approx(np.std(finer) * 64.0 / 63.0, rel=0.03)
    assert floors[0].needed_hz(0.01 * floors[0].total_um) > 500.0
    assert numerical_floor(BARE, [record("run", BARE, sine(30.0, 9.0))]).total_um == 0.0


def test_a_test_without_a_model_vetoes_what_it_denies():
    data = Dataset("symmetric", (record("one", BARE, sine(40.0, 5.0, 4000)),))
    checks = run_checks(data)
    denied = hear(data, checks, BENT, "asymmetry", NOISE_UM, 0)
    assert denied is not None
    assert "no asymmetry" in denied
    bent = Dataset("bent", (record("one", BENT, sine(40.0, 5.0, 4000)),))
    assert hear(bent, run_checks(bent), BENT, "asymmetry", NOISE_UM, 0) is None


def surely(effect):
    return Candidate(effect, Errors(1.0, 1.0, 1.0, {}), {}, {}, 0.98, 0.9, (), "")


def test_every_test_that_can_see_an_effect_is_one_that_is_run():
    checks = run_checks(simulate_dataset(Truth(P10, (), NOISE_UM, 3)))
    names = {check.name for check in checks}
    assert {name for kind in CATALOGUE.values() for name in kind.seen_by} <= names
    for check in checks:
        assert all(check.name in CATALOGUE[effect].seen_by for effect in check.suggests[:1])


def test_what_no_test_without_a_model_can_see_is_half_sure_at_most():
    data = Dataset("one sine", (record("one", BENT, sine(40.0, 5.0, 4000)),))
    checks = run_checks(data)
    # the test for asymmetry sees it; the others need experiments that are not there
    assert capped(surely("asymmetry"), checks, CATALOGUE) == surely("asymmetry")
    for effect in ("congruency", "backlash", "creep", "delay", "resonance"):
        found = capped(surely(effect), checks, CATALOGUE)
        assert found.confidence == MOST_UNSEEN >= LEAST_STABLE
        assert f"no test without a model sees {effect} here" in found.remarks[-1]
    unsure = replace(surely("congruency"), confidence=0.3)
    assert capped(unsure, checks, CATALOGUE) == unsure
    # an effect of one's own has no test that could be blind
    assert capped(surely("self_heating"), checks, CATALOGUE) == surely("self_heating")


def test_where_the_experiments_are_there_nothing_is_capped():
    checks = run_checks(simulate_dataset(Truth(P10, (), NOISE_UM, 3)))
    assert [e for e in CATALOGUE if capped(surely(e), checks, CATALOGUE) != surely(e)] == []


def test_a_cap_takes_no_effect_out():
    plant = Variant(P10.hysteresis, (CATALOGUE["congruency"](0.15, 40.0),))
    commands = {"one": sine(40.0, 3.0), "two": sine(15.0, 7.0) + 10.0, "three": sine(30.0, 2.0)}
    data = Dataset(
        "sines about two biases",
        tuple(
            record(name, plant, u, seed=k, role="validation" if name == "three" else "train")
            for k, (name, u) in enumerate(commands.items())
        ),
    )
    found = discover(data, catalogue={"congruency": CATALOGUE["congruency"]})
    assert [(c.effect, c.confidence) for c in found.added] == [("congruency", MOST_UNSEEN)]
    assert found.verdict == "explained"
    said = "\n".join(lines(found))
    assert "congruency: 98 % probable" in said
    assert "50 %" not in said
    assert "But: no test without a model sees congruency here: there are no" in said


def cut(whole, start):
    part = slice(start, None)
    return replace(
        whole, t_s=whole.t_s[part], u_V=whole.u_V[part], y_um=whole.y_um[part],
        error_mask=whole.error_mask[part],
    )  # fmt: skip


def begun_about(starts, effects=(), lasting=400):
    past = (load_effect("initial_memory", "about the start")(reach_V=70.0, ratio=0.4),)
    t = np.arange(3000)
    pair = [
        record(name, replace(BARE, effects=(*past, *effects)), u0 + 30.0 * np.sin(t / 60.0))
        for name, u0 in zip("ab", starts, strict=True)
    ]
    return pair, {r.name: np.arange(r.u_V.size) < lasting for r in pair}


@over("lasting", [400, 1700])
def test_a_memory_that_spoils_a_part_of_an_opening_is_seen_however_long_it_is(lasting):
    pair, openings = begun_about((0.0, 25.0), lasting=lasting)
    setting = Setting((pair[0],), (pair[1],), data_scale(pair))
    bare = refit(setting, comb(setting.train), (), None)
    assert missed(setting, bare, openings, NOISE_UM)
    told = refit(setting, comb(setting.train), (), load_effect("initial_memory", "about the start"))
    assert not missed(setting, told, openings, NOISE_UM)
    assert misleading(setting, bare, openings, NOISE_UM) == {}


def test_an_opening_of_unknown_history_is_left_out_and_one_that_is_known_is_not():
    known, unknown = [], []
    for name, reach in (("up", 40.0), ("down", -40.0)):
        past = np.concatenate([np.linspace(0.0, reach, 200), np.linspace(reach, 0.0, 200)])
        whole = record(name, BARE, np.concatenate([past, sine(30.0, 2.0, 3000)]))
        known.append(whole)
        unknown.append(cut(whole, 400))
    for pair, is_bad in ((known, False), (unknown, True)):
        parts = [hold_out_blocks(r) for r in pair]
        setting = Setting(
            tuple(fit for fit, _ in parts), tuple(held for _, held in parts), data_scale(pair)
        )
        outcome = refit(setting, comb(setting.train), (), None)
        openings = {r.name: np.arange(r.u_V.size) < 400 for r in pair}
        bad = misleading(setting, outcome, openings, NOISE_UM)
        assert bool(bad) is is_bad
        if bad:
            spared = leaving_out(setting, bad)
            assert not any(r.error_mask[:400].any() for r in spared.train if r.name in bad)
            assert "their history was not recorded" in unknown_past(bad).sentence
