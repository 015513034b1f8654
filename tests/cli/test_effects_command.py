"""`rdpi effects`: the catalogue on the terminal and as files."""

import json

import pytest
import typer
from typer.testing import CliRunner

from rdpi_gym.cli.models import effects
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.errors import InputError
from tests.looping import over

app = typer.Typer(rich_markup_mode=None)
app.command()(effects)


def run(*words: str) -> str:
    result = CliRunner(env={"COLUMNS": "140"}).invoke(app, list(words))
    if result.exception is not None:
        raise result.exception
    return result.output


def test_the_list_shows_every_effect_with_its_parameters(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shown = run()
    for name, kind in CATALOGUE.items():
        assert name in shown
        assert all(p.name in shown for p in kind.parameters)
    assert not list(tmp_path.iterdir())


@over("name", ["creep", "mains_hum"])
def test_one_effect_is_shown_in_full(name):
    shown = " ".join(run(name).split())
    kind = CATALOGUE[name]
    for text in (kind.equation, kind.signature, kind.experiment, *kind.mistaken_for):
        assert text in shown


def test_files_hold_the_whole_catalogue(tmp_path):
    run("--out", str(tmp_path / "new"))
    document = json.loads((tmp_path / "new" / "effects.json").read_text(encoding="utf-8"))
    assert (document["format"], document["version"]) == ("rdpi-effects", 1)
    assert [e["effect"] for e in document["effects"]] == list(CATALOGUE)
    by_name = {e["effect"]: e for e in document["effects"]}
    assert by_name["delay"]["parameters"][0]["unit"] == "s"
    text = (tmp_path / "new" / "effects.md").read_text(encoding="utf-8")
    assert [line[3:] for line in text.splitlines() if line.startswith("## ")] == list(CATALOGUE)


def test_files_of_one_effect_hold_that_one(tmp_path):
    run("backlash", "--out", str(tmp_path))
    document = json.loads((tmp_path / "effects.json").read_text(encoding="utf-8"))
    assert [e["effect"] for e in document["effects"]] == ["backlash"]


def test_an_unknown_name_is_refused():
    with pytest.raises(InputError, match="no effect is named 'crep'; known are"):
        run("crep")


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "taken").write_text("x")
    with pytest.raises(InputError, match="cannot be written"):
        run("--out", str(tmp_path / "taken"))
