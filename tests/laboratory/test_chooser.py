"""Files of a rig that the defaults do not read, in a real browser: none is a dead end."""

import gzip
import math

import numpy as np
import pytest

import rdpi_gym as rg
from studies.chromium import LabPage, LabProcess

HEADER = "Time [ms];Amplifier input [mV];Position [nm]"


def dropped(name, header, separator=";", scale=1e3, columns=3):
    """Make a file of 2000 samples, 1 ms apart, of a lagging actuator."""
    rows = [
        (k * 1e-3 * scale, scale * 5 * math.sin(k / 90), scale * 8 * math.sin(k / 90 - 0.2))
        for k in range(2000)
    ]
    lines = [header, *(separator.join(f"{x:.6f}" for x in row[-columns:]) for row in rows)]
    text = "\n".join(filter(None, lines)) + "\n"
    return {"name": name, "mimeType": "text/csv", "buffer": text.encode()}


def test_a_strangers_file_is_one_click_from_the_first_card(browser, tmp_path):
    """Prose, other headers, ms, mV and nm, semicolons, decimal commas, Latin-1, compressed."""
    made = dropped("messung.csv", "Zeit (ms);Steuerspannung (mV);Weg (nm)")
    text = "Prüfstand 2\nWerte;2000\n\n".encode("latin-1") + made["buffer"].replace(b".", b",")
    packed = {
        "name": "messung.csv.gz",
        "mimeType": "application/gzip",
        "buffer": gzip.compress(text),
    }
    with LabProcess(tmp_path / "session") as lab, LabPage(browser) as page:
        page.open(lab)
        page.tab.evaluate(
            "addEventListener('click', (e) => { window.clicks = (window.clicks ?? 0) + e.isTrusted; }, true)"
        )
        page.drop([packed])
        page.tab.get_by_test_id("taken-messung.csv.gz").wait_for()
        assert "header is line 4; 2 lines above it are left out" in page.text(
            "taken-messung.csv.gz"
        )
        page.click("apply-columns-messung.csv.gz")
        page.until_state("s.ranking && s.ranking.cards.some(c => c.state === 'tried')")
        page.tab.locator("#cards > li").first.wait_for()
        assert page.tab.evaluate("window.clicks") == 1
        assert not page.tab.get_by_test_id("alert").is_visible()
        page.click("cancel")
    (record,) = rg.load(tmp_path / "session" / "data").records
    assert (record.name, record.ts_s) == ("messung", pytest.approx(1e-3))
    assert (np.ptp(record.u_V), np.ptp(record.y_um)) == pytest.approx((10.0, 16.0), rel=1e-3)


def test_a_refused_file_in_an_empty_session_is_read_at_a_click(browser, tmp_path):
    with LabProcess(tmp_path / "session") as lab, LabPage(browser) as page:
        page.open(lab)
        page.drop([dropped("rig.csv", HEADER)])
        for visit in ("dropped", "reloaded"):
            page.tab.get_by_test_id("preview-rig.csv").wait_for()
            assert page.tab.get_by_test_id("drop").is_visible(), visit
            assert "column t: missing (time in s)" in page.text("refused-rig.csv")
            assert "--" not in page.text("refused-rig.csv")
            assert not page.tab.get_by_test_id("alert").is_visible()
            page.tab.keyboard.press("o")
            focused = page.tab.evaluate("document.activeElement.dataset.testid")
            assert focused == "choose-files", visit
            if visit == "dropped":
                page.tab.reload()
        shown = [
            page.tab.locator(f"[data-testid=column-{role}-rig\\.csv] option:checked").inner_text()
            for role in "tuy"
        ]
        assert shown == HEADER.split(";")
        assert [page.tab.get_by_test_id(f"unit-{role}-rig.csv").input_value() for role in "tuy"] == ["ms", "mV", "nm"]  # fmt: skip
        assert page.tab.locator("[data-testid=preview-rig\\.csv] tbody tr").count() == 8
        page.tab.get_by_test_id("unit-t-rig.csv").fill("fortnights")
        page.click("apply-columns-rig.csv")
        page.tab.get_by_text("unit 'fortnights' of t is unknown").wait_for()
        assert page.tab.get_by_test_id("drop").is_visible()
        page.tab.get_by_test_id("unit-t-rig.csv").fill("ms")
        page.click("apply-columns-rig.csv")
        page.tab.get_by_test_id("record-rig").wait_for()
        assert not page.tab.get_by_test_id("refused").is_visible()
        page.until_steps(1)  # a base model
        page.click("cancel")
        assert page.asked == []
    (record,) = rg.load(tmp_path / "session" / "data").records
    assert record.ts_s == pytest.approx(1e-3)
    assert (np.ptp(record.u_V), np.ptp(record.y_um)) == pytest.approx((10.0, 16.0), rel=1e-3)


def test_refused_files_beside_records_are_read_each_in_its_way(browser, tmp_path):
    with LabProcess(tmp_path / "session") as lab, LabPage(browser) as page:
        page.open(lab)
        good = dropped("good.csv", "t,u,y", ",", 1.0)
        alike = [dropped(name, "", "\t", 1.0, 2) for name in ("bare.dat", "twin.dat")]
        page.drop([good, *alike])
        page.tab.get_by_test_id("record-good").wait_for()
        page.click("columns-bare.dat")
        page.tab.get_by_test_id("preview-bare.dat").wait_for()
        assert "and 1 other file with the same columns" in page.text("refused-bare.dat")
        page.tab.get_by_test_id("sampling-bare.dat").fill("0,001")
        page.tab.get_by_test_id("separator-bare.dat").select_option("comma")
        page.tab.get_by_test_id("sampling-bare.dat").wait_for(state="visible")
        page.until(
            "document.querySelectorAll('[data-testid=\"preview-bare.dat\"] thead th').length === 1"
        )
        page.tab.get_by_test_id("separator-bare.dat").select_option("tab")
        page.until(
            "document.querySelectorAll('[data-testid=\"preview-bare.dat\"] thead th').length === 2"
        )
        page.tab.get_by_test_id("sampling-bare.dat").fill("0,001")
        page.click("apply-columns-bare.dat")
        for name in ("bare", "twin", "good"):
            page.tab.get_by_test_id(f"record-{name}").wait_for()
        assert not page.tab.get_by_test_id("refused").is_visible()
        assert page.said == []
    records = {r.name: r for r in rg.load(tmp_path / "session" / "data").records}
    assert {r.ts_s for r in records.values()} == {1e-3}
    np.testing.assert_array_equal(records["bare"].y_um, records["good"].y_um)
