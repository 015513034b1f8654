"""The page of the laboratory in a real browser: what it shows, and what it does at a click."""

import math
import re
from contextlib import contextmanager

import pytest

from rdpi_gym.laboratory.server import PAGE
from rdpi_gym.report import style
from studies.chromium import LabPage
from tests.laboratory.fake import Laboratory, candidate, empty_state

_WAIT_MS, _STEP_MS = 30_000, 20


@contextmanager
def empty_page(browser):
    """A server without records and its page, with the messages of the console and the requests."""
    lab = Laboratory(samples=4000)
    lab.start()
    with LabPage(browser) as shown:
        page = shown.tab
        page.set_default_timeout(_WAIT_MS)
        page.said, page.asked = shown.said, shown.asked
        page.goto(lab.place.address)
        yield lab, page
    if lab.running:
        lab.stop()


@pytest.fixture(scope="module")
def opened(browser):
    """One page for all tests that begin by opening records."""
    with empty_page(browser) as found:
        yield found


@pytest.fixture
def begun(opened):
    """The page with three records and the base model."""
    lab, page = opened
    lab.seen.clear()
    lab.open(3)
    until(page, "document.querySelectorAll('#staircase .step').length === 1")
    page.mouse.move(5, 5)
    return lab, page


def until(page, told):
    """Wait until an expression is true; the page's policy forbids the browser's own way to wait."""
    for _ in range(_WAIT_MS // _STEP_MS):
        if page.evaluate(told):
            return
        page.wait_for_timeout(_STEP_MS)
    raise AssertionError(told)


def drag(page, name, first, last):
    box = page.get_by_test_id(name).bounding_box()
    at = [box["x"] + 46 + share * (box["width"] - 56) for share in (first, last)]
    middle = box["y"] + 0.5 * box["height"]
    page.mouse.move(at[0], middle)
    page.mouse.down()
    page.mouse.move(at[1], middle, steps=3)
    page.mouse.up()


def order(page):
    ids = page.locator("#cards > li").evaluate_all("cards => cards.map(c => c.dataset.testid)")
    return [each.removeprefix("card-") for each in ids]


def steps(page):
    return page.locator("#staircase .step .label").all_text_contents()


def test_what_to_do_first_stands_on_the_empty_page(browser):
    with empty_page(browser) as (_, page):
        page.get_by_test_id("example-one-effect").wait_for()
        assert page.get_by_test_id("drop").is_visible()
        assert "Drop a CSV here" in page.get_by_test_id("drop").inner_text()
        assert not page.get_by_test_id("staircase").is_visible()


def test_cards_sort_themselves_as_errors_arrive(begun):
    lab, page = begun
    cards = [candidate(e, e.title(), "It.", None, state="waiting") for e in ("lag", "creep", "hum")]
    lab.state["ranking"] |= {"status": "running", "verdict": None, "cards": cards}
    lab.push()
    page.get_by_test_id("card-hum").wait_for()
    assert order(page) == ["creep", "hum", "lag"]  # by name: nothing is known yet
    for effect, error in (("hum", 0.4), ("lag", 0.2)):
        lab.push("card", candidate(effect, effect.title(), "It.", error))
    until(page, "document.querySelector('#cards > li').dataset.testid === 'card-lag'")
    assert order(page) == ["lag", "hum", "creep"]


def bar_share(page, effect):
    """Return the filled share of a card's bar."""
    return (
        page.get_by_test_id(f"card-{effect}")
        .locator(".meter")
        .evaluate(
            "bar => bar.firstChild.getBoundingClientRect().width / bar.getBoundingClientRect().width"
        )
    )


def test_the_bar_of_a_card_is_the_removed_share_whatever_another_refit_leaves(begun):
    lab, page = begun
    bad = candidate("hum", "Hum", "It.", 1e4, share=-1e9)
    lab.state["ranking"]["cards"].append(bad)
    lab.push()
    page.get_by_test_id("spare").click()
    page.get_by_test_id("card-hum").wait_for()
    page.wait_for_timeout(300)  # the bars' transition
    assert bar_share(page, "creep") == pytest.approx(0.81, abs=0.01)
    assert bar_share(page, "asymmetry") == pytest.approx(0.07, abs=0.01)
    assert bar_share(page, "hum") == 0.0
    text = page.get_by_test_id("card-creep").inner_text()
    assert "removes 81 % of the squared error above noise" in text
    page.get_by_test_id("spare").click()


def test_candidates_that_remove_nothing_are_folded_when_the_ranking_has_ended(begun):
    lab, page = begun
    hum = candidate("hum", "Hum", "It.", 0.5, share=0.001, state="final")
    lab.state["ranking"]["cards"].append(hum)
    lab.push()
    spare = page.get_by_test_id("spare")
    spare.get_by_text("Show 2 effects that remove nothing").wait_for()
    assert spare.get_attribute("aria-expanded") == "false"
    for effect, seen in (("creep", True), ("hum", False), ("saturation", False)):
        assert page.get_by_test_id(f"card-{effect}").is_visible() is seen
    spare.click()
    assert page.get_by_test_id("card-hum").is_visible()
    spare.click()
    lab.state["ranking"]["status"] = "running"
    lab.push()
    page.get_by_test_id("card-hum").wait_for()
    assert not spare.is_visible()


def test_only_the_button_of_a_card_adds_its_effect(begun):
    lab, page = begun
    card = page.get_by_test_id("card-creep")
    for part in (card.locator("h3"), card.locator(".mechanism"), card.locator(".meter")):
        part.click(force=True)
    page.get_by_test_id("add-creep").click()
    page.get_by_test_id("effect-creep").wait_for()
    assert [path for method, path, _ in lab.seen if method == "POST"] == ["/api/add"]


def test_the_staircase_names_its_unit_and_its_scale(begun):
    _, page = begun
    axis = page.locator("#staircase .axis").inner_text()
    assert "rms error on records held out, µm, log scale" in axis


def test_the_measurement_shows_through_the_model(begun):
    _, page = begun
    for plot in ("trace", "loop"):
        until(page, f"document.getElementById('{plot}').data?.length >= 2")
        names, widths, dashes = page.evaluate(
            f"[['name'], ['line', 'width'], ['line', 'dash']].map((path) => "
            f"document.getElementById('{plot}').data.map((of) => path.reduce((o, k) => o[k], of)))"
        )
        assert names[:2] == ["measured", "model"]
        assert widths[0] > widths[1]
        assert (dashes[0], dashes[1]) == ("solid", "4px,3px")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_an_audit_finds_no_barrier(begun, scheme):
    audit = pytest.importorskip("axe_playwright_python.sync_playwright", reason="extra: test")
    _, page = begun
    page.emulate_media(color_scheme=scheme)
    found = audit.Axe().run(page).response["violations"]
    page.emulate_media(color_scheme="light")
    assert [(each["impact"], each["id"], each["nodes"][0]["html"]) for each in found] == []


def test_an_effect_is_added_undone_redone_and_gone_back_from(begun):
    lab, page = begun
    assert steps(page) == ["Base model"]
    page.get_by_test_id("add-creep").click()
    page.get_by_test_id("effect-creep").wait_for()
    assert steps(page) == ["Base model", "+ creep"]
    page.keyboard.press("u")
    page.get_by_test_id("effect-creep").wait_for(state="detached")
    assert page.locator(".step.later .label").all_text_contents() == ["+ creep"]
    assert page.get_by_test_id("undo").is_disabled()
    page.get_by_test_id("redo").click()
    page.get_by_test_id("effect-creep").wait_for()
    page.get_by_test_id("step-s0").click()
    page.get_by_test_id("effect-creep").wait_for(state="detached")
    asked = [path.removeprefix("/api/") for method, path, _ in lab.seen if method == "POST"]
    assert asked == ["add", "undo", "redo", "go"]


def test_an_answer_that_comes_late_does_not_bring_back_what_was(begun):
    lab, page = begun
    late = []
    page.route("**/api/add", lambda route: late.append((route, route.fetch())))
    page.get_by_test_id("add-creep").click()
    page.get_by_test_id("effect-creep").wait_for()  # pushed, and not answered yet
    lab.open(3)
    page.get_by_test_id("effect-creep").wait_for(state="detached")
    [(route, answer)] = late
    with page.expect_response("**/api/add") as answered:
        route.fulfill(response=answer)
    assert answered.value.json()["path"] == ["s0", "s1"]
    page.wait_for_timeout(100)
    page.unroute("**/api/add")
    assert steps(page) == ["Base model"]


def test_where_nothing_is_missing_the_model_is_taken_in_few_numbers(begun):
    lab, page = begun
    assert page.get_by_test_id("settle").is_hidden()
    lab.state["ranking"] |= {"settled": {"train_um": 0.012, "validation_um": 0.0123}}
    lab.push()
    page.get_by_role("button", name="Take it in few numbers: 0.0123 µm").click()
    page.get_by_test_id("step-s1").wait_for()
    assert steps(page) == ["Base model", "In few numbers"]
    page.get_by_test_id("settle").wait_for(state="hidden")


def test_a_step_that_is_bettered_in_place_is_drawn_anew(begun):
    lab, page = begun
    until(page, "document.getElementById('command').data?.length > 0")
    lab.seen.clear()
    lab.state["steps"]["s0"]["errors"] |= {"validation_um": 0.123}
    lab.push()
    page.get_by_test_id("step-s0").get_by_text("0.123").wait_for()
    for _ in range(_WAIT_MS // _STEP_MS):
        asked = {path for _, path, _ in lab.seen}
        if {"/api/trace", "/api/views"} <= asked:
            break
        page.wait_for_timeout(_STEP_MS)
    assert {"/api/trace", "/api/views"} <= asked


def test_the_pointed_candidate_is_drawn_over_the_residual(begun):
    _, page = begun
    page.get_by_test_id("card-creep").hover()
    until(page, "document.getElementById('residual').data.length === 2")
    assert page.locator("#residual-words").inner_text().endswith("with creep")
    page.mouse.move(5, 5)
    until(page, "document.getElementById('residual').data.length === 1")
    page.get_by_test_id("add-thermal_drift").focus()
    until(page, "document.getElementById('residual').data.length === 2")
    page.get_by_test_id("undo").focus()
    page.get_by_test_id("theme").focus()
    until(page, "document.getElementById('residual').data.length === 1")


def test_a_brushed_stretch_is_seen_in_every_view(begun):
    _, page = begun
    drag(page, "trace", 0.25, 0.5)
    drawn = """["loop", "command", "rate", "frequency"].filter(
      (view) => document.getElementById(view).data.some(({name}) => name === "stretch")).length"""
    until(page, f"{drawn} === 4")
    for name in ("trace", "residual"):
        marked = page.evaluate(f"document.getElementById('{name}').layout.shapes")
        (shape,) = [s for s in marked if s["name"] == "brushed"]
        assert shape["x0"] == pytest.approx(0.25 * 0.2, abs=2e-3)
        assert shape["x1"] == pytest.approx(0.5 * 0.2, abs=2e-3)
    drag(page, "view-command", 0.2, 0.6)
    until(page, "document.getElementById('command').layout.shapes.length === 2")
    page.keyboard.press("Escape")
    until(page, f"{drawn} === 0")
    low, high = page.evaluate("document.getElementById('frequency')._fullLayout.yaxis.range")
    drawn_um = page.evaluate("document.getElementById('frequency').data.flatMap((line) => line.y)")
    ends = math.log10(min(drawn_um)) - 0.05, math.log10(max(drawn_um)) + 0.05
    assert (low, high) == pytest.approx(ends, abs=1e-3)  # as what is drawn


def test_zooming_asks_for_the_stretch_again(begun):
    lab, page = begun
    page.keyboard.press("z")
    drag(page, "residual", 0.5, 0.75)
    until(page, "document.getElementById('trace').data[0].x.length < 1100")
    asked = [of for _, path, of in lab.seen if path == "/api/trace"][-1]
    assert float(asked["from_s"]) == pytest.approx(0.5 * 0.2, abs=2e-3)
    page.keyboard.press("0")
    until(page, "document.getElementById('trace').data[0].x.length > 1100")
    page.keyboard.press("b")


def test_a_stretch_is_left_out_by_dragging(begun):
    lab, page = begun
    page.get_by_test_id("mode-mask").click()
    drag(page, "trace", 0.5, 0.6)
    page.get_by_test_id("unmask-0").wait_for()
    ((first, last),) = next(r["masked_s"] for r in lab.state["records"] if r["masked_s"])
    assert (first, last) == pytest.approx((0.1, 0.12), abs=2e-3)
    shown = page.locator("#records [aria-current]").get_attribute("data-testid")
    record = next(r for r in lab.state["records"] if shown == f"record-{r['name']}")
    record["skip_s"] = 0.3  # and what is shown begins there
    lab.push()
    page.get_by_test_id("mode-skip").click()
    drag(page, "trace", 0.0, 0.25)
    until(page, "document.querySelector('[data-testid=skip]').value > 0.3")
    assert record["skip_s"] == pytest.approx(0.35, abs=2e-3)


def test_a_dragged_parameter_asks_as_fast_as_answers_come_and_is_kept_at_the_end(begun):
    lab, page = begun
    page.get_by_test_id("add-creep").click()
    slider = page.get_by_test_id("slider-creep-gain_per_decade")
    slider.wait_for()
    moves = 30
    slider.evaluate(f"""(slider) => {{
      for (let i = 0; i < {moves}; i += 1) {{ slider.value = 200 + i; slider.dispatchEvent(new Event("input")); }}
    }}""")
    until(
        page,
        "document.querySelector('[data-testid=spread-creep-gain_per_decade]').textContent.startsWith('error')",
    )
    slider.evaluate("(slider) => slider.dispatchEvent(new Event('change'))")
    until(page, "document.querySelectorAll('#staircase .step').length === 3")
    asked = [of for _, path, of in lab.seen if path == "/api/parameter"]
    assert len(asked) < moves / 3
    assert [of["commit"] for of in asked].count(True) == 1
    assert asked[-1]["value"] == pytest.approx(0.045 * 229 / 1000)


def test_a_reference_is_drawn_with_the_arrow_keys(begun):
    lab, page = begun
    page.get_by_test_id("kind-drawn").check(force=True)
    knot = page.get_by_test_id("knot-4")
    knot.press("Home")
    knot.press("ArrowUp")
    page.get_by_test_id("amplitude").fill("2")
    page.get_by_test_id("simulate").click()
    page.get_by_test_id("payoff-table").wait_for()
    points = lab.state["payoff"]["reference"]["points"]
    assert points[4] == pytest.approx([0.25, (2 / 40 - 1) * 2])
    table = page.get_by_test_id("payoff-table")
    assert "Outside its stability limit" in table.inner_text()
    # no measurement would show 1.7e-8 µm: neither the error nor a gain of 1.6e7
    cells = table.locator("tr", has_text="extended inverse").locator("td").all_inner_texts()
    assert cells == ["0.280 5.6 %", "below sensor noise", "> 13×"]
    page.evaluate("scrollTo(0, 0)")


def test_many_records_with_long_names_and_other_units_fit_on_the_page(opened):
    lab, page = opened
    lab.open(40, ["creep", "resonance"])
    lab.state["records"][0]["name"] = 3 * "a-name-without-any-blank-" + "0"
    lab.state["title"] = 12 * "A long title "
    lab.state["quantities"]["output"] = {"name": "force", "symbol": "F", "unit": "kN"}
    lab.push()
    until(page, "document.querySelectorAll('#records > li').length === 40")
    until(
        page, "document.getElementById('trace-title').textContent.startsWith('Force over time, kN')"
    )
    page.set_viewport_size({"width": 1920, "height": 1080})
    page.wait_for_timeout(100)
    page.set_viewport_size({"width": 1280, "height": 720})
    page.wait_for_timeout(100)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    for column in (
        "part-data",
        "part-compare",
        "part-learn",
        "part-left",
        "part-buys",
        "part-home",
    ):
        beyond = page.evaluate(
            f"(() => {{ const e = document.getElementById('{column}'); return e.scrollWidth - e.clientWidth; }})()"
        )
        assert beyond <= 0, column


def test_every_control_has_a_name(begun):
    _, page = begun
    nameless = page.evaluate("""() => [...document.querySelectorAll("button, select, input, a[href], [role=slider]")]
      .filter((e) => e.checkVisibility() && !(e.getAttribute("aria-label") || e.textContent.trim() || e.labels?.length))
      .map((e) => e.outerHTML)""")
    assert nameless == []


def test_colours_are_those_of_the_pages():
    css = (PAGE / "lab.css").read_text(encoding="utf-8").split('data-theme="dark"')[0]
    said = dict(re.findall(r"--([a-z-]+): (#[0-9A-F]{6});", css))
    meant = {
        "ink": style.INK, "muted": style.MUTED, "line": style.GRID, "paper": style.PAPER, "edge": style.REFERENCE,
        "measured": style.MEASURED, "model": style.MODEL, "reference": style.REFERENCE, "rising": style.RISING,
        "falling": style.FALLING, "residual": style.RESIDUAL, "accent": style.PALETTE[0],
    }  # fmt: skip
    assert {name: said[name] for name in meant} == meant


def test_nothing_was_said_by_the_console_nor_asked_of_others(begun):
    _, page = begun
    page.keyboard.press("t")
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    page.keyboard.press("t")
    assert page.said == []
    assert page.asked == []


def test_what_is_refused_is_told_and_goes_away(begun):
    lab, page = begun
    lab.refuse = "creep: the model has it already; take another"
    page.get_by_test_id("add-creep").click()
    alert = page.get_by_test_id("alert")
    alert.get_by_text(lab.refuse or "creep: the model has it already; take another").wait_for()
    page.get_by_test_id("alert-close").click()
    assert not alert.is_visible()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_refused_file_is_read_in_another_way(begun, scheme):
    lab, page = begun
    names = ("bad.csv", "worse.csv")
    about = {"bytes": 3, "problem": "column t: missing", "row": 1, "column": "t"}
    lab.state["files"] += [about | {"name": name} for name in names]
    lab.push()
    page.get_by_test_id("columns-bad.csv").click()
    page.get_by_test_id("preview-bad.csv").get_by_text("0.3").wait_for()
    page.emulate_media(color_scheme=scheme)
    audit = pytest.importorskip("axe_playwright_python.sync_playwright", reason="extra: test")
    found = audit.Axe().run(page).response["violations"]
    page.emulate_media(color_scheme="light")
    assert [(each["impact"], each["id"], each["nodes"][0]["html"]) for each in found] == []
    assert not page.get_by_test_id("sampling-bad.csv").is_visible()
    page.get_by_test_id("column-u-bad.csv").select_option("column 2")
    assert page.get_by_test_id("unit-u-bad.csv").input_value() == "mV"  # it names none of its own
    page.get_by_test_id("column-y-bad.csv").select_option("Command [mV]")
    assert page.get_by_test_id("unit-y-bad.csv").input_value() == "mV"
    page.get_by_test_id("column-t-bad.csv").select_option("none: sampling time")
    page.get_by_test_id("apply-columns-bad.csv").click()
    refused = page.get_by_test_id("refused-bad.csv")
    refused.get_by_text("there is no time column; give the sampling time in s").wait_for()
    page.get_by_test_id("sampling-bad.csv").fill("5e-4")
    lab.refuse = "dataset.toml: unit 'mV' of y"
    page.get_by_test_id("apply-columns-bad.csv").click()
    refused.get_by_text("dataset.toml: unit 'mV' of y").wait_for()
    assert page.get_by_test_id("column-u-bad.csv").input_value() == "2"  # as it was set
    page.get_by_test_id("apply-columns-bad.csv").click()
    refused.wait_for(state="detached")
    [change] = [of for _, path, of in lab.seen if path == "/api/settings"][1:]
    chosen = {"t": "", "u": 2, "y": "Command [mV]"}
    assert change["records"]["bad"]["columns"] == change["records"]["worse"]["columns"] == chosen
    assert change["records"]["bad"]["ts_s"] == 5e-4


def test_many_refused_files_fold_behind_one_line(begun):
    lab, page = begun
    about = {"bytes": 3, "problem": "column t: missing", "row": 1, "column": "t"}
    lab.state["files"] += [about | {"name": f"{k}.csv"} for k in range(6)]
    lab.push()
    page.get_by_test_id("refused-others").get_by_text("4 more files could not be read").wait_for()
    shown = [page.get_by_test_id(f"refused-{k}.csv").is_visible() for k in range(6)]
    assert shown == [True, True, False, False, False, False]
    page.get_by_test_id("refused-others").click()
    lab.state["files"] = [f for f in lab.state["files"] if f["name"] != "0.csv"]
    lab.push()
    page.get_by_test_id("refused-others").get_by_text("3 more files").wait_for()
    assert page.get_by_test_id("refused-5.csv").is_visible()  # unfolded as the reader left it


def test_files_that_cannot_be_read_together_can_be_taken_out(begun):
    lab, page = begun
    lab.state = empty_state() | {"problem": "run.csv and run.mat are both record 'run'; rename one"}
    about = {"bytes": 3, "problem": None, "row": None, "column": None}
    lab.state["files"] = [about | {"name": name} for name in ("run.csv", "run.mat")]
    lab.push()
    page.get_by_test_id("refused-run.csv").wait_for()
    assert page.get_by_test_id("drop").is_visible()
    assert "rename one" in page.get_by_test_id("alert").inner_text()
    page.get_by_test_id("discard-run.mat").click()
    page.get_by_test_id("record-sine-00").wait_for()  # what is left is read at once


def test_what_is_dropped_anywhere_is_read_and_what_is_no_record_is_told(begun):
    lab, page = begun
    page.evaluate("""() => {
      const carried = new DataTransfer();
      for (const name of ["README.md", "a b.csv"]) carried.items.add(new File(["t,u,y"], name));
      document.body.dispatchEvent(new DragEvent("drop", {dataTransfer: carried, bubbles: true}));
    }""")
    page.get_by_text("README.md is no record; give a CSV file").wait_for()
    sent = [(method, path) for method, path, _ in lab.seen if method in ("PUT", "POST")]
    assert sent == [
        ("PUT", "/api/files/README.md"),
        ("PUT", "/api/files/a%20b.csv"),
        ("POST", "/api/open"),
    ]
    page.get_by_test_id("record-sine-00").wait_for()


def test_a_dying_server_is_told_in_a_sentence_and_the_page_goes_on_when_it_is_back(begun):
    lab, page = begun
    lab.stop()
    until(page, "document.body.classList.contains('lost')")
    assert "server has stopped; nothing is lost" in page.get_by_test_id("alert").inner_text()
    assert lab.state["session_folder"] in page.get_by_test_id("alert").inner_text()
    lab.add("creep")
    lab.start()
    page.get_by_test_id("effect-creep").wait_for()
    assert not page.get_by_test_id("alert").is_visible()
