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


def scored(error, command, action=None, first=1, ts_s=0.1):
    reference = np.array([0.0, -1.0, 3.0, -1.0, 3.0])
    action = np.zeros(5) if action is None else np.asarray(action)
    return score(
        reference,
        reference + np.asarray(error),
        np.asarray(command),
        action,
        first=first,
        ts_s=ts_s,
    )


def test_error_is_counted_from_the_first_scored_sample_on():
    s = scored([100.0, 1.0, -1.0, 1.0, -3.0], np.zeros(5))
    assert s.rmse_um == pytest.approx(np.sqrt(12 / 4))
    assert s.max_um == 3.0


def test_percent_is_of_the_peak_to_peak():
    s = scored([0.0, 2.0, 2.0, 2.0, 2.0], np.zeros(5))
    assert (s.rmse_percent, s.max_percent) == pytest.approx((50.0, 50.0))


def test_variation_is_per_second_and_counts_the_step_into_the_window():
    s = scored(np.zeros(5), [0.0, 2.0, 1.0, 1.0, 1.5], ts_s=0.1)
    assert s.command_variation_V_s == pytest.approx((2 + 1 + 0 + 0.5) / 0.4)
    assert s.max_command_step_V == 2.0


def test_an_error_above_that_of_standing_still_is_divergence():
    reference = np.sin(np.arange(628) / 100.0)
    for times, diverged in ((0.99, False), (1.01, True)):
        command = np.zeros(reference.size)
        s = score(
            reference, reference + times * np.std(reference), command, command, first=1, ts_s=0.1
        )
        said = status(s, reference, warning=None, ts_s=0.1, identified_V_s=None)
        assert ("diverged" in words([said])) is diverged


def test_saturation_counts_actions_at_or_beyond_the_ends():
    s = scored(np.zeros(5), np.zeros(5), action=[1.0, 0.99, 1.0, -1.7, 0.0])
    assert s.saturated_percent == 50.0


def test_status_joins_short_words_with_their_sentences():
    s = scored([0.0, 9.0, 9.0, 9.0, 9.0], [0.0, 5.0, 0.0, 0.0, 0.0], action=np.ones(5))
    said = status(
        s,
        np.array([-1.0, 3.0, -1.0, 3.0]),
        warning="outside its stability limit; see\nEq. 6",
        ts_s=0.1,
        identified_V_s=12.0,
    )
    assert words([said]) == {"unstable", "diverged", "saturated", "extrapolated"}
    assert said.startswith("unstable: outside its stability limit, see Eq. 6; diverged: ")
    assert "up to 50 V/s" in said
    assert "\n" not in said


def test_long_reasons_are_cut():
    assert len(one_line("x" * 1000)) == 200


@over("ts_s, case", product([5e-5, 2e-4, 1e-3], ALL))
def test_references_begin_at_rest_and_are_scored_over_whole_periods(case: Case, ts_s: float):
    first, end = case.window(ts_s)
    r = case.samples(ts_s, centre_um=4.0, rest_um=-7.0, seed=3)
    assert r[0] == -7.0
    assert len(r) == end
    assert (end - first) * ts_s == pytest.approx(case.periods * case.period_s, abs=ts_s)
    if case.fits(ts_s) and case.reference == "sine" and (case.period_s / ts_s).is_integer():
        assert r[first:].mean() == pytest.approx(4.0, abs=1e-6)
        assert np.ptp(r[first:]) == pytest.approx(20.0, rel=2e-2)


def test_the_suite_holds_the_references_of_the_leaderboard():
    assert [case.frequency_hz for case in ALL if case.reference == "sine"] == list(SINE_HZ)
    assert {case.reference for case in ALL} == set(REFERENCES)


def test_a_case_fits_where_its_period_is_resolved():
    sine = next(case for case in ALL if case.frequency_hz == 50.0)
    assert sine.fits(1.0 / 50.0 / FEWEST_SAMPLES)
    assert not sine.fits(1.01 / 50.0 / FEWEST_SAMPLES)


