"""A search moves numbers: models are checked where they begin, and not at every step."""

from collections import Counter

import rdpi_gym as rg
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.effects import CATALOGUE, Effect, forms_of


def test_a_search_checks_a_model_few_times_for_each_start(monkeypatch):
    checks = Counter()

    def counted(kind):
        check = kind.__post_init__

        def counting(self):
            checks[kind] += 1
            check(self)

        monkeypatch.setattr(kind, "__post_init__", counting)

    data = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)
    data = data.select("stairs", "sine-50hz", "validation-stairs", "quiet")
    scale = data_scale(data.train)
    starts = sum(len(f.starts(scale)) for kind in CATALOGUE.values() for f in forms_of(kind))
    counted(RDPI)
    counted(Effect)
    found = rg.diagnose(data, "P5", jobs=1)
    assert [effect.name for effect in found.plant.effects] == ["creep"]
    assert checks[RDPI] < 100
    assert checks[Effect] < 3 * starts
