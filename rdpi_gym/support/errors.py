"""The one error that a user is meant to read."""

from __future__ import annotations


class InputError(ValueError):
    """Bad input: one line that says what is wrong, where, and what would be right.

    The command line prints the line and exits with status 2.

    Examples
    --------
    >>> raise InputError("ts_s is -1.0; give a sampling time above 0 s, for example 5e-5")
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: ts_s is -1.0; give a sampling time above 0 s, for example 5e-5
    """
