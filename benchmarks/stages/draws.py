"""Seeds of test plants: the public one, or one that whoever runs a leaderboard keeps private."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from rdpi_gym.envs.tasks import PUBLIC_SEED
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_utf8

_LARGEST = 2**10  # bytes of a seed file
FEWEST_DIGITS, MOST_DIGITS = 20, 40
"""Digits of a private seed: a shorter one could be guessed from the hash that tables show."""


@dataclass(frozen=True)
class TestSeed:
    """The seed of test draws, and what tables say of it.

    Parameters
    ----------
    seed
        A whole number of 0 or above.
    is_public
        Whether it is the one that is committed; another is named by a hash alone.

    Examples
    --------
    >>> TestSeed().label
    'public seed 2026'
    >>> TestSeed(12345678901234567890, is_public=False).label
    'private seed 6ed645ef'
    """

    __test__ = False  # to pytest it looks like a class of tests

    seed: int = PUBLIC_SEED
    is_public: bool = True

    @property
    def label(self) -> str:
        """Name in rows and tables."""
        if self.is_public:
            return f"public seed {self.seed}"
        return f"private seed {hashlib.sha256(str(self.seed).encode()).hexdigest()[:8]}"


def read_seed(path: Path | None) -> TestSeed:
    """Read the seed of test draws from a file that holds one whole number; None: the public one."""
    if path is None:
        return TestSeed()
    text = read_utf8(path, _LARGEST).strip()
    if not (text.isascii() and text.isdigit() and FEWEST_DIGITS <= len(text) <= MOST_DIGITS):
        raise InputError(
            f"the seed file {path} does not hold one whole number of {FEWEST_DIGITS} to {MOST_DIGITS} digits; "
            "write a random one, as tables show a hash that a short one could be guessed from"
        )
    return TestSeed(int(text), is_public=False)
