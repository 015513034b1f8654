"""Files of a small record: 40 samples of a 1 Hz sine at 50 Hz, 8 µm/V."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rdpi_gym.measurement import DataOptions, load
from rdpi_gym.support.errors import InputError

Write = Callable[[str, str], Path]
Lines = Callable[..., list[str]]
Refusal = Callable[..., str]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write_text(name: str, text: str) -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write_text


def made_lines(samples: int = 40, start_s: float = 0.0, amplitude_V: float = 1.0) -> list[str]:
    """Header and rows; row k (from 0) is line k + 2."""
    t = 0.02 * np.arange(samples)
    u = amplitude_V * np.sin(2 * np.pi * t)
    rows = np.column_stack((start_s + t, u, 8 * u))
    return ["t,u,y", *(",".join(f"{value:.6f}" for value in row) for row in rows)]


@pytest.fixture
def sine_lines() -> Lines:
    return made_lines


@pytest.fixture
def refusal() -> Refusal:
    """The one line that a bad file is refused with."""

    def message(path: Path, options: DataOptions | None = None) -> str:
        with pytest.raises(InputError) as caught:
            load(path, options)
        line = str(caught.value)
        assert "\n" not in line
        return line

    return message
