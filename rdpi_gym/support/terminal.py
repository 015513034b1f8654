"""Safe terminal output: text alone, in any encoding, whatever titles and names contain.

Inside :func:`plain_output` whatever is printed has its control characters written as escapes. Colours
and bars come from :func:`console`, the only writer that goes past this; it takes them from no text.
"""

from __future__ import annotations

import codecs
import io
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, cast

from rdpi_gym.support.errors import printable

if TYPE_CHECKING:
    from rich.console import Console

_SPELLED = {
    "µ": "u", "μ": "u", "²": "^2", "³": "^3", "δ": "delta", "Δ": "Delta", "ξ": "xi", "γ": "gamma",
    "π": "pi", "Σ": "sum", "τ": "tau", "σ": "sigma", "±": "+/-", "×": "x", "·": "*", "≤": "<=", "≥": ">=",
    "→": "->", "–": "-", "—": "-", "−": "-", "…": "...", "∞": "inf", "√": "sqrt", "°": "deg",
}  # fmt: skip
_ERRORS = "rdpi-spelled"


class _Plain:
    """A text stream without control characters but line ends and tabs."""

    def __init__(self, raw: TextIO) -> None:
        self.raw = raw

    def write(self, text: str) -> int:
        self.raw.write(plain(text))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.raw, name)


def plain(text: str) -> str:
    r"""Return text as a terminal may show it: line ends and tabs stay, other controls are written out."""
    if text.isprintable():
        return text
    lines = text.split("\n")
    return "\n".join("\t".join(map(printable, line.split("\t"))) for line in lines)


@contextmanager
def plain_output() -> Iterator[None]:
    """Let standard output and standard error take any text, and obey none; as before afterwards.

    What an encoding other than UTF-8 lacks is spelled (µm as um) or replaced by a question mark. Where a
    process has no such stream, as after ``>&-``, what is printed goes nowhere.
    """
    codecs.register_error(_ERRORS, _spell)
    before = sys.stdout, sys.stderr
    strict = [
        (stream, stream.errors)
        for stream in before
        if isinstance(stream, io.TextIOWrapper) and stream.errors != _ERRORS
    ]
    for stream, _ in strict:
        stream.reconfigure(errors=_ERRORS)
    with ExitStack() as opened:
        sys.stdout, sys.stderr = (_wrapped(stream, opened) for stream in before)
        try:
            yield
        finally:
            sys.stdout, sys.stderr = before
            for stream, errors in strict:
                stream.reconfigure(errors=errors)


def console(*, stderr: bool = False, width: int = 140) -> Console:
    """Return where tables and bars are drawn; no text in them is read as markup."""
    from rich.console import Console, ConsoleOptions
    from rich.segment import Segment
    from rich.text import Text

    class _Console(Console):
        def render_str(self, text: str, **options: Any) -> Text:
            return super().render_str(plain(text), **options)  # before its width is measured

        def render(
            self, renderable: Any, options: ConsoleOptions | None = None
        ) -> Iterable[Segment]:
            for segment in super().render(renderable, options):
                if segment.control or segment.text.isprintable():
                    yield segment
                else:
                    yield Segment(plain(segment.text), segment.style)

    stream = sys.stderr if stderr else sys.stdout
    raw = stream.raw if isinstance(stream, _Plain) else stream
    made = _Console(file=raw, markup=False, highlight=False, emoji=False)
    if not made.is_terminal:
        made.width = width
    return made


def _wrapped(stream: TextIO | None, opened: ExitStack) -> TextIO:
    if stream is None:  # this may also take the number that no file that is written later may have
        return opened.enter_context(Path(os.devnull).open("w", encoding="utf-8"))
    if isinstance(stream, _Plain):
        return stream
    return cast(TextIO, _Plain(stream))


def _spell(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    spelled = "".join(_SPELLED.get(letter, "?") for letter in lacking)
    return spelled.encode("ascii", "replace").decode("ascii"), error.end
