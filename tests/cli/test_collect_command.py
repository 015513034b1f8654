"""`rdpi collect`: what docs/interoperability.md shows, whole or absent, and bad input as one line."""

import json
import re
import shlex
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("minari")

import minari

from benchmarks.stages import offline
from rdpi_gym.cli import main
from tests.looping import over

PAGE = (Path(__file__).parents[2] / "docs" / "interoperability.md").read_text(encoding="utf-8")
SMALL = ("--task", "Bare", "--controllers", "classical-static,random", "--episodes", "3")


@pytest.fixture(autouse=True)
def _here(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


def collect(*words):
    return main(["collect", *SMALL, "--steps", "20", "--out", "d", *words])


def block(language, word):
    (found,) = re.findall(rf"^```{language}\n([^`]*{word}[^`]*)^```$", PAGE, re.M)
    return found


def test_the_page_makes_a_dataset_and_replays_an_episode_to_the_last_bit(capsys, tmp_path):
    assert main(shlex.split(block("bash", "rdpi collect"))[1:]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "6 episodes of Stage, 120 steps each, actions read as command"
    exec(block("python", "minari.MinariDataset"), {})  # asserts that observations are the same
    assert capsys.readouterr().out.startswith("true-plant-horizon 0.")
    dataset = minari.MinariDataset(tmp_path / "results" / "dataset" / "rdpi-stage-v0" / "data")
    about = list(dataset.storage.get_episode_metadata(range(6)))
    assert [each["controller"] for each in about] == [
        name for name in ("true-plant-horizon", "pi-preview", "random") for _ in range(2)
    ]
    plants = [json.loads(each["plant"])["effects"] for each in about]
    assert all(one != other for i, one in enumerate(plants) for other in plants[:i])
    error = [np.abs(episode.infos["error_um"][80:]).mean() for episode in dataset]
    assert max(error[:2]) < min(error[2:4]) < max(error[2:4]) < min(error[4:])


def test_the_bound_is_given_what_its_plant_becomes_within_an_episode():
    env = gym.make("rdpi_gym/PiezoLoad-v0")
    env.reset(seed=0)
    plant = offline._driver(offline.HORIZON_BOUND, [env], 0)._twin
    inner = env.unwrapped
    assert inner.later
    for sample in range(max(inner.later) + 1):
        plant.step(np.zeros((1, 1)))
        assert plant.models[0] == inner.later.get(sample, plant.models[0])
    assert plant.models[0] == inner.later[max(inner.later)] != inner.truth


def test_an_interrupted_command_leaves_nothing_and_the_same_again_finds_it_written(
    monkeypatch, tmp_path, capsys
):
    def interrupt(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(offline, "write_json", interrupt)  # all is written but the last file
        assert collect() == 130
    assert [path.name for path in (tmp_path / "d").iterdir()] == []
    assert collect() == 0
    said = capsys.readouterr().out
    before = (tmp_path / "d" / "rdpi-bare-v0" / "data" / "main_data.hdf5").read_bytes()
    monkeypatch.setattr(offline, "_drive", interrupt)
    assert collect() == 0
    assert capsys.readouterr().out == said
    assert (tmp_path / "d" / "rdpi-bare-v0" / "data" / "main_data.hdf5").read_bytes() == before


def test_a_dataset_of_other_options_is_refused_and_kept(tmp_path, capsys):
    assert collect() == 0
    assert collect("--action", "increment") == 2
    said = capsys.readouterr().err
    assert "holds a dataset with action 'command', asked for is 'increment'" in said
    assert said.count("\n") == 1
    (tmp_path / "d" / "rdpi-bare-v0" / "collection.json").unlink()
    assert collect() == 2
    assert "holds no dataset of `rdpi collect`" in capsys.readouterr().err


@over(
    "words, message",
    [
        (["--task", "Stag"], "no task is named 'Stag'; did you mean 'Stage'?"),
        (["--controllers", "classical-statik"], "classical-static"),
        (["--controllers", "preview-inversion"], "is given the whole reference"),
        (["--controllers", ""], "no controller is named"),
        (["--episodes", "1"], "episodes is 1 for 2 controllers"),
        (["--steps", "0"], "steps is 0"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(words, message, tmp_path, capsys):
    assert collect(*words) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())
