"""Public functions of ``import rdpi_gym as rg``: one a task, and results that display themselves.

Each file holds one task and its result: a result of the rooms below that also prints, draws, saves
and goes on. Nothing here computes.
"""

from pathlib import Path

from rdpi_gym.support.plugins import attach

__all__, __getattr__ = attach(__name__, Path(__file__).with_suffix(".pyi"))
