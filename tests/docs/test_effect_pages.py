"""The effects' pages are what their files say, and their pictures what the effects do."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.linear import lag_step
from rdpi_gym.virtual_lab import HIDEABLE
from studies import effect_pages as command
from studies.effect_pages import (
    PICTURES,
    bare_records,
    page_texts,
    pair_of,
    panels_of,
    stored_rows,
    tracked,
)
from tests.looping import over

PAGES = Path(__file__).parents[2] / "docs" / "effects"
MAKE = "run python -m studies.effect_pages"


@pytest.fixture(scope="module")
def without():
    return bare_records()


def test_every_effect_has_a_page():
    own = {name for name, kind in CATALOGUE.items() if kind.__module__.startswith("rdpi_gym.")}
    assert set(PICTURES) == own & set(HIDEABLE)


@over("name", list(page_texts()))
def test_committed_page_is_what_the_command_makes(name):
    assert (PAGES / name).read_text(encoding="utf-8") == page_texts()[name], MAKE


def test_pictures_are_small_and_no_file_is_left_over():
    pictures = {f"{name}.png" for name in PICTURES}
    assert {path.name for path in PAGES.iterdir()} == pictures | set(page_texts())
    for name in pictures:
        content = (PAGES / name).read_bytes()
        assert content.startswith(b"\x89PNG")
        assert len(content) < 40_000, name


@over("name", list(PICTURES))
def test_a_page_says_all_that_its_file_declares(name):
    kind, text = CATALOGUE[name], (PAGES / f"{name}.md").read_text(encoding="utf-8")
    said = (kind.equation, kind.source, kind.signature, kind.experiment)
    practice = (kind.cause, kind.hardware, kind.magnitude, kind.remedy)
    assert all(practice)
    for sentence in said + practice:
        assert sentence in text
    for row in stored_rows(name):
        assert f"| {row.unknown_um:.3g} µm | {row.known_um:.3g} µm |" in text
    for parameter in kind.parameters:
        assert f"| `{parameter.name}` | {parameter.meaning} | {parameter.unit} |" in text
    for other in kind.mistaken_for:
        assert f"[`{other}`]({other}.md)" in text


@over("name", ["creep", "slew_limit"])
def test_committed_tracking_errors_are_what_the_command_computes(name):
    computed = list(tracked(CATALOGUE[name]().with_values(PICTURES[name].values)))
    for ours, stored in zip(computed, stored_rows(name), strict=True):
        assert (ours.effect, ours.reference, ours.warning) == (
            stored.effect, stored.reference, stored.warning,
        )  # fmt: skip
        for column in ("without_um", "unknown_um", "known_um"):
            assert getattr(ours, column) == pytest.approx(getattr(stored, column), rel=1e-5), MAKE


def test_what_an_inverse_knows_it_takes_out():
    """Save for effects without an inverse, knowing an effect leaves at most half of what it costs."""
    for name in PICTURES:
        worst = max(stored_rows(name), key=lambda row: row.unknown_um - row.without_um)
        if "passed over" in worst.warning:
            assert worst.known_um == worst.unknown_um
        else:
            cost = worst.unknown_um - worst.without_um
            assert worst.known_um - worst.without_um < 0.5 * cost, name


def test_delay_turns_the_phase_and_keeps_the_gain(without):
    study = pair_of("delay", without)
    bare, turned = command.phase(study, "").marks
    np.testing.assert_allclose(bare.y, 0.0, atol=1e-6)
    np.testing.assert_allclose(
        turned.y, -360.0 * turned.x * study.effect.values["delay_s"], atol=0.05
    )
    same, gain = command.gain(study, "").marks
    np.testing.assert_allclose(gain.y, same.y, rtol=1e-4)


def test_sensor_lag_lowers_the_gain(without):
    study = pair_of("sensor_lag", without)
    bare, lower = command.gain(study, "").marks
    ts_s, tau_s = study.having["multisine-small"].ts_s, study.effect.values["time_constant_s"]
    # a first-order lag behind a command that is linear between samples
    decay, before, after = lag_step(tau_s, ts_s)
    one_sample = np.exp(-2j * np.pi * lower.x * ts_s)
    gain = np.abs((after + before * one_sample) / (1.0 - decay * one_sample))
    np.testing.assert_allclose(lower.y, bare.y * gain, rtol=1e-3)


def test_gain_drift_shows_in_a_repeat(without):
    study = pair_of("gain_drift", without)
    panel = command.repeats(study, "", "triangle-slow", "triangle-slow-again")
    bare, drifted = panel.marks
    np.testing.assert_allclose(bare.y, 0.0, atol=1e-9)
    records = study.having
    apart_s = records["triangle-slow-again"].t_s[0] - records["triangle-slow"].t_s[0]
    slope = np.polyfit(drifted.x, drifted.y, 1)[0]
    assert slope == pytest.approx(3e-4 * apart_s, rel=0.02)


def test_every_picture_shows_its_effect(without):
    """Each line with the effect is told from the one without it, and labels carry units."""
    for name in ("backlash", "mains_hum"):
        for panel in panels_of(name, pair_of(name, without)):
            assert panel.x.label.endswith(")")
            assert panel.y.label.endswith(")")
            assert max(np.nanmax(np.abs(line.y)) for line in panel.marks) > 0.02


def test_the_command_writes_pages_and_pictures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(command, "PICTURES", {"delay": PICTURES["delay"]})
    monkeypatch.setattr(command, "TABLE", tmp_path / "table.csv")
    monkeypatch.setattr(command, "tracking_table", lambda: pd.DataFrame({"effect": ["delay"]}))
    assert command.main(["--out", str(tmp_path / "new")]) == 0
    assert (tmp_path / "table.csv").read_text() == "effect\ndelay\n"
    assert {path.name for path in (tmp_path / "new").iterdir()} == {*page_texts(), "delay.png"}
    assert str(tmp_path) in capsys.readouterr().out


def test_a_folder_that_is_a_file_is_refused(tmp_path, capsys):
    (tmp_path / "taken").write_text("x")
    assert command.main(["--out", str(tmp_path / "taken"), "--text-only"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
