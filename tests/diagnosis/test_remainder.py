"""A learner with memory knows hysteresis of any kind from a force that nobody recorded."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.hidden_effects.outside import BoucWen, Force, Preisach
from rdpi_gym.diagnosis.features.memory import FAMILIES, memory_features
from rdpi_gym.diagnosis.search.remainder import FOLLOWS, remainder
from rdpi_gym.diagnosis.search.scale import comb, data_scale
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.measurement import Record, hold_out_quarter
from rdpi_gym.plant import P10
from rdpi_gym.signals import BandLimitedNoise, DecayingSine, Multisine, Sine
from rdpi_gym.signals.experiments import polyline
from rdpi_gym.virtual_lab.truth import Truth

NOISE_UM = 0.012
TRUTH = Truth(P10, (), noise_um=NOISE_UM, seed=0)
TRAIN = (
    (polyline([0.0, 32.0, -32.0, 24.0, -16.0, 10.0, -6.0, 2.0, 0.0], 400.0), 5e-4, 0.6),
    (polyline([0.0, -32.0, 20.0, 2.0, 20.0, 2.0, -8.0, 10.0, -8.0, 32.0], 400.0), 5e-4, 0.6),
    (Sine(amplitude_um=32.0, frequency_hz=50.0), 5e-5, 0.06),
    (Sine(amplitude_um=8.0, frequency_hz=200.0), 5e-5, 0.05),
    (Multisine(amplitude_um=32.0, frequency_hz=10.0, lines=15, odd=True, seed=1), 1e-4, 0.3),
)
VALIDATION = (
    (BandLimitedNoise(amplitude_um=26.0, high_hz=150.0, repeat_s=0.2, seed=3), 1e-4, 0.2),
    (DecayingSine(amplitude_um=30.0, frequency_hz=30.0, decay_s=0.1), 1e-4, 0.2),
    (polyline([0.0, -28.0, 26.0, -6.0, 16.0, -22.0, 0.0], 300.0), 5e-4, 0.5),
)


def bouc_wen(t, u):
    return BoucWen(1.1, 2.5, 6.0, exponent=1.5, share=0.7).displacement(TRUTH, t, u)


def preisach(t, u):
    return Preisach(0.6, 0.6, 6.0, spread_V=30.0, middle_V=5.0).displacement(TRUTH, t, u)


def relays(t, u):
    """Preisach's model as it is defined: many relays, of a density that is no product."""
    rng = np.random.default_rng(0)
    middle, half_width = rng.uniform(-32.0, 32.0, 600), rng.exponential(5.0, 600)
    gain = 0.02 * (1.0 + 0.8 * np.sin(middle / 8.0) * np.cos(half_width / 3.0))
    state, total = np.where(middle > 0.0, -1.0, 1.0), np.empty_like(u)
    for k, value in enumerate(u):
        state[value >= middle + half_width] = 1.0
        state[value <= middle - half_width] = -1.0
        total[k] = gain @ state
    return 0.6 * u + total


def coleman_hodgdon(t, u):
    """dw/du = α sgn(du) (f(u) - w) + g, in small steps."""
    w, total = 0.0, np.zeros_like(u)
    for k in range(1, len(u)):
        steps = max(1, int(abs(u[k] - u[k - 1]) / 0.1))
        for x in np.linspace(u[k - 1], u[k], steps + 1)[:-1]:
            du = (u[k] - u[k - 1]) / steps
            w += 0.1 * abs(du) * (27.0 * np.tanh(x / 25.0) - w) + 0.8 * du
        total[k] = w
    return total


def force(t, u):
    return Force(0.15, 10.0, 90.0, seed=4).displacement(TRUTH, t, u)


def nothing(t, u):
    return Force(0.0, 10.0, 90.0, seed=4).displacement(TRUTH, t, u)


def measure(displacement, seed=0):
    """Records to fit and to validate on, taken one after the other on one clock."""
    rng, clock, records = np.random.default_rng(seed), 0.0, []
    for i, (signal, ts, duration) in enumerate((*TRAIN, *VALIDATION)):
        t = np.arange(round(duration / ts)) * ts
        u = np.asarray(signal(t))
        y = displacement(t + clock, u) + NOISE_UM * rng.standard_normal(len(t))
        records.append(Record(f"record {i}", t + clock, u, y, ts_s=ts))
        clock += duration + 1.0
    return tuple(records[: len(TRAIN)]), tuple(records[len(TRAIN) :])