@given(seed=st.integers(1, 10_000))
def test_drawn_truths_are_within_the_spread_of_the_belief(seed: int):
    nominal, drawn = P10.hysteresis, truth(P10, seed).hysteresis
    gaps = [np.diff([0.0, *model.thresholds_V]) for model in (nominal, drawn)]
    ratios = [
        np.array(drawn.weights) / nominal.weights,
        gaps[1] / gaps[0],
        np.array([drawn.delta2_s / nominal.delta2_s]),
    ]
    assert np.all(np.abs(np.concatenate(ratios) - 1.0) <= SPREAD + 1e-12)
    assert drawn != nominal


def test_seed_0_is_the_belief():
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
    assert make_stage(lagging).belief("pi").effects == ()
    assert make_stage(lagging).belief("pi").name == "P5 without effects"
    assert make_stage(lagging).belief("extended-inverse") == make_stage(lagging).plant
    assert truth(make_stage(lagging).plant, 1).effects == lagging.effects
    assert make_stage(P5).belief("pi") == make_stage(P5).plant


def test_a_plant_identified_at_low_rates_gets_slow_references():
    slow = PlantModel(
        RDPI.from_law([10.0, 2.0], 0.2, 0.0), "slow", (0.0, 4.0), (20.0, 15.0),
        identification={"fastest_peak_rate_V_s": 12.0},
    )  # fmt: skip
    assert make_stage(slow).base_hz == 1.0
    assert min(make_stage(slow).ts_s) >= 1e-3


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


def test_gap_and_variation_are_relative_to_the_bound_of_the_same_seed():
    table = score_table(
        [
            row("a", 3.0, seed=0, variation=20.0),
            row("a", 4.0, seed=1),
            row("full-preview-inversion", 1.0, seed=0),
            row("full-preview-inversion", 8.0, seed=1),
        ]
    )
    assert tuple(table.columns) == COLUMNS
    assert table["optimality_gap"].tolist() == [3.0, 0.5, 1.0, 1.0]
    assert table["command_total_variation"].tolist() == [2.0, 1.0, 1.0, 1.0]


def test_interval_is_students():
    mean, half = interval(np.array([1.0, 2.0, 4.0, 5.0]))
    # t(3, 0.975) = 3.18245; standard deviation 1.82574
    assert (mean, half) == pytest.approx((3.0, 3.182446 * 1.825742 / 2.0), rel=1e-6)
    assert np.isnan(interval(np.array([1.0]))[1])


def test_ranking_is_by_the_geometric_mean_over_drawn_seeds():
    rows = []
    for seed in (0, 1, 2):
        rows += [
            row("full-preview-inversion", 1.0, seed),
            row("full-preview-inversion", 1.0, seed, "steps"),
        ]
        rows += [row("even", 2.0, seed), row("even", 2.0, seed, "steps")]
        rows += [row("uneven", 1.0, seed), row("uneven", 9.0, seed, "steps")]
    ranked = ranking(score_table(rows)).set_index("controller")
    assert ranked.index.tolist() == ["full-preview-inversion", "even", "uneven"]
    assert ranked["optimality_gap"].tolist() == pytest.approx([1.0, 2.0, 3.0])
    assert ranked.loc["uneven", "rmse_percent"] == pytest.approx(30.0)
    assert ranked.loc["even", "mean_rank"] == ranked.loc["uneven", "mean_rank"] == 1.5
    assert pd.isna(ranked.loc["full-preview-inversion", "mean_rank"])


def test_seed_0_does_not_enter_the_mean_where_others_were_drawn():
    rows = [row("full-preview-inversion", 1.0, s) for s in (0, 1, 2)]
    rows += [row("a", rmse, s) for s, rmse in enumerate((0.001, 2.0, 2.0))]
    ranked = ranking(score_table(rows)).set_index("controller")
    assert ranked.loc["a", "rmse_percent"] == pytest.approx(20.0)
    assert ranked.loc["a", "seed_0_rmse_percent"] == pytest.approx(0.01)


