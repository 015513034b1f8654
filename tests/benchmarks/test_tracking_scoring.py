"""Scores, cases, truths and the ranking of the tracking benchmark."""

import itertools
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import studies
from benchmarks.tracking.case import FEWEST_SAMPLES, Case
from benchmarks.tracking.episode import one_line, score, status, words
from benchmarks.tracking.evaluation import CASE, COLUMNS, interval, ranking, score_table
from benchmarks.tracking.references.standard import SINE_HZ
from benchmarks.tracking.stages import REFERENCES, SPREAD, cases, make_stage, truth
from rdpi_gym.plant import P5, P10, RDPI, PlantModel, Sensor, named_plant
from rdpi_gym.plant.effects.creep import Creep
from tests.looping import over

TRACKING = Path(studies.__file__).parent / "results" / "tracking"
ALL = cases(REFERENCES, amplitude_um=10.0, base_hz=10.0)
BOUND = "full-preview-inversion"
STILL = [0.0] * 5


def scored(error=STILL, command=STILL, action=STILL):
    reference = np.array([0.0, -1.0, 3.0, -1.0, 3.0])
    return score(
        reference, reference + error, np.array(command), np.array(action), first=1, ts_s=0.1
    )


def test_errors_variation_and_saturation_of_the_scored_samples():
    s = scored([100.0, 1.0, -1.0, 1.0, -3.0])  # the first sample does not count
    assert (s.rmse_um, s.max_um) == (pytest.approx(np.sqrt(12 / 4)), 3.0)
    s = scored([0.0, 2.0, 2.0, 2.0, 2.0])  # percent of the peak to peak
    assert (s.rmse_percent, s.max_percent) == pytest.approx((50.0, 50.0))
    s = scored(command=[0.0, 2.0, 1.0, 1.0, 1.5])  # per second, with the step into the window
    assert s.command_variation_V_s == pytest.approx((2 + 1 + 0 + 0.5) / 0.4)
    assert s.max_command_step_V == 2.0
    s = scored(action=[1.0, 0.99, 1.0, -1.7, 0.0])  # at or beyond the ends
    assert s.saturated_percent == 50.0


def test_an_error_above_that_of_standing_still_is_divergence():
    r = np.sin(np.arange(628) / 100.0)
    still = np.zeros(r.size)
    for times, diverged in ((0.99, False), (1.01, True)):
        s = score(r, r + times * np.std(r), still, still, first=1, ts_s=0.1)
        text = status(s, r, warning=None, ts_s=0.1, identified_V_s=None)
        assert ("diverged" in words([text])) is diverged


def test_status_joins_short_words_with_their_sentences():
    s = scored([0.0, 9.0, 9.0, 9.0, 9.0], [0.0, 5.0, 0.0, 0.0, 0.0], action=np.ones(5))
    warning, r = "outside its stability limit; see\nEq. 6", np.array([-1.0, 3.0, -1.0, 3.0])
    text = status(s, r, warning=warning, ts_s=0.1, identified_V_s=12.0)
    assert words([text]) == {"unstable", "diverged", "saturated", "extrapolated"}
    assert text.startswith("unstable: outside its stability limit, see Eq. 6; diverged: ")
    assert "up to 50 V/s" in text
    assert "\n" not in text
    assert len(one_line("x" * 1000)) == 200


@over("ts_s, case", product([5e-5, 2e-4, 1e-3], ALL))
def test_references_begin_at_rest_and_are_scored_over_whole_periods(case: Case, ts_s: float):
    first, end = case.window(ts_s)
    r = case.samples(ts_s, centre_um=4.0, rest_um=-7.0, seed=3)
    assert (r[0], len(r)) == (-7.0, end)
    assert (end - first) * ts_s == pytest.approx(case.periods * case.period_s, abs=ts_s)
    if case.fits(ts_s) and case.reference == "sine" and (case.period_s / ts_s).is_integer():
        assert r[first:].mean() == pytest.approx(4.0, abs=1e-6)
        assert np.ptp(r[first:]) == pytest.approx(20.0, rel=2e-2)


def test_the_suite_holds_the_references_of_the_leaderboard_where_a_period_is_resolved():
    assert [case.frequency_hz for case in ALL if case.reference == "sine"] == list(SINE_HZ)
    assert {case.reference for case in ALL} == set(REFERENCES)
    sine = next(case for case in ALL if case.frequency_hz == 50.0)
    assert sine.fits(1.0 / 50.0 / FEWEST_SAMPLES)
    assert not sine.fits(1.01 / 50.0 / FEWEST_SAMPLES)