def left_by_rdpi(train, validation, noise_um=NOISE_UM):
    variant = fit_joint(train, comb(train), ()).variant
    return remainder(variant, train, validation, data_scale((*train, *validation)), noise_um)


@pytest.mark.parametrize("kind", [bouc_wen, preisach, relays, coleman_hodgdon])
def test_hysteresis_of_another_kind_follows_from_the_input(kind):
    found = left_by_rdpi(*measure(kind))
    assert found.predicted_share >= 0.7
    assert "follows from the command" in found.sentence


@pytest.mark.parametrize("seed", [0, 1])
def test_a_force_that_nobody_recorded_does_not(seed):
    found = left_by_rdpi(*measure(force, seed))
    assert found.predicted_share <= 0.1
    assert "does not follow from the command" in found.sentence


def test_of_hysteresis_and_a_force_only_the_hysteresis_is_predicted():
    both = measure(lambda t, u: bouc_wen(t, u) + force(t, u) - nothing(t, u))
    found = left_by_rdpi(*both)
    assert 0.1 < found.predicted_share < 0.5
    assert "in part" in found.sentence


def test_noise_is_called_noise():
    assert left_by_rdpi(*measure(nothing)).sentence == "What is left is the noise."


def test_an_error_below_the_noise_leaves_nothing_to_predict():
    train, validation = measure(nothing)
    variant = fit_joint(train, comb(train), ()).variant
    found = remainder(variant, train, validation, data_scale(train), noise_um=10.0)
    assert found.predicted_share == 0.0


def test_units_do_not_matter():
    train, validation = measure(bouc_wen)
    share = left_by_rdpi(train, validation).predicted_share
    other = [
        tuple(replace(r, u_V=0.01 * r.u_V, y_um=1e3 * r.y_um) for r in part)
        for part in (train, validation)
    ]
    assert left_by_rdpi(*other, 1e3 * NOISE_UM).predicted_share == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize(("kind", "follows"), [(preisach, True), (force, False)])
def test_held_out_quarters_will_do(kind, follows):
    train, validation = zip(*(hold_out_quarter(r) for r in measure(kind)[0]), strict=True)
    assert (left_by_rdpi(train, validation).predicted_share >= FOLLOWS) == follows


def test_one_validation_record_will_do():
    train, validation = measure(bouc_wen)
    assert left_by_rdpi(train, validation[:1]).predicted_share >= 0.7


def test_the_answer_is_the_same_each_time():
    records = measure(force)
    variant = Variant(comb(records[0]), ())
    scale = data_scale((*records[0], *records[1]))
    first, second = (remainder(variant, *records, scale, NOISE_UM) for _ in range(2))
    assert first == second


def test_memory_of_the_path_does_not_know_the_rate():
    t = np.arange(4000) * 1e-4
    u = DecayingSine(amplitude_um=30.0, frequency_hz=20.0, decay_s=0.1)(t)
    slow = Record("slow", t, u, u, ts_s=1e-4)
    fast = replace(slow, t_s=0.1 * t, ts_s=1e-5)
    scale = data_scale((slow, fast))
    rows = np.arange(0, 4000, 7)
    one, other = (memory_features(r, 2.0 * u, scale, rows) for r in (slow, fast))
    for name in ("path", "powers", "products", "mixed", "output"):
        np.testing.assert_allclose(one[name], other[name])
    assert not np.allclose(one["time"], other["time"], atol=1e-3)


def test_a_stage_at_rest_has_no_memory():
    t = np.arange(300) * 1e-3
    u = np.full(300, 7.0)
    scale = data_scale((Record("moves", t, np.sin(40 * t) * 20, np.sin(40 * t), ts_s=1e-3),))
    features = memory_features(Record("still", t, u, u, ts_s=1e-3), u, scale, np.arange(300))
    assert set(features) == {name for family in FAMILIES for name in family}
    for columns in features.values():
        assert np.all(np.isfinite(columns))
        np.testing.assert_allclose(columns, columns[:1].repeat(300, axis=0), atol=1e-12)
