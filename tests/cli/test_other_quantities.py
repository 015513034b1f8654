"""A force over a displacement: nothing that is printed, drawn or written names µm or V."""

import html
import json
import re
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from typer.testing import CliRunner

import rdpi_gym as rg
from rdpi_gym.cli import app
from rdpi_gym.measurement import Quantities, Quantity
from rdpi_gym.plant import P5, Plant
from rdpi_gym.plant.effects import load_effect
from tests.unpacked import read_page

# A title of the user's own holds words that must not be turned.
TITLE = "Damper: force (kN) over displacement (mm), beside 3 µm of play"
TOML = f"""title = "{TITLE}"
[quantities]
input = {{ name = "displacement", symbol = "x", unit = "mm" }}
output = {{ name = "force", symbol = "F", unit = "kN" }}
"""
SCRIPTS = r'<(script|style)( type="text/plain" id="plotly")?>.*?</\1>'
FOREIGN = re.compile(r"µm|\bV\b|[vV]oltage|put(_\w+)?}")


@pytest.fixture(scope="module")
def damper(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damper")
    (folder / "dataset.toml").write_text(TOML, encoding="utf-8")
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 2.0, 2e-3)
    for number, name in enumerate(("slow", "fast", "validation")):
        u = 15.0 * np.sin(2 * np.pi * (1 + number) * t) + 4.0 * np.sin(2 * np.pi * 7.3 * t)
        plant = Plant(replace(P5, effects=(load_effect("sensor_lag")(0.02),)), 2e-3)
        y = plant.simulate(u) + 0.02 * rng.normal(size=t.size)
        rows = np.column_stack((t, u, y))
        np.savetxt(folder / f"{name}.csv", rows, "%.9g", ",", header="t,u,y", comments="")
    return folder


def run(*words):
    words = (*words, "--verbose")
    result = CliRunner(env={"COLUMNS": "200"}).invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.output


def written(path):
    """What a reader of a file sees: without scripts and numbers in base 64, without the title."""
    text = read_page(path)
    if path.suffix == ".html":
        text = html.unescape(re.sub(SCRIPTS, "", text, flags=re.DOTALL))
    text = re.sub(r'"bdata": ?"[^"]*"', "", text)
    return re.sub(r"\\u([0-9a-f]{4})", lambda found: chr(int(found[1], 16)), text)


def foreign(text):
    return FOREIGN.findall(text.replace(TITLE, ""))


@pytest.mark.slow
def test_commands_and_pages_speak_of_force_and_displacement(damper, tmp_path):
    said = [run("fit", damper, "-n", 4, "--out", tmp_path / "fit")]
    model = tmp_path / "fit" / "model.json"
    said.append(run("compare", damper, "--model", model, "--out", tmp_path / "compare"))
    said.append(run("discover", damper, "--jobs", 1, "--out", tmp_path / "found"))
    for output in said:
        assert foreign(output) == []
        assert "kN" in output
        assert "from displacement x (mm) to force F (kN)" in output
    names = (
        "compare/report.html",
        "compare/compare.json",
        "found/report.html",
        "found/discovery.json",
    )
    for name in names:
        text = written(tmp_path / name)
        assert foreign(text) == [], name
        assert TITLE in text, name
    page = written(tmp_path / "compare" / "report.html")
    assert "Force (kN)" in page
    assert "RMSE (kN)" in page
    numbers = json.loads((tmp_path / "compare" / "compare.json").read_text(encoding="utf-8"))
    assert numbers["units"] == {"error": "kN", "command": "mm", "rate": "mm/s", "frequency": "Hz"}
    found = json.loads((tmp_path / "found" / "discovery.json").read_text(encoding="utf-8"))
    assert found["units"] == {"error": "kN", "command": "mm"}
    assert found["quantities"]["output"] == {"name": "force", "symbol": "F", "unit": "kN"}


def test_results_show_and_keep_their_quantities(damper, tmp_path):
    data = rg.load(damper)
    model = rg.fit(data, plays=4)
    compared = rg.compare(data, model)
    for result in (data, model, compared):
        assert foreign(repr(result)) == []
        assert foreign(" ".join(map(str, result.overview().columns))) == []
        again = rg.load_result(result.save(tmp_path / "result.npz"))
        assert again.quantities == data.quantities
        assert foreign(result.page(tmp_path / "page.html").read_text()[-1000:]) == []
    assert set(model.to_dataframe()["unit"]) == {"mm", "s", "kN/mm"}
    with mpl.rc_context({"backend": "Agg"}):
        axes = compared.plot()
    assert axes[0].get_ylabel() == "Force (kN)"
    assert axes[1].get_xlabel() == "Command (mm)"


def test_errors_speak_of_them_too(damper):
    data = rg.load(damper)
    falling = [type(r)(r.name, r.t_s, r.u_V, -r.y_um, r.ts_s) for r in data.records]
    with pytest.raises(rg.InputError, match=r"^the force falls where the displacement rises"):
        rg.fit(type(data)(data.title, tuple(falling), quantities=data.quantities))


def test_a_sentence_that_comes_twice_is_turned_once():
    """Units that stand for each other's: a sensor that gives volts, of a force."""
    sensor = Quantities(Quantity("displacement", "x", "µm"), Quantity("voltage", "U", "V"))
    plain = "The voltage moves 3 V while the displacement moves 2 µm (5 µm/s)."
    template = "{Input} {output}: 3 {output_unit} while the {input} moves 2 {input_unit}"
    once = sensor.fill(template)
    assert once == "Displacement voltage: 3 V while the displacement moves 2 µm"
    assert sensor.fill(once) == once
    assert sensor.said("The displacement moves 3 µm while the voltage moves 2 V (5 V/s).") == plain
    assert Quantities().said(plain) == plain


def test_words_of_a_file_are_no_markup_on_its_page(damper, tmp_path):
    data = rg.load(damper)
    evil = Quantities(data.quantities.input, Quantity("<b>force</b>", "F", "<i>kN</i>"))
    page = rg.compare(replace(data, quantities=evil), "P5").page(tmp_path / "page.html")
    text = read_page(page)
    text = re.sub(SCRIPTS, "", text, flags=re.DOTALL)
    assert "&lt;i&gt;kN" in text
    assert not re.search(r"(<|\\u003c)[bi](>|\\u003e)", text)