@given(seed=st.integers(1, 10_000))
def test_drawn_truths_are_within_the_spread_of_the_belief(seed: int):
    nominal, drawn = P10.hysteresis, truth(P10, seed).hysteresis
    gaps = [np.diff([0.0, *model.thresholds_V]) for model in (nominal, drawn)]
    ratios = [
        np.array(drawn.weights) / nominal.weights, gaps[1] / gaps[0],
        np.array([drawn.delta2_s / nominal.delta2_s]),
    ]  # fmt: skip
    assert np.all(np.abs(np.concatenate(ratios) - 1.0) <= SPREAD + 1e-12)
    assert drawn != nominal
    assert truth(P5, 0) is P5


def test_scoring_plants_are_band_limited_and_noisy_unless_they_state_it():
    literal = make_stage(P5).plant
    assert (literal.hysteresis.rate_bandwidth_hz, literal.sensor.noise_um) == (800.0, 0.010)
    slow = PlantModel(
        P5.hysteresis.band_limited(300.0), "slow", (-25, 25), (0, 10), sensor=Sensor(noise_um=0.2)
    )
    assert make_stage(slow).plant == slow


def test_controllers_are_told_nothing_of_the_effects_but_the_extended_inverse():
    lagging = replace(P5, effects=(Creep(gain_per_decade=0.02),))
    stage = make_stage(lagging)
    assert stage.belief == stage.plant
    assert truth(stage.plant, 1).effects == lagging.effects


def test_what_was_identified_at_low_rates_gets_slow_references_and_covers_no_fast_ones():
    model = RDPI.from_law([10.0, 2.0], 0.2, 0.0)
    known = {"fastest_peak_rate_V_s": 12.0}
    stage = make_stage(PlantModel(model, "slow", (0.0, 4.0), (20.0, 15.0), identification=known))
    assert stage.base_hz == 1.0
    assert min(stage.ts_s) >= 1e-3
    # sines of 10 µm: 2π f 10 µm / A, so 51.6 V/s at 1 Hz and 516 V/s at 10 Hz
    slow = make_stage(replace(P5, identification={"fastest_peak_rate_V_s": 60.0}))
    covered = [c.name for c in slow.cases(("sine", "steps"), 1e-3) if slow.covers(c, 1e-3)]
    assert covered == ["sine 1 Hz"]
    assert all(make_stage(P5).covers(case, 1e-3) for case in make_stage(P5).cases(REFERENCES, 1e-3))


def row(controller, rmse, seed=0, reference="sine", variation=10.0):
    numbers = {} if rmse is None else {
        "rmse_um": rmse, "rmse_percent": 10 * rmse, "max_um": rmse, "max_percent": 10 * rmse,
        "command_variation_V_s": variation, "max_command_step_V": 1.0, "saturated_percent": 0.0,
        "microseconds_per_sample": 10.0,
    }  # fmt: skip
    return {
        "controller": controller, "plant": "P5", "belief": "P5", "reference": reference,
        "frequency_hz": 1.0, "ts_s": 1e-3, "seed": seed, **numbers,
        "status": "ok" if numbers else "error: ValueError: no",
    }  # fmt: skip


def ranked(rows):
    return ranking(score_table(list(rows))).set_index("controller")


def test_gap_and_variation_are_relative_to_the_bound_of_the_same_seed():
    rows = [row("a", 3.0, variation=20.0), row("a", 4.0, 1), row(BOUND, 1.0), row(BOUND, 8.0, 1)]
    table = score_table(rows)
    assert tuple(table.columns) == COLUMNS
    assert table["optimality_gap"].tolist() == [3.0, 0.5, 1.0, 1.0]
    assert table["command_total_variation"].tolist() == [2.0, 1.0, 1.0, 1.0]


def test_interval_is_students():
    mean, half = interval(np.array([1.0, 2.0, 4.0, 5.0]))
    # t(3, 0.975) = 3.18245; standard deviation 1.82574
    assert (mean, half) == pytest.approx((3.0, 3.182446 * 1.825742 / 2.0), rel=1e-6)
    assert np.isnan(interval(np.array([1.0]))[1])


