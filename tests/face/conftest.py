"""One small simulated data set, and each result made from it once."""

import matplotlib as mpl
import pytest

import rdpi_gym as rg

mpl.use("Agg")


@pytest.fixture(scope="session")
def data():
    return rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)


@pytest.fixture(scope="session")
def model(data):
    return rg.fit(data, plays=5)


@pytest.fixture(scope="session")
def comparison(data, model):
    return rg.compare(data, model)


@pytest.fixture(scope="session")
def found(data):
    few = data.select("stairs", "sine-*", "validation-stairs", "quiet")
    return rg.discover(few, jobs=1)


@pytest.fixture(scope="session")
def scores():
    return rg.benchmark(["none", "classical-static"], ["P5"], ["sine"], [1e-3], seeds=2, jobs=1)


@pytest.fixture(scope="session")
def results(data, model, comparison, found, scores):
    """Every kind of result by its name."""
    return {
        "data": data,
        "model": model,
        "comparison": comparison,
        "found": found,
        "scores": scores,
    }
