"""A policy exported to ONNX acts as it does in torch, and says what it must be shown."""

import json
import sys

import numpy as np
import pytest
import typer

pytest.importorskip("torch")
pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

import onnxruntime
import torch

from baselines.learned.onnx_export import export_onnx
from baselines.learned.policy import Network, Policy
from rdpi_gym.cli.export import export_onnx as export_command
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import named_plant
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.onnx_metadata import METADATA

HISTORY = 3


def make_policy(action="correction", output="Hardtanh"):
    torch.manual_seed(0)
    layout = ObservationLayout.for_plant(
        named_plant("P10"), ts_s=1e-4, preview=2, action=action, action_scale_V=8.0
    )
    actor = Network((layout.size + 3 * HISTORY, 32, 32, 1), "Tanh", output).build()
    baseline = "classical-static" if action == "correction" else None
    return Policy(layout, HISTORY, 100.0, 0.02, actor, baseline)


def session(path):
    return onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])


def rdpi_export(*words):
    app = typer.Typer()
    app.command(name="onnx")(export_command)
    app(args=list(words), standalone_mode=False)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    return make_policy().save(tmp_path_factory.mktemp("saved") / "policy")


@pytest.fixture(scope="module")
def exported(saved):
    out = saved.parent / "policy.onnx"
    rdpi_export(str(saved), "--out", str(out))
    return out


def agree(policy, path):
    run = session(path)
    rng = np.random.default_rng(0)
    actions = []
    for batch in (1, 7):
        for _ in range(50):
            shown = rng.uniform(-1.0, 1.0, (batch, policy.scaling.history.size)).astype(np.float32)
            with torch.no_grad():
                expected = policy.actor(torch.from_numpy(policy.scaling(shown))).numpy()
            (found,) = run.run(["action"], {"observation": shown})
            assert found.shape == (batch, 1)
            assert found.dtype == np.float32
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
            actions.append(found[:, 0])
    assert np.concatenate(actions).std() > 0.05  # it is no constant that agrees


@pytest.mark.slow
def test_it_does_what_torch_does_in_any_batch(saved, exported):
    agree(Policy.load(saved), exported)


def test_so_does_a_squashed_actor_of_increments(tmp_path):
    policy = make_policy("increment", "Tanh")
    agree(policy, export_onnx(policy, tmp_path / "a.onnx"))


def test_an_environment_with_its_history_is_what_it_takes(saved, exported):
    import gymnasium as gym

    import rdpi_gym  # noqa: F401  # registers the environments
    from rdpi_gym.envs.wrappers.history import VectorHistoryObservation

    lanes = gym.make_vec("rdpi_gym/PiezoTracking-v0", num_envs=3, preview=2, reference="sine")
    env, policy, run = (
        VectorHistoryObservation(lanes, HISTORY),
        Policy.load(saved),
        session(exported),
    )
    observation, _ = env.reset(seed=0)
    for _ in range(20):
        (action,) = run.run(None, {"observation": observation})
        expected = policy.actor(torch.from_numpy(policy.scaling(observation))).numpy()
        np.testing.assert_allclose(action, expected, rtol=0, atol=1e-6)
        observation, *_ = env.step(action)


def test_its_metadata_says_what_it_must_be_shown(exported):
    found = json.loads(session(exported).get_modelmeta().custom_metadata_map[METADATA])
    assert (found["format"], found["version"]) == ("rdpi-policy-onnx", 1)
    layout = dict(found["layout"])
    layout["command_range_V"] = tuple(layout["command_range_V"])
    assert ObservationLayout(**layout) == make_policy().layout
    assert (found["history"], found["baseline"]) == (HISTORY, "classical-static")
    (taken,) = session(exported).get_inputs()
    assert taken.shape == ["batch", len(found["observation"])]
    assert found["observation"][:6] == [
        "reference(k)", "reference(k+1)", "reference(k+2)", "measured(k)", "command(k)",
        "reference(k-1)",
    ]  # fmt: skip


def test_a_second_export_replaces_the_file_and_leaves_nothing_else(saved, tmp_path):
    out = tmp_path / "deep" / "policy.onnx"
    for _ in range(2):
        rdpi_export(str(saved), "--out", str(out))
    assert [path.name for path in out.parent.iterdir()] == ["policy.onnx"]
    assert b".py" not in out.read_bytes()  # where it was made is nobody's business


def test_without_the_extra_it_is_one_line(saved, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(InputError, match=r"onnx, .*pip install rdpi-gym\[onnx\]") as caught:
        rdpi_export(str(saved), "--out", str(tmp_path / "a.onnx"))
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_bad_input_is_one_line_and_leaves_nothing(tmp_path):
    make_policy().save(tmp_path / "policy")
    cut = make_policy().save(tmp_path / "cut") / "weights.pt"
    cut.write_bytes(cut.read_bytes()[:500])
    (tmp_path / "folder.onnx").mkdir()
    before = sorted(tmp_path.rglob("*"))
    for folder, out, message in (
        ("nowhere", "a.onnx", "no policy is at"),
        ("cut", "a.onnx", "cut off"),
        ("policy", "a.pt", r"ends in \.onnx"),
        ("policy", "folder.onnx", r"ends in \.onnx"),
        ("policy", "policy/policy.json/a.onnx", "cannot be written"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            rdpi_export(str(tmp_path / folder), "--out", str(tmp_path / out))
        assert "\n" not in str(caught.value)
        assert sorted(tmp_path.rglob("*")) == before, (folder, out)
