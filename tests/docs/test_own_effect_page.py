"""The page on an effect of one's own: its file, run as it stands there."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from rdpi_gym.cli import main
from rdpi_gym.plant import P5, PlantModel
from rdpi_gym.plant.effects import ENTRY_POINTS, Catalogue, load_effect
from rdpi_gym.support.errors import InputError

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "own-effect.md").read_text(encoding="utf-8")
BLOCKS = dict(re.findall(r"^```python (\S+)\n(.*?)^```$", PAGE, flags=re.M | re.S))


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A folder with the files of the page, from which the commands run."""
    for name, text in BLOCKS.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_effects", raising=False)
    yield tmp_path
    sys.modules.pop("my_effects", None)


def test_the_effect_takes_fewer_than_forty_lines():
    assert set(BLOCKS) == {"my_effects.py", "make_data.py"}
    assert len(BLOCKS["my_effects.py"].splitlines()) < 40


def test_the_effect_is_found_where_it_is_hidden(project, capsys):
    subprocess.run(
        [sys.executable, "make_data.py"], check=True, env={"PYTHONPATH": str(ROOT), "PATH": ""}
    )
    asked = ["--effect", "my_effects:SelfHeating", "--jobs", "1", "--out", "results"]
    assert main(["diagnose", "data", *asked]) == 0
    document = json.loads((project / "results" / "diagnosis.json").read_text(encoding="utf-8"))
    first = document["candidates"][0]
    assert first["effect"] == "self_heating"
    assert document["verdict"] == "explained"
    assert first["parameters"]["rise_um"] == pytest.approx(0.15, rel=0.05)
    assert first["parameters"]["time_constant_s"] == pytest.approx(0.8, rel=0.05)
    assert "self_heating" in capsys.readouterr().out


def test_its_parameters_mean_the_same_at_every_sampling_time(project):
    heating = load_effect("my_effects:SelfHeating")(rise_um=0.2, time_constant_s=0.5)
    ends = []
    for ts_s in (1e-3, 1e-4):
        ramp = [500.0 * k * ts_s for k in range(round(1.0 / ts_s) + 1)]
        ends.append(float(heating.run([0.0] * len(ramp), ts_s, u=ramp)[-1]))
    # 500 V/s for two time constants: d / 4 (1 - exp(-2))
    assert ends == pytest.approx([0.05 * (1 - 0.1353353)] * 2, rel=1e-6)


def test_a_saved_model_finds_it_once_it_is_installed(project):
    model = replace(P5, effects=(load_effect("my_effects:SelfHeating")(),))
    model.save(project / "model.json")
    with pytest.raises(InputError, match="no effect is named 'self_heating'"):
        PlantModel.load(project / "model.json")
    entry = re.search(rf'"{ENTRY_POINTS}"\]\n(\w+) = "(\S+)"', PAGE)
    assert entry is not None
    installed = project / "mine-0.1.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 0.1\n")
    (installed / "entry_points.txt").write_text(f"[{ENTRY_POINTS}]\n{entry[1]} = {entry[2]}\n")
    assert Catalogue()["self_heating"] is load_effect("my_effects:SelfHeating")
