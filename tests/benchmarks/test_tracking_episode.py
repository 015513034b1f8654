"""How long a decision takes is told of controllers that are slow, not of kernels that are compiled."""

import time

import numpy as np

from benchmarks.tracking import episode
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import named_plant
from tests.looping import over


class Sluggish:
    """A controller whose decisions take as long as they are told to."""

    def __init__(self, *seconds):
        self.seconds, self.decisions = list(seconds), 0

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        time.sleep(self.seconds[min(self.decisions, len(self.seconds) - 1)])
        self.decisions += 1
        return np.zeros((1, 1)), state


@over(
    "seconds, decisions",
    [
        ((0.3, 0.0), 300),  # the first compiles
        ((0.0, 0.0, 0.0, 0.3, 0.0), 300),  # or a later one
        ((0.05,), 3),
    ],
)
def test_only_a_controller_that_is_always_slow_is_given_up(seconds, decisions, monkeypatch):
    monkeypatch.setattr(episode, "_GIVEN_UP_S", 0.1)
    controller, plant = Sluggish(*seconds), named_plant("P10")
    layout = ObservationLayout.for_plant(plant, ts_s=1e-4, preview=1)
    took = episode.microseconds_per_sample(controller, plant, layout, np.zeros(400))
    assert controller.decisions == decisions
    assert (took > 4e4) is (decisions == 3)
