"""Hidden truths: their sizes, their records, and what of them can be seen."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.effect_discovery.independent import NOISE_UM, VARIANTS, random_plant, transform
from benchmarks.effect_discovery.outsiders import OUTSIDERS, BoucWen, Force, Preisach, draw_outsider
from rdpi_gym.plant import P5, P10, Converter, Plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab import HIDEABLE, Truth, draws, hide, simulate_dataset
from rdpi_gym.virtual_lab.draws import VISIBLE, MaskedError, View, draw_effect, refit_residuals
from rdpi_gym.virtual_lab.independent import twins
from tests.looping import over


@pytest.fixture(scope="module")
def plain():
    return Truth(P10, (), noise_um=0.0, seed=3)


@pytest.fixture(scope="module")
def measured():
    truth = Truth(P10, (), noise_um=0.012, seed=3)
    return simulate_dataset(truth)


def test_what_the_independent_formulation_knows_can_be_hidden():
    assert set(HIDEABLE) == set(twins())
    # The order that seeds mean something by.
    assert HIDEABLE[:4] == ("creep", "resonance", "actuator_lag", "sensor_lag")
    assert HIDEABLE[12:15] == ("mains_hum", "congruency", "initial_memory")


def test_records_are_the_protocol_on_one_clock_with_pauses(measured):
    assert sum(len(r.u_V) for r in measured.train) == 91_000
    assert [r.role for r in measured.records].count("validation") == 5
    assert [r.name for r in measured.quiet] == ["quiet"]
    for before, after in zip(measured.records, measured.records[1:], strict=False):
        assert after.t_s[0] - before.t_s[-1] == pytest.approx(1.0 + before.ts_s)
    for record in measured.records:
        assert np.ptp(np.diff(record.t_s)) < 1e-9 * record.t_s[-1]


def test_a_plant_without_secret_is_the_rdpi_model_and_white_noise(measured):
    residuals = []
    for record in measured.records:
        e = record.y_um - Plant(P10, record.ts_s).simulate(record.u_V)
        residuals.append(e)
        # neighbours of white noise are not correlated: 5 standard deviations
        assert abs(np.corrcoef(e[1:], e[:-1])[0, 1]) < 5 / math.sqrt(len(e))
    assert np.concatenate(residuals).std() == pytest.approx(0.012, rel=0.01)


def test_records_that_begin_away_from_zero_begin_with_an_empty_memory():
    model = replace(P10, command_range_V=(10.0, 90.0), offset_um=-30.0)
    truth = Truth(model, (), noise_um=0.0, seed=0)
    assert truth.centre_V == 50.0
    for record in simulate_dataset(truth).records:
        expected = Plant(model, record.ts_s).simulate(record.u_V)
        assert np.abs(record.y_um - expected).max() < 1e-6


def test_the_test_bench_of_the_plant_is_simulated():
    model = replace(P10, converter=Converter(period_s=2e-3))
    truth = Truth(model, (), noise_um=0.0, seed=0)
    record = simulate_dataset(truth).records[0]
    expected = Plant(model, record.ts_s).simulate(record.u_V)
    assert np.abs(record.y_um - expected).max() < 1e-6
    assert np.abs(record.y_um - Plant(P10, record.ts_s).simulate(record.u_V)).max() > 0.01


def test_the_noise_of_a_record_does_not_depend_on_the_sampling_of_the_others(measured):
    again = simulate_dataset(Truth(P10, (), noise_um=0.012, seed=3))
    other = simulate_dataset(Truth(P10, (), noise_um=0.012, seed=4))
    for a, b, c in zip(measured.records, again.records, other.records, strict=True):
        assert np.array_equal(a.y_um, b.y_um)
        assert not np.array_equal(a.y_um, c.y_um)


def test_half_the_sampling_time_is_the_same_experiment(measured):
    fine = simulate_dataset(Truth(P10, (), noise_um=0.0, seed=3, ts_factor=0.5))
    for coarse, record in zip(measured.records, fine.records, strict=True):
        assert len(record.u_V) == 2 * len(coarse.u_V)
        assert np.allclose(record.u_V[::2], coarse.u_V, atol=1e-9 * 40)


@over("name", HIDEABLE)
@over("model", [P10, P5])
def test_draws_are_typical_for_the_size_of_the_plant(name, model):
    truth = Truth(model, (), noise_um=0.0, seed=0)
    rng = np.random.default_rng(1)
    sizes = {"V": truth.span_V, "V/s": truth.span_V, "µm": truth.stroke_um, "µm/s": truth.stroke_um}
    for _ in range(20):
        effect = draw_effect(name, truth, rng)
        for p in effect.parameters:
            value, factor = effect.values[p.name], sizes.get(p.unit, 40.0) / 40.0
            low, high = (factor * end for end in p.typical)
            if p.name == "frequency_hz":
                assert value in (50.0, 60.0)
            elif p.low == -p.high:
                assert abs(value) <= high * (1 + 1e-12)
                assert abs(value) >= low * (1 - 1e-12)
            else:
                assert low * (1 - 1e-12) <= value <= high * (1 + 1e-12)


def test_positions_of_the_command_move_with_its_centre():
    model = replace(P10, command_range_V=(0.0, 60.0))
    truth = Truth(model, (), noise_um=0.0, seed=0)
    saturation = draw_effect("saturation", truth, np.random.default_rng(0))
    assert saturation.values["centre_V"] == 30.0
    extrema = [
        draw_effect("initial_memory", truth, np.random.default_rng(k)).values["extremum_V"]
        for k in range(20)
    ]
    assert all(0.0 <= extremum <= 60.0 for extremum in extrema)
    assert min(extrema) < 30.0 < max(extrema)


def test_a_refit_takes_up_weights_delta2_and_offsets_and_no_hum(plain):
    view = View(plain)
    other = P10.with_hysteresis(replace(P10.hysteresis, delta2_s=P10.hysteresis.delta2_s * 1.001))
    shift = [
        Plant(other, r.ts_s).simulate(r.u_V) - Plant(P10, r.ts_s).simulate(r.u_V) + k
        for k, r in enumerate(view.records)
    ]
    largest = max(float(np.std(d)) for d in shift)
    left = refit_residuals(P10, (), plain.span_V, view.records, shift)
    assert max(left.values()) < 0.05 * largest
    hum = [0.02 * np.sin(2 * np.pi * 50.0 * r.t_s) for r in view.records]
    left = refit_residuals(P10, (), plain.span_V, view.records, hum)
    assert left["quiet"] == pytest.approx(0.02 / math.sqrt(2), rel=0.01)


def test_what_is_known_is_refitted_too(plain):
    delay, longer = CATALOGUE["delay"](1e-4), CATALOGUE["delay"](1.01e-4)
    view = View(plain)
    difference = [
        a - b
        for a, b in zip(view.displacements([longer]), view.displacements([delay]), strict=True)
    ]
    unknown = refit_residuals(P10, (), plain.span_V, view.records, difference)
    known = refit_residuals(P10, (delay,), plain.span_V, view.records, difference)
    assert max(known.values()) < 0.1 * max(unknown.values())


@over("name", ["creep", "delay", "mains_hum"])
def test_what_is_hidden_shows_above_the_noise(name):
    plant, noise_um = random_plant(np.random.default_rng(5))
    truth = hide([name], Truth(plant, (), noise_um, seed=0), np.random.default_rng(6))
    view = View(truth)
    difference = [
        a - b for a, b in zip(view.displacements(truth.hidden), view.displacements([]), strict=True)
    ]
    left = refit_residuals(plant, (), truth.span_V, view.records, difference)
    assert max(left.values()) >= VISIBLE * noise_um


def test_noise_masks_an_effect(monkeypatch):
    monkeypatch.setattr(draws, "_ATTEMPTS", 5)
    truth = Truth(P10, (), noise_um=5.0, seed=0)
    with pytest.raises(MaskedError, match="mains_hum cannot be seen on P10"):
        hide(["mains_hum"], truth, np.random.default_rng(0))


@over(
    "change, said",
    [
        ({"noise_um": -0.1}, "noise_um is -0.1"),
        ({"noise_um": math.nan}, "noise_um is nan"),
        ({"ts_factor": 9.0}, "from 0.1 to 4.0"),
        (
            {
                "plant": replace(P10, effects=(CATALOGUE["creep"](),)),
                "hidden": (CATALOGUE["creep"](),),
            },
            "P10 has creep already",
        ),
    ],
)
def test_a_truth_that_cannot_be(plain, change, said):
    with pytest.raises(InputError, match=said):
        replace(plain, **change)


def test_random_plants_are_like_p10():
    drawn = [random_plant(np.random.default_rng(k)) for k in range(200)]
    base = P10.hysteresis
    for plant, noise_um in drawn:
        h = plant.hysteresis
        assert NOISE_UM[0] <= noise_um <= NOISE_UM[1]
        assert 5 <= h.n <= 12
        assert 0.7 <= h.thresholds_V[0] / base.thresholds_V[0] <= 1.3
        assert 0.5 <= h.delta2_s / base.delta2_s <= 2.0
        assert all(np.diff(h.weights[1:]) <= 0)
    assert {plant.hysteresis.n for plant, _ in drawn} == set(range(5, 13))


@over("kind", OUTSIDERS)
def test_what_is_outside_the_catalogue_is_no_rdpi_model(kind):
    truth = Truth(P10, (), noise_um=0.012, seed=0)
    outsider = draw_outsider(kind, truth, np.random.default_rng(0))
    records = View(truth).records
    y = [outsider.displacement(truth, r.t_s, r.u_V) for r in records]
    left = refit_residuals(P10, (), truth.span_V, records, y)
    assert max(left.values()) > 5 * truth.noise_um


def test_nothing_is_named_so():
    with pytest.raises(InputError, match="force, bouc-wen, preisach"):
        draw_outsider("gremlin", Truth(P10, (), 0.0, 0), np.random.default_rng(0))


def test_the_force_has_its_band_and_size(plain):
    t = np.arange(50_000) * 1e-3
    pushed = Force(0.1, 10.0, 60.0, 1).displacement(plain, t, np.zeros_like(t))
    power = np.abs(np.fft.rfft(pushed * np.hanning(t.size))) ** 2
    frequency = np.fft.rfftfreq(t.size, 1e-3)
    inside = (frequency > 9.9) & (frequency < 60.1)
    assert power[inside].sum() > 0.9999 * power.sum()
    assert pushed.std() == pytest.approx(0.1, rel=0.05)


def test_bouc_wen_follows_its_closed_form(plain):
    # n = 1 and σ = 1/2: z = 1 - exp(-u/w) upwards from rest; back down linear until z = 0
    w = 4.0
    model = BoucWen(gain_um_V=1.0, depth_um=1.0, width_V=w, exponent=1.0, share=0.5)
    u = np.concatenate([np.linspace(0, 6, 50), np.linspace(6, 4, 20)[1:]])
    z = u - model.displacement(plain, u, u)
    top = 1 - math.exp(-6 / w)
    assert z[:50] == pytest.approx(1 - np.exp(-u[:50] / w), abs=1e-7)
    assert z[50:] == pytest.approx(top - (6 - u[50:]) / w, abs=1e-7)


def test_preisach_loops_differ_with_their_bias_and_wipe_out(plain):
    model = Preisach(gain_um_V=0.5, relay_um_V=0.5, width_V=5.0, spread_V=15.0, middle_V=0.0)
    turns = np.array([0.0, 20, 10, 20, 10, 20, -20, 20, -20, 0, -5, 5, -5, 5])
    y = model.displacement(plain, turns, turns)
    assert y[3] == pytest.approx(y[1])  # return-point memory
    assert y[8] == pytest.approx(y[6])
    # the same span of 10 V has a larger gain about zero than about 15 V
    assert (y[11] - y[10]) > 1.1 * (y[3] - y[2])


@over("variant", VARIANTS)
def test_a_variant_holds_the_same_measurement(measured, variant):
    other = transform(measured, variant, seed=1)
    by_name = {r.name: r for r in other.records}
    assert by_name.keys() == {r.name for r in measured.records}
    sign = -1.0 if variant == "sign reversed" else 1.0
    for record in measured.records:
        same = by_name[record.name]
        assert same.role == record.role
        assert same.ts_s == pytest.approx(record.ts_s)
        assert np.allclose(same.u_V, record.u_V, rtol=0, atol=1e-9)
        assert np.allclose(sign * same.y_um, record.y_um, rtol=0, atol=1e-9)
    if variant == "order shuffled":
        assert [r.name for r in other.records] != [r.name for r in measured.records]


def test_no_such_variant(measured):
    with pytest.raises(InputError, match="'upside down'; give plain, order shuffled"):
        transform(measured, "upside down", 0)
