"""One small simulated data set, and each result made from it once."""

import matplotlib as mpl
import pytest

import rdpi_gym as rg
from benchmarks.paper import paper_cases
from benchmarks.paper.claims import SWEEP_LABEL, judge
from benchmarks.paper.tracking import track

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
def models(data, model):
    return rg.compare(data.select("stairs", "validation-stairs"), model, "P5")


@pytest.fixture(scope="session")
def found(data):
    few = data.select("stairs", "sine-*", "validation-stairs", "quiet")
    return rg.discover(few, jobs=1)


@pytest.fixture(scope="session")
def scores():
    return rg.benchmark(["none", "classical-static"], ["P5"], ["sine"], [1e-3], seeds=2, jobs=1)


@pytest.fixture(scope="session")
def paper():
    """The error of each reading against the sampling time, without what takes longer."""
    cases = tuple(case for case in paper_cases() if case.label == SWEEP_LABEL)
    runs = tuple(track(case.reading, case.sine, lanes=2, seed=0) for case in cases)
    verdicts = tuple(
        judge(case.claim, [other for other in runs if other.reading == run.reading], run)
        for case, run in zip(cases, runs, strict=True)
    )
    return rg.PaperResults(0, 2, cases, verdicts, runs, runs, (), {}, (), ())


@pytest.fixture(scope="session")
def results(data, model, comparison, models, found, scores, paper):
    """Every kind of result by its name."""
    return {
        "data": data,
        "model": model,
        "comparison": comparison,
        "models": models,
        "found": found,
        "scores": scores,
        "paper": paper,
    }