def test_ranking_is_by_the_geometric_mean_over_drawn_seeds():
    errors = {BOUND: (1.0, 1.0), "even": (2.0, 2.0), "uneven": (1.0, 9.0)}
    found = ranked(
        row(name, rmse, seed, reference)
        for seed in (0, 1, 2)
        for name, each in errors.items()
        for reference, rmse in zip(("sine", "steps"), each, strict=True)
    )
    assert found.index.tolist() == [BOUND, "even", "uneven"]
    assert found["optimality_gap"].tolist() == pytest.approx([1.0, 2.0, 3.0])
    assert found.loc["uneven", "rmse_percent"] == pytest.approx(30.0)
    assert found.loc["even", "mean_rank"] == found.loc["uneven", "mean_rank"] == 1.5
    assert pd.isna(found.loc[BOUND, "mean_rank"])
    # seed 0 does not enter the mean where others were drawn
    rows = [row(BOUND, 1.0, seed) for seed in (0, 1, 2)]
    rows += [row("a", rmse, seed) for seed, rmse in enumerate((0.001, 2.0, 2.0))]
    found = ranked(rows)
    assert found.loc["a", "rmse_percent"] == pytest.approx(20.0)
    assert found.loc["a", "seed_0_rmse_percent"] == pytest.approx(0.01)


def test_a_row_with_an_error_takes_the_mean_away_and_ranks_last():
    errors = {BOUND: (1.0, 1.0), "good": (5.0, 5.0), "bad": (0.1, None)}
    found = ranked(
        row(name, rmse, reference=reference)
        for name, each in errors.items()
        for reference, rmse in zip(("sine", "steps"), each, strict=True)
    )
    assert found.index.tolist() == list(errors)
    assert pd.isna(found.loc["bad", "rmse_percent"])
    assert found.loc["bad", "errors"] == 1
    assert found.loc["bad", ["rank", "status"]].tolist() == ["–", "error 1/2"]
    assert found.loc["bad", "mean_rank"] == pytest.approx(1.5)


TIES = [  # RMSE (µm) of each controller on four drawn seeds, its rank and places
    {
        BOUND: ([0.1, 0.1, 0.1, 0.1], "bound", "–"),
        # every seed has its own level: only the paired difference tells them apart
        "best": ([1.0, 2.0, 4.0, 8.0], "1=", "1 to 2"),
        "as-good": ([1.1, 1.9, 4.2, 7.9], "1=", "1 to 2"),
        "worse": ([1.5, 3.0, 6.1, 12.0], "3", "3"),
        "worst": ([50.0, 60.0, 55.0, 51.0], "4", "4"),
        "broken": ([1.0, 1.0, 1.0, None], "–", "–"),
    },
    {  # a chain of ties is no tie of its ends
        "a": ([1.00, 1.00, 1.00, 1.00], "1=", "1 to 2"),
        "b": ([0.90, 1.30, 1.00, 1.20], "1=", "1 to 3"),
        "c": ([1.20, 1.21, 1.19, 1.20], "2", "2 to 3"),
    },
]


@over("case", TIES)
def test_a_rank_is_one_more_than_the_number_of_better_ones(case):
    found = ranked(
        row(name, rmse, seed)
        for name, (errors, *_) in case.items()
        for seed, rmse in enumerate(errors, start=1)
    )
    assert found["rank"].to_dict() == {name: rank for name, (_, rank, _) in case.items()}
    assert found["places"].to_dict() == {name: places for name, (*_, places) in case.items()}


def test_ranks_of_the_committed_leaderboard_count_who_is_better():
    table = pd.read_csv(TRACKING / "leaderboard.csv")
    rankings = pd.read_csv(TRACKING / "ranking.csv")
    main = rankings[rankings["ts_s"].isna() & ~rankings["rank"].isin(["bound", "–"])]
    ranks = main.set_index("controller")["rank"]
    stages = {plant: make_stage(named_plant(plant)) for plant in ("P5", "P10", "picma")}
    covered = {
        (plant, case.reference, case.frequency_hz, ts)
        for plant, stage in stages.items()
        for ts in stage.ts_s
        for case in stage.cases(REFERENCES, ts)
        if stage.covers(case, ts)
    }
    kept = [case in covered for case in table[CASE].itertuples(index=False, name=None)]
    drawn = table[kept].query("seed > 0 and controller in @ranks.index")
    assert len(drawn) == len(covered) * 4 * len(ranks)
    logs = np.log(drawn["rmse_percent"]).groupby([drawn["seed"], drawn["controller"]]).mean()
    logs = logs.unstack()
    better = dict.fromkeys(ranks.index, 0)
    for a, b in itertools.permutations(ranks.index, 2):
        better[a] += stats.ttest_rel(logs[a], logs[b]).confidence_interval().low > 0.0
    assert ranks.str.rstrip("=").astype(int).to_dict() == {n: 1 + k for n, k in better.items()}
    shared = ranks[ranks.duplicated(keep=False)]
    assert shared.str.endswith("=").all()
    assert not ranks.drop(shared.index).str.endswith("=").any()
