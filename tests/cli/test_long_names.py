"""Names that no system has, and refusals that would be long: one line of less than 400 characters."""

import os

import numpy as np
import pytest

import rdpi_gym as rg
from rdpi_gym.cli import main
from rdpi_gym.support.errors import InputError
from tests.looping import over

NAMES = {
    "300 letters": "a" * 300,
    "300 letters and an ending": "a" * 300 + ".csv",
    "5000 letters": "a" * 5000,
    "a long path": "/".join(["d" * 200] * 30),
    "through a file": "run.csv/x",
    "links in a ring": "ring",
}
COMMANDS = [
    "fit @", "fit run.csv --out @", "compare @", "compare run.csv @", "discover @", "diagnose @",
    "diagnose run.csv --model @", "add creep @ --model P5", "add creep run.csv --model @",
    "simulate --model @", "simulate --ts-factor 4 --out @", "verify @", "export c @", "export c P5 --out @",
    "export fmu @", "export fmu P5 --out @/x.fmu", "lab @", "lab --session @", "effects --out @",
    "effects @", "train @", "tune @", "collect @", "bench --out @", "submit @", "score @",
    "fit run.csv --columns @", "fit run.csv --core @", "fit run.csv --validate @",
    "fit run.csv --units y=@",
]  # fmt: skip


@pytest.fixture
def here(tmp_path, monkeypatch):
    t = np.arange(200) * 5e-3
    u = 20.0 * np.sin(6.0 * t)
    rows = (f"{a},{b},{0.6 * b}\n" for a, b in zip(t, u, strict=True))
    (tmp_path / "run.csv").write_text("t,u,y\n" + "".join(rows))
    (tmp_path / "ring").symlink_to("ring")
    monkeypatch.chdir(tmp_path)


@over("name", NAMES.values())
@over("command", COMMANDS)
def test_a_command_refuses_a_name_in_one_line(command, name, here, capsys):
    assert main([word.replace("@", name) for word in command.split()]) == 2
    said = capsys.readouterr().err
    assert said.startswith("rdpi: ")
    assert said.count("\n") == 1
    assert len(said) < 400


@over("name", [*NAMES.values(), "a\0b"])
@over("read", [rg.load, rg.load_result, rg.verify, rg.simulate])
def test_the_functions_refuse_it_too(read, name, here):
    with pytest.raises(InputError) as refused:
        read(name)
    assert len(str(refused.value)) < 400


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read any folder")
def test_a_folder_that_may_not_be_read_is_not_said_to_be_missing(here, tmp_path):
    (tmp_path / "closed").mkdir(mode=0)
    with pytest.raises(InputError, match="Permission denied"):
        rg.load("closed/run.csv")


def test_a_refusal_shows_both_ends_of_what_is_long():
    path = "/home/" + "d" * 5000 + "/run.csv"
    said = str(InputError(f"{path} does not exist; give a data file"))
    assert said.startswith("/home/ddd")
    assert said.endswith("/run.csv does not exist; give a data file")
    assert len(str(InputError("many words " * 500))) <= 380
