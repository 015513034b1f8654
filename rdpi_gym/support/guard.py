"""The first import of the command `rdpi`: from here on an interrupt is answered in one line.

It imports next to nothing itself. The interpreter's own start, before it, is not in our hands.
"""

import os
import signal
import sys

INTERRUPTED = 130
"""Status of a command that was interrupted."""
_COMMANDS = ("-m", "rdpi")  # `python -m rdpi_gym` while it imports this package, and the script
_SHOW_CURSOR = "\x1b[?25h"


def is_command() -> bool:
    """Whether this process is the command, and no program that uses the package."""
    return bool(sys.argv) and os.path.basename(sys.argv[0]) in _COMMANDS  # noqa: PTH119


def guard() -> None:
    """End the process with one line at an interrupt, where nobody has asked for anything else."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, end_at_once)


def say_interrupted(command: str = "rdpi") -> None:
    """Print the one line."""
    print(
        f"{command}: interrupted; what was computed is kept, and the same command goes on from it",
        file=sys.stderr,
        flush=True,
    )


def end_at_once(number: int = 0, frame: object = None) -> None:
    """End the process, and those that it started, with one line; what it wrote is whole."""
    processes = sys.modules.get("multiprocessing")
    for child in processes.active_children() if processes else ():
        child.kill()
    try:
        if sys.stderr.isatty():
            sys.stderr.write(_SHOW_CURSOR)
        say_interrupted()
        sys.stdout.flush()
    finally:
        os._exit(INTERRUPTED)
