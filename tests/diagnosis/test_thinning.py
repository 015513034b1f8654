"""Laws of searches that read fewer samples than there are."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rdpi_gym.diagnosis import suitability
from rdpi_gym.diagnosis.beam import evidence
from rdpi_gym.diagnosis.search.discover import add_effect, diagnose, discover, remove_effect
from rdpi_gym.diagnosis.suitability import close_up, thinned
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import MOST_SAMPLES, kept_samples
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import Plant, named_plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.creep import Creep
from rdpi_gym.plant.effects.sensor_lag import SensorLag

NOISE_UM = 0.012


def _record(name: str, samples: int, ts_s: float, hz: float, seed: int = 0) -> Record:
    """Return a beat of three sines on P10 with creep and a sensor lag."""
    t = np.arange(samples) * ts_s
    u = sum(20.0 * np.sin(2.0 * np.pi * f * t) for f in (hz, 0.37 * hz, 0.13 * hz))
    effects = (Creep(gain_per_decade=0.03), SensorLag(time_constant_s=5e-4))
    plant = Plant(replace(named_plant("P10"), effects=effects), ts_s)
    y = plant.simulate(u) + np.random.default_rng(seed).normal(0.0, NOISE_UM, samples)
    return Record(name, t, np.asarray(u), y, ts_s=ts_s)


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search reads twelve thousand samples where there are twice as many."""
    monkeypatch.setattr(suitability, "SEARCH_MOST", 12_000)
    monkeypatch.setattr(evidence, "READ_SAMPLES", 12_000)


@pytest.fixture(scope="module")
def oversampled() -> Dataset:
    other = replace(_record("other", 20_000, 1e-4, 5.0, 1), role="validation")
    quiet = Record("rest", np.arange(9000) * 1e-4, np.zeros(9000), np.zeros(9000), ts_s=1e-4)
    return Dataset("streamed", (_record("run", 30_000, 1e-4, 4.0), other, quiet))


@pytest.mark.usefixtures("few")
def test_samples_are_left_out_and_not_averaged(oversampled: Dataset) -> None:
    found = thinned(oversampled, {"run": np.arange(30_000) < 3000})
    assert found is not None
    for before, after in zip(oversampled.records[:2], found.dataset.records[:2], strict=True):
        step = round(after.ts_s / before.ts_s)
        assert step > 1
        assert after.t_s.size <= 6000
        np.testing.assert_array_equal(after.y_um, before.y_um[::step][: after.y_um.size])
        np.testing.assert_array_equal(after.u_V, before.u_V[::step][: after.u_V.size])
        np.testing.assert_array_equal(after.t_s, before.t_s[::step][: after.t_s.size])
    assert found.dataset.records[2] is oversampled.records[2]  # quiet: its noise is as recorded
    assert found.openings["run"].size == found.dataset.records[0].t_s.size
    first = found.dataset.records[0].t_s[found.openings["run"]]
    assert first[-1] == pytest.approx(0.3, abs=1e-3)


def test_few_samples_are_all_read(oversampled: Dataset) -> None:
    assert thinned(oversampled, {}) is None


@pytest.mark.usefixtures("few")
def test_a_mode_stays_in_reach(oversampled: Dataset) -> None:
    run = oversampled.records[0]
    ringing = 3.0 * NOISE_UM * np.sin(2.0 * np.pi * 900.0 * run.t_s)
    found = thinned(Dataset("ringing", (replace(run, y_um=run.y_um + ringing),)), {})
    assert found is not None
    part = found.dataset.records[0]
    assert part.ts_s == run.ts_s  # ten samples in a period of 900 Hz
    assert part.t_s.size == 12_000
    assert "a stretch of 12,000 samples of run" in found.sentence


@pytest.mark.usefixtures("few")
def test_jumps_of_the_command_are_not_thinned(oversampled: Dataset) -> None:
    run = oversampled.records[0]
    stairs = 10.0 * np.round(run.u_V / 10.0)
    found = thinned(Dataset("stairs", (replace(run, u_V=stairs),)), {})
    assert found is not None
    assert found.dataset.records[0].ts_s == run.ts_s


