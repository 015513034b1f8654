"""What a graph writes down, a runtime computes as NumPy does."""

import numpy as np
import pytest

pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

import onnxruntime

from baselines.learned.onnx_graph import Graph

ROW = np.array([0.5, -1.5, 2.0, 1.0])


def ran(make, x):
    """What a runtime makes of an input of four numbers a lane."""
    graph = Graph()
    model = graph.model({"y": make(graph.input("x", 4))})
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    (found,) = session.run(None, {"x": x})
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
