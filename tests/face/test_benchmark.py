"""Controllers by name, by a callable, and as they are: all are scored alike."""

import numpy as np
import pytest

import rdpi_gym as rg

CASE = {"references": ["sine"], "ts_s": [1e-3], "seeds": 2, "jobs": 1}


class Hold:
    """Rests at the middle of the command's range."""

    def __init__(self, belief, layout):
        self.layout = layout

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.zeros((*np.shape(observation)[:-1], 1), dtype=np.float32), state


def errors(scores, name):
    return scores.table[scores.table["controller"] == name]["rmse_um"].to_numpy()


def test_a_callable_is_scored_by_its_name():
    scores = rg.benchmark(["none", Hold], ["P5"], **CASE)
    assert scores.order[:2] == ["none", "Hold"]
    assert np.isfinite(errors(scores, "Hold")).all()


def test_a_controller_is_scored_as_it_is_at_its_own_sampling_time():
    plant = rg.plants["P5"]
    layout = rg.environments.layout(plant, ts_s=1e-3, preview=1)
    made = rg.make_controller("classical-static", plant, layout)
    scores = rg.benchmark(["classical-static", made], [plant], **CASE)
    (name,) = {*scores.table["controller"]} - {"classical-static"}
    assert name.endswith("(made)")
    # the benchmark's plant has its rate band-limited, which a static inverse does not know
    assert errors(scores, name) == pytest.approx(errors(scores, "classical-static"), rel=1e-9)
    both = rg.benchmark([made], [plant], references=["sine"], ts_s=[1e-3, 2e-4], seeds=1, jobs=1)
    assert set(both.table["ts_s"]) == {1e-3}


def test_its_belief_is_its_own():
    wrong = rg.make_controller("classical-static", "P10", rg.environments.layout("P5", ts_s=1e-3))
    scores = rg.benchmark(["classical-static", wrong], ["P5"], **CASE)
    nominal = errors(scores, "ClassicalStatic (made)")[0], errors(scores, "classical-static")[0]
    assert nominal[0] > 10 * nominal[1]


def test_what_is_no_controller_is_refused():
    with pytest.raises(rg.InputError, match="controllers is"):
        rg.benchmark([3], ["P5"], **CASE)

    class Mute:
        predict = Hold.predict

    with pytest.raises(rg.InputError, match="has no layout"):
        rg.benchmark([Mute()], ["P5"], **CASE)
    with pytest.raises(rg.InputError, match="without predict"):
        rg.benchmark([lambda belief, layout: 3], ["P5"], **CASE)


def test_scores_with_callables_are_saved(tmp_path):
    scores = rg.benchmark(["none", Hold], ["P5"], **CASE)
    again = rg.load_result(scores.save(tmp_path / "scores.npz"))
    assert repr(again) == repr(scores)


def test_an_interrupted_run_goes_on(tmp_path):
    first = rg.benchmark(["none"], ["P5"], out=tmp_path, **CASE)
    second = rg.benchmark(["none"], ["P5"], out=tmp_path, **CASE)
    assert (first.computed > 0, second.computed) == (True, 0)
    assert repr(second).splitlines()[0] == repr(first).splitlines()[0]