@pytest.mark.usefixtures("few")
def test_a_rate_that_widens_thresholds_keeps_the_sampling() -> None:
    # as fine as the slow records for its command, but half a sample of its rate is more than noise
    found = thinned(Dataset("fast", (_record("run", 30_000, 1e-4, 12.0),)), {})
    assert found is not None
    assert found.dataset.records[0].ts_s == 1e-4


def test_a_stretch_is_where_most_happens_and_knows_its_history() -> None:
    t = np.arange(40_000) * 1e-3
    u = np.where(t < 16.0, 0.1, 1.0) * 10.0 * np.sin(2.0 * np.pi * 3.0 * t)
    cut = suitability._stretch(Record("run", t, u, u, ts_s=1e-3), 8000)
    # the first half of a stretch ahead of it holds the whole swing
    assert cut == slice(20_000, 28_000)


@pytest.mark.usefixtures("few")
def test_close_ups_keep_the_sampling(oversampled: Dataset) -> None:
    run = oversampled.records[0]
    late = replace(run, error_mask=run.t_s > 2.0)
    part, whole = close_up((late, oversampled.records[1].cut(slice(0, 5000))))
    assert (part.ts_s, part.t_s.size) == (run.ts_s, 7000)
    assert part.before_V.size == 7000 // 4
    assert part.t_s[np.argmax(part.error_mask)] == pytest.approx(2.0, abs=1e-3)
    assert whole.t_s.size == 5000


def test_small_records_leave_their_samples_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suitability, "SEARCH_MOST", 100_000)
    sizes = [10_000, 30_000, 90_000, 200_000]
    assert suitability._room(sizes) == 30_000
    assert sum(min(size, 30_000) for size in sizes) == 100_000


def test_squares_of_a_fit_are_bounded() -> None:
    many = 5 * MOST_SAMPLES
    t = np.arange(float(many))
    kept = kept_samples([Record("run", t, t, t, ts_s=1.0)], None)[0]
    assert [int(k) for k in kept[:3]] == [0, 5, 10]
    assert all(b - a == 5 for a, b in pairwise(kept[:100].tolist()))


@pytest.mark.usefixtures("few")
def test_a_discovery_reads_few_samples_and_judges_by_all(oversampled: Dataset) -> None:
    names = ("creep", "sensor_lag", "asymmetry")
    catalogue = {name: CATALOGUE[name] for name in names}
    data = replace(oversampled, records=oversampled.records[:2])
    found = discover(data, catalogue=catalogue)
    assert sorted(c.effect for c in found.added) == ["creep", "sensor_lag"]
    assert found.verdict == "explained"
    assert found.noise_floor_um == pytest.approx(NOISE_UM, rel=0.03)
    variant = Variant(found.plant.hysteresis, found.plant.effects)
    for record, error_um in zip(
        data.records, (found.final.by_record_um[n] for n in ("run", "other")), strict=True
    ):
        left = record.y_um - simulate_effects([variant], record)[:, 0]
        assert error_um == pytest.approx(float(np.std(left)), rel=1e-9)
    assert found.added[-1].errors == found.final
    assert [view.t_s.size for view in found.views] == [30_000, 20_000]
    assert any("over all 50,000 samples" in note for note in found.notes)


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_every_search_says_what_it_read(oversampled: Dataset) -> None:
    data = replace(oversampled, records=oversampled.records[:2])
    catalogue = {"sensor_lag": CATALOGUE["sensor_lag"]}
    given = replace(named_plant("P10"), effects=(Creep(gain_per_decade=0.02),))
    found = [
        diagnose(data, given, catalogue=catalogue),
        add_effect(data, SensorLag, given),
        remove_effect(data, given, "creep"),
    ]
    for each in found:
        assert any(note.startswith("the search read one sample in") for note in each.notes)
        assert set(each.final.by_record_um) == {"run", "other"}
        assert each.views[0].t_s.size == 30_000
