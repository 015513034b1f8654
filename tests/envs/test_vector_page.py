"""The page on the vector environment: its snippets run as they stand."""

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "vector-environment.md").read_text(encoding="utf-8")


def test_the_snippets_run_one_after_the_other(capsys):
    pytest.importorskip("stable_baselines3")
    names = {}
    for code in re.findall(r"^```python\n(.*?)^```", PAGE, re.S | re.M):
        exec(compile(code, "vector-environment.md", "exec"), names)
    assert capsys.readouterr().out.splitlines()[:2] == [
        "(4096, 11) (4096,) (4096,)",
        "128 (128, 11)",
    ]
    np.testing.assert_array_equal(names["info"]["_error_um"], [True] * 2 + [False] * 6)
    assert names["model"].num_timesteps == 512
