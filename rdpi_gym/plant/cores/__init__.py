"""Hysteresis cores: the middle of the chain, one a file.

A file that defines a :class:`rdpi_gym.plant.cores.base.Core` is found without a list; a plant's
JSON names any core but RDPI under ``core``.
"""
