"""The inverse stages by effect, read off the files of this folder."""

from __future__ import annotations

from collections.abc import Mapping

from baselines.inverses.base import Inverse
from rdpi_gym.support.members import Members

INVERSES: Mapping[str, type[Inverse]] = Members("baselines.inverses", Inverse, "effect")  # type: ignore[type-abstract]
"""Inverse stages by the name of the effect that they undo: a new one is a new file here."""