def test_references_faster_than_the_identification_are_not_covered_by_it():
    slow = replace(P5, identification={"fastest_peak_rate_V_s": 60.0})
    # sines of 10 µm: 2π f 10 µm / A, so 51.6 V/s at 1 Hz and 516 V/s at 10 Hz
    covered = {
        case.name: make_stage(slow).covers(case, 1e-3)
        for case in make_stage(slow).cases(("sine", "steps"), 1e-3)
    }
    assert [name for name, is_covered in covered.items() if is_covered] == ["sine 1 Hz"]
    assert all(make_stage(P5).covers(case, 1e-3) for case in make_stage(P5).cases(REFERENCES, 1e-3))


def test_a_row_with_an_error_takes_the_mean_away_and_ranks_last():
    rows = [
        row("full-preview-inversion", 1.0),
        row("full-preview-inversion", 1.0, reference="steps"),
    ]
    rows += [row("good", 5.0), row("good", 5.0, reference="steps")]
    rows += [row("bad", 0.1), row("bad", None, reference="steps")]
    ranked = ranking(score_table(rows)).set_index("controller")
    assert ranked.index.tolist() == ["full-preview-inversion", "good", "bad"]
    assert pd.isna(ranked.loc["bad", "rmse_percent"])
    assert ranked.loc["bad", "errors"] == 1
    assert ranked.loc["bad", ["rank", "status"]].tolist() == ["–", "error 1/2"]
    assert ranked.loc["bad", "mean_rank"] == pytest.approx(1.5)


def seeded(means):
    """Return rows of one case and four drawn seeds, from RMSEs (µm) of each controller."""
    return [row(name, rmse, seed) for name, each in means.items() for seed, rmse in enumerate(each, start=1)]  # fmt: skip


def test_controllers_whose_paired_difference_includes_zero_share_a_rank():
    table = score_table(
        seeded(
            {
                "full-preview-inversion": [0.1, 0.1, 0.1, 0.1],
                # every seed has its own level: only the paired difference tells them apart
                "best": [1.0, 2.0, 4.0, 8.0],
                "as-good": [1.1, 1.9, 4.2, 7.9],
                "worse": [1.5, 3.0, 6.1, 12.0],
                "worst": [50.0, 60.0, 55.0, 51.0],
                "broken": [1.0, 1.0, 1.0, None],
            }
        )
    )
    ranked = ranking(table).set_index("controller")
    assert ranked["rank"].to_dict() == {
        "full-preview-inversion": "bound", "best": "1=", "as-good": "1=", "worse": "3", "worst": "4",
        "broken": "–",
    }  # fmt: skip
    assert ranked["places"].to_dict() == {
        "full-preview-inversion": "–", "best": "1 to 2", "as-good": "1 to 2", "worse": "3", "worst": "4",
        "broken": "–",
    }  # fmt: skip


def test_a_chain_of_ties_is_one_rank_and_places_say_what_is_open():
    table = score_table(
        seeded(
            {
                "a": [1.00, 1.00, 1.00, 1.00],
                "b": [0.90, 1.30, 1.00, 1.20],
                "c": [1.20, 1.21, 1.19, 1.20],
            }
        )
    )
    ranked = ranking(table).set_index("controller")
    assert set(ranked["rank"]) == {"1="}
    assert ranked["places"].to_dict() == {"a": "1 to 2", "b": "1 to 3", "c": "2 to 3"}


def test_no_pair_that_is_tied_has_two_ranks_on_the_committed_leaderboard():
    table = pd.read_csv(TRACKING / "leaderboard.csv")
    ranked = pd.read_csv(TRACKING / "ranking.csv")
    main = ranked[ranked["ts_s"].isna() & ~ranked["rank"].isin(["bound", "–"])]
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
    tied = 0
    for a, b in itertools.combinations(ranks.index, 2):
        low, high = stats.ttest_rel(logs[a], logs[b]).confidence_interval()
        if low <= 0.0 <= high:
            tied += 1
            assert ranks[a] == ranks[b], (a, b)
    assert tied > 10
    shared = ranks[ranks.duplicated(keep=False)]
    assert shared.str.endswith("=").all()
    assert not ranks.drop(shared.index).str.endswith("=").any()
