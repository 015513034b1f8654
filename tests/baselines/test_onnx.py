"""ONNX graphs compute as NumPy does; an exported policy acts as in torch, and says what it must be shown."""

import json
import sys

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

import onnxruntime
import torch

import rdpi_gym  # noqa: F401  # registers the environments
from baselines.learned.onnx_export import export_onnx
from baselines.learned.onnx_graph import Graph
from baselines.learned.policy import Policy
from rdpi_gym.cli import main
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.wrappers.history import VectorHistoryObservation
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.onnx_metadata import METADATA
from tests.baselines.playing import make_policy


def session(file):
    return onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])


ROW = np.array([0.5, -1.5, 2.0, 1.0])


def ran(make, x):
    """Output of a runtime at an input of four numbers a lane."""
    graph = Graph()
    model = graph.model({"y": make(graph.input("x", 4))})
    (found,) = session(model.SerializeToString()).run(None, {"x": x})
    assert found.dtype == np.float64
    return found


CASES = (
    (lambda x: (2.0 * x + ROW) / 3.0 - x, lambda x: (2.0 * x + ROW) / 3.0 - x),
    (lambda x: ROW - 1.0 - x * x**2, lambda x: ROW - 1.0 - x * x**2),
    (lambda x: ROW + 0.5 ** abs(x), lambda x: ROW + 0.5 ** abs(x)),
    (lambda x: x @ np.outer(ROW, ROW), lambda x: x @ np.outer(ROW, ROW)),
    (lambda x: x[:, 1:-1], lambda x: x[:, 1:-1]),
    (lambda x: x.take([2, 0]), lambda x: x[:, [2, 0]]),
    (lambda x: x.take(np.array([[0, 1], [1, 2]])).transpose() * 1.0 @ ROW[:2],
     lambda x: x[:, [[0, 1], [1, 2]]].transpose(0, 2, 1) @ ROW[:2]),
    (lambda x: x.unsqueeze(1).squeeze(1).sum(), lambda x: x.sum(axis=1, keepdims=True)),
    (lambda x: x.clip(-0.5, ROW), lambda x: np.minimum(np.maximum(x, -0.5), ROW)),
    (lambda x: x.maximum(0.1), lambda x: np.maximum(x, 0.1)),
    (lambda x: x.remainder(0.3), lambda x: np.fmod(x, 0.3)),
    (lambda x: x.full_like(7.0), lambda x: np.full_like(x, 7.0)),
    (lambda x: ((x > 0.0) & (x <= 1.0) | ~(x >= -1.0) | (x < -2.0)).cast(np.float64),
     lambda x: ((x > 0.0) & (x <= 1.0) | (x < -1.0)).astype(float)),
    (lambda x: x.graph.where(x > 0.0, x, 5.0), lambda x: np.where(x > 0.0, x, 5.0)),
    (lambda x: x.graph.concat(x, x[:, :1]), lambda x: np.hstack([x, x[:, :1]])),
    (lambda x: x.tanh() + x.sigmoid(), lambda x: np.tanh(x) + 1.0 / (1.0 + np.exp(-x))),
    (lambda x: x.asinh(), np.arcsinh),
)  # fmt: skip


def test_it_computes_as_numpy_does():
    x = np.random.default_rng(0).normal(size=(5, 4))
    for number, (make, expected) in enumerate(CASES):
        wanted = expected(x)
        np.testing.assert_allclose(
            ran(make, x), wanted, rtol=1e-14, atol=1e-15, err_msg=f"{number}"
        )
        assert ran(make, x[:1]).shape == expected(x[:1]).shape, number


def test_a_constant_stands_once():
    graph = Graph()
    x = graph.input("x", 4)
    model = graph.model({"y": (x + ROW) * ROW.copy() + 1.0 + 1.0})
    assert len(model.graph.initializer) == 2


def test_what_does_not_fit_is_no_model():
    graph = Graph()
    with pytest.raises(Exception, match="Incompatible dimensions"):
        graph.model({"y": graph.input("x", 4) + np.ones(3)})


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    return make_policy(hidden=(32, 32)).save(tmp_path_factory.mktemp("saved") / "policy")


@pytest.fixture(scope="module")
def exported(saved):
    out = saved.parent / "policy.onnx"
    assert main(["export", "onnx", str(saved), "--out", str(out)]) == 0
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
    policy = make_policy("increment", (32, 32), output="Tanh")
    agree(policy, export_onnx(policy, tmp_path / "a.onnx"))


def test_an_environment_with_its_history_is_what_it_takes(saved, exported):
    lanes = gym.make_vec("rdpi_gym/PiezoTracking-v0", num_envs=3, preview=2, reference="sine")
    env, policy, run = (
        VectorHistoryObservation(lanes, 3),
        Policy.load(saved),
        session(exported),
    )
    observation, _ = env.reset(seed=0)
    for _ in range(20):
        (action,) = run.run(None, {"observation": observation})
        expected = policy.actor(torch.from_numpy(policy.scaling(observation))).numpy()
        np.testing.assert_allclose(action, expected, rtol=0, atol=1e-6)
        observation, *_ = env.step(action)


def test_the_metadata_of_a_network_say_what_it_must_be_shown(exported):
    found = json.loads(session(exported).get_modelmeta().custom_metadata_map[METADATA])
    assert (found["format"], found["version"]) == ("rdpi-policy-onnx", 1)
    layout = dict(found["layout"])
    layout["command_range_V"] = tuple(layout["command_range_V"])
    assert ObservationLayout(**layout) == make_policy().layout
    assert (found["history"], found["baseline"]) == (3, "classical-static")
    (taken,) = session(exported).get_inputs()
    assert taken.shape == ["batch", len(found["observation"])]
    assert found["observation"][:6] == [
        "reference(k)", "reference(k+1)", "reference(k+2)", "measured(k)", "command(k)",
        "reference(k-1)",
    ]  # fmt: skip


def test_a_second_export_replaces_the_file_and_leaves_nothing_else(saved, tmp_path):
    out = tmp_path / "deep" / "policy.onnx"
    for _ in range(2):
        assert main(["export", "onnx", str(saved), "--out", str(out)]) == 0
    assert [path.name for path in out.parent.iterdir()] == ["policy.onnx"]
    assert b".py" not in out.read_bytes()  # where it was made is nobody's business


def test_bad_input_is_one_line_and_leaves_nothing(tmp_path, capsys, monkeypatch):
    network = make_policy().save(tmp_path / "network")
    cut = make_policy().save(tmp_path / "cut") / "weights.pt"
    cut.write_bytes(cut.read_bytes()[:500])
    (tmp_path / "folder.onnx").mkdir()
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    for folder, out, message in (
        ("nowhere", "a.onnx", "no policy is at"),
        ("cut", "a.onnx", "cut off"),
        ("network", "a.pt", "ends in .onnx"),
        ("network", "folder.onnx", "ends in .onnx"),
        ("network", "network/policy.json/a.onnx", "cannot be written"),
    ):
        assert main(["export", "onnx", folder, "--out", out]) == 2, (folder, out)
        said = capsys.readouterr().err
        assert message in said
        assert said.count("\n") == 1
        assert sorted(tmp_path.rglob("*")) == before, (folder, out)
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(InputError, match=r"onnx, .*pip install rdpi-gym\[onnx\]") as caught:
        export_onnx(Policy.load(network), tmp_path / "a.onnx")
    assert "\n" not in str(caught.value)
    assert sorted(tmp_path.rglob("*")) == before
