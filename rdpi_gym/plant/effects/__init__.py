"""Physical effects as stages of the plant, one a file.

A file holds the simplest form of its effect and, below it, further forms with more parameters.
A new effect is one new file in this folder; one of another project is found by an entry point of
the group ``rdpi_gym.effects`` or named as ``module:Class``.
"""

from rdpi_gym.plant.effects.base import (
    SLOTS,
    Block,
    DataScale,
    Effect,
    Look,
    Parameter,
    Picture,
    Slot,
    effect_from_dict,
    forms_of,
)
from rdpi_gym.plant.effects.catalogue import CATALOGUE, check_effect, load_effect

__all__ = [
    "CATALOGUE",
    "SLOTS",
    "Block",
    "DataScale",
    "Effect",
    "Look",
    "Parameter",
    "Picture",
    "Slot",
    "check_effect",
    "effect_from_dict",
    "forms_of",
    "load_effect",
]
