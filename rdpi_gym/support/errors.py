"""The one error that a user is meant to read."""

from __future__ import annotations

import re

# C0 and C1 controls, the separators of lines and paragraphs, what turns the direction of writing
# around, and lone surrogates, which no encoding can write.
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
# Most characters of a line that is still read, with the name of a command before it 400, and of one
# word in it, as a path is. Of what is longer both ends are shown: they say most.
_LONGEST, _LONGEST_WORD = 380, 160
_LONG_WORD = re.compile(rf"\S{{{_LONGEST_WORD + 1},}}")


def printable(text: str) -> str:
    r"""Write control characters as their escapes, so that a terminal shows them and obeys none."""
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), text)


class InputError(ValueError):
    """Bad input: one line that says what is wrong, where, and what would be right.

    The command line prints the line and exits with status 2. Whatever of a file or of the user's
    words stands in it, it is one line of at most 380 characters, without control characters.

    Parameters
    ----------
    fact
        What is wrong and where, and what would be right for anyone.
    hint
        What to give a command or a call instead; it ends the line.

    Attributes
    ----------
    fact : str
        The line without the hint, for a reader who gives no options.

    Examples
    --------
    >>> error = InputError("run.csv: column t is missing", "name it with --columns t=NAME")
    >>> error.fact, str(error)
    ('run.csv: column t is missing', 'run.csv: column t is missing; name it with --columns t=NAME')
    >>> raise InputError("ts_s is -1.0; give a sampling time above 0 s, for example 5e-5")
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: ts_s is -1.0; give a sampling time above 0 s, for example 5e-5
    """

    def __init__(self, fact: str, hint: str = "") -> None:
        super().__init__(_line(f"{fact}; {hint}" if hint else fact))
        self.fact = _line(fact)


def _line(text: str) -> str:
    words = _LONG_WORD.sub(lambda word: _ends(word[0], _LONGEST_WORD), printable(text))
    return _ends(words, _LONGEST)


def _ends(text: str, most: int) -> str:
    """Return a text, of one that is too long what stands at its ends."""
    half = (most - 5) // 2
    return text if len(text) <= most else f"{text[:half]} ... {text[-half:]}"
