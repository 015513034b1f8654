"""A search moves numbers: models are checked where they begin, and not at every step."""

from collections import Counter

import rdpi_gym as rg
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.effects import Effect


def test_a_search_checks_a_few_hundred_models(monkeypatch):
    checks = Counter()

    def counted(kind):
        check = kind.__post_init__

        def counting(self):
            checks[kind] += 1
            check(self)

        monkeypatch.setattr(kind, "__post_init__", counting)

    counted(RDPI)
    counted(Effect)
    data = rg.simulate("P5", hide="creep", seed=1, ts_factor=4.0)
    found = rg.diagnose(
        data.select("stairs", "sine-50hz", "validation-stairs", "quiet"), "P5", jobs=1
    )
    assert [effect.name for effect in found.plant.effects] == ["creep"]
    assert checks[RDPI] < 100
    assert checks[Effect] < 500
