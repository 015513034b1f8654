"""What follows from the input is told from what does not, and only what was tested is said."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from benchmarks.effect_discovery.outsiders import BoucWen, Force, Preisach
from rdpi_gym.diagnosis.features.noise import quiet_noise
from rdpi_gym.diagnosis.search.learner import FAMILIES, memory_features
from rdpi_gym.diagnosis.search.residual_share import FOLLOWS, remainder
from rdpi_gym.diagnosis.suitability import comb
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record, example_folder, hold_out_blocks, load
from rdpi_gym.plant import P10
from rdpi_gym.plant.cores.play import play_columns
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import in_chain_order
from rdpi_gym.signals import BandLimitedNoise, DecayingSine, Multisine, Sine
from rdpi_gym.signals.experiments import polyline
from rdpi_gym.virtual_lab.dataset import Truth
from tests.looping import over

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


def left_by_rdpi(train, validation, noise_um=NOISE_UM, quiet=()):
    variant = fit_joint(train, comb(train), ()).variant
    scale = data_scale((*train, *validation))
    return remainder(variant, train, validation, scale, noise_um, still=quiet_noise(quiet))


@pytest.mark.slow
@over("kind", [bouc_wen, preisach, relays, coleman_hodgdon])
def test_hysteresis_of_another_kind_follows_from_the_input(kind):
    found = left_by_rdpi(*measure(kind))
    assert found.share >= 0.7
    assert found.low >= 0.5
    assert found.high == 1.0
    assert found.sentence.startswith("At least ")
    assert "follows from the input" in found.sentence


@over("seed", [0, 1])
def test_a_force_that_nobody_recorded_is_not_predicted_and_may_not_be_denied(seed):
    """A learner that fails proves nothing: what is left could follow by a law it cannot learn."""
    found = left_by_rdpi(*measure(force, seed))
    assert found.share <= 0.1
    assert found.low == 0.0
    assert found.high > 0.8
    assert "These records cannot tell" in found.sentence
    assert found.hidden_um == pytest.approx(0.16, rel=0.1)


def test_a_quiet_record_that_moves_shows_a_disturbance():
    train, validation = measure(force)
    t = 30.0 + np.arange(16000) * 5e-4
    moves = Record("quiet", t, np.zeros(16000), force(t, np.zeros(16000)), ts_s=5e-4)
    found = left_by_rdpi(train, validation, quiet=(moves,))
    assert found.low == 0.0
    assert found.high < 0.4
    assert found.hidden_um < 0.12
    assert "is a disturbance: the stage moves while the input rests" in found.sentence


def test_of_hysteresis_and_a_force_only_the_hysteresis_is_predicted():
    both = measure(lambda t, u: bouc_wen(t, u) + force(t, u) - nothing(t, u))
    found = left_by_rdpi(*both)
    assert 0.1 < found.share < 0.5
    assert found.low < found.share < found.high


def test_noise_is_called_noise():
    assert left_by_rdpi(*measure(nothing)).sentence == "The residual is noise."


def test_an_error_below_the_noise_leaves_nothing_to_predict():
    train, validation = measure(nothing)
    variant = fit_joint(train, comb(train), ()).variant
    found = remainder(variant, train, validation, data_scale(train), noise_um=10.0)
    assert found.share == 0.0


@pytest.mark.slow
def test_units_do_not_matter():
    train, validation = measure(bouc_wen)
    share = left_by_rdpi(train, validation).share
    other = [
        tuple(replace(r, u_V=0.01 * r.u_V, y_um=1e3 * r.y_um) for r in part)
        for part in (train, validation)
    ]
    assert left_by_rdpi(*other, 1e3 * NOISE_UM).share == pytest.approx(share, abs=0.02)


@over("kind, follows", [(preisach, True), (force, False)])
def test_held_out_blocks_will_do(kind, follows):
    train, validation = zip(*(hold_out_blocks(r) for r in measure(kind)[0]), strict=True)
    assert (left_by_rdpi(train, validation).share >= FOLLOWS) == follows


def test_one_validation_record_will_do():
    train, validation = measure(bouc_wen)
    assert left_by_rdpi(train, validation[:1]).share >= 0.7


@pytest.mark.slow
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


def filtered(u, ts, root):
    """First-order filter of gain 1 with a real or complex root (1/s)."""
    pole = np.exp(root * ts)
    return lfilter([1.0 - pole], [1.0, -pole], u + 0j, zi=[pole * u[0]])[0]


def sprung(u, ts):
    return (u / 32.0) ** 3


def ringing(u, ts):
    return filtered(u, ts, 2 * np.pi * 110.0 * (-0.03 + 1j)).imag


def creeping(u, ts):
    return u - filtered(u, ts, -1 / 0.3).real


def wild(u, ts):
    """A law of the input's history that no smooth learner finds."""
    plays = np.empty((2, len(u)))
    play_columns(u, np.zeros_like(u), np.array([4.0, 10.0]), 0.0, np.zeros(2), plays)
    return np.sin(2.5 * plays[0] + 1.3 * u) * np.cos(1.9 * plays[1])


def quick(t):
    return lines(t, 5.0, 90.0)


def slow(t):
    return lines(t, 0.3, 5.0)


def drift(t):
    return 1.0 - np.exp(-t / 6.0)


def lines(t, low_hz, high_hz):
    rng = np.random.default_rng(11)
    hz, phase = rng.uniform(low_hz, high_hz, 60), rng.uniform(0.0, 2.0 * np.pi, 60)
    return np.sin(2.0 * np.pi * np.outer(t, hz) + phase).sum(axis=1)


PROTOCOLS = {
    "one after the other": ((*TRAIN[:1], *TRAIN[3:]), VALIDATION),
    "cycles": (
        ((Sine(amplitude_um=32.0, frequency_hz=10.0), 5e-4, 1.5),),
        ((Sine(amplitude_um=24.0, frequency_hz=10.0), 5e-4, 1.5),),
    ),
    "random": (
        ((BandLimitedNoise(amplitude_um=30.0, high_hz=60.0, repeat_s=3.0, seed=5), 5e-4, 3.0),),
        ((BandLimitedNoise(amplitude_um=28.0, high_hz=60.0, repeat_s=2.0, seed=6), 5e-4, 2.0),),
    ),
}


def mixture(protocol, follows, disturbs, share, seed):
    """Records of P10 with 0.1 µm rms more on those to validate on, of which a share follows."""
    rng, clock, records, parts = np.random.default_rng(seed), 0.0, [], []
    train, validation = PROTOCOLS[protocol]
    for i, (signal, ts, duration) in enumerate((*train, *validation)):
        t = clock + np.arange(round(duration / ts)) * ts
        u = np.asarray(signal(t - clock))
        records.append(Record(f"record {i}", t, u, np.zeros_like(t), ts_s=ts))
        parts.append((follows(u, ts), disturbs(t)))
        clock += duration + 1.0
    held_out = parts[len(train) :]
    of, by = (np.concatenate([p[k] - p[k].mean() for p in held_out]).std() for k in (0, 1))
    plant = Variant(P10.hysteresis, ())
    measured = [
        replace(
            r,
            y_um=simulate_effects([plant], r)[:, 0]
            + 0.1 * (np.sqrt(share) / of * d + np.sqrt(1.0 - share) / by * q)
            + NOISE_UM * rng.standard_normal(len(d)),
        )
        for r, (d, q) in zip(records, parts, strict=True)
    ]
    first, rest = measured[: len(train)], measured[len(train) :]
    return remainder(plant, first, rest, data_scale(measured), NOISE_UM)


@pytest.mark.slow
@over("protocol", PROTOCOLS)
@over(
    "follows, disturbs, share",
    [
        (sprung, quick, 0.0),
        (sprung, slow, 0.6),
        (ringing, quick, 0.3),
        (creeping, drift, 0.3),
        (wild, slow, 0.0),
        (wild, quick, 0.6),
        (wild, drift, 1.0),
    ],
)
def test_the_interval_holds_the_share_that_follows_from_the_input(
    protocol, follows, disturbs, share
):
    found = mixture(protocol, follows, disturbs, share, seed=3)
    assert found.low - 0.1 <= share <= found.high + 0.1
    assert found.low <= found.share <= found.high


@over("follows", [sprung, ringing])
def test_a_spring_or_a_resonance_that_the_model_lacks_follows_surely(follows):
    assert mixture("random", follows, quick, 1.0, seed=4).low > 0.8


def test_what_repeats_is_never_denied_though_no_learner_finds_its_law():
    found = mixture("cycles", wild, quick, 1.0, seed=5)
    assert found.repeats > 0.9
    assert found.low > 0.3
    assert "repeats where the input's history does" in found.sentence


def test_cycles_that_differ_show_a_disturbance():
    found = mixture("cycles", sprung, lambda t: lines(t, 100.0, 400.0), 0.0, seed=6)
    assert found.repeats < 0.1
    assert found.high < 0.3
    assert found.hidden_um < 0.06
    assert found.sentence.startswith("Nothing was found that follows from the input")
    assert "is a disturbance: repetitions of the same input differ" in found.sentence


@pytest.mark.slow
def test_of_a_lasting_numerical_error_nothing_is_said_to_follow():
    train, validation = measure(bouc_wen)
    variant = fit_joint(train, comb(train), ()).variant
    scale = data_scale((*train, *validation))
    left_um = remainder(variant, train, validation, scale, NOISE_UM).left_um
    found = remainder(variant, train, validation, scale, NOISE_UM, numerical_um=0.8 * left_um)
    assert found.left_um == pytest.approx(0.6 * left_um, rel=1e-6)
    assert found.low < 0.8


def test_the_numbers_stand_beside_the_sentence():
    found = mixture("cycles", sprung, quick, 0.6, seed=7).to_dict()
    assert list(found) == ["share", "low", "high", "repeats", "hidden_um", "left_um", "sentence"]
    assert found["left_um"] == pytest.approx(0.1, rel=0.1)


@pytest.mark.slow
def test_of_a_measured_stage_half_of_what_three_effects_leave_follows_from_the_input():
    data = load(example_folder("picma"))
    scale = data_scale((*data.train, *data.validation))
    effects = [CATALOGUE[n].starts(scale)[0] for n in ("creep", "congruency", "asymmetry")]
    variant = fit_joint(data.train, comb(data.train), in_chain_order(effects)).variant
    found = remainder(variant, data.train, data.validation, scale, noise_um=0.07)
    assert found.low >= 0.46
    assert found.repeats >= 0.7
    assert "follows from the input" in found.sentence
