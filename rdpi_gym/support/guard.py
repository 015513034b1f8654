"""The first import of the command `rdpi`: interrupts are answered in one line, the current folder is data.

It imports next to nothing itself. The interpreter's own start, before it, is not in our hands.
"""

import os
import signal
import sys

INTERRUPTED, REFUSED = 130, 2
"""Status of a command that was interrupted, and of one that was refused."""
_COMMANDS = ("-m", "rdpi")  # `python -m rdpi_gym` while it imports this package, and the script
_SHOW_CURSOR = "\x1b[?25h"
SAFE_PATH = "PYTHONSAFEPATH"
"""Environment variable: where it is set, Python finds no module in the current folder."""
_COMPILER_CONFIG = ".numba_config.yaml"


def is_command() -> bool:
    """Whether this process is the command, and no program that uses the package."""
    name = os.path.splitext(os.path.basename(sys.argv[0] if sys.argv else ""))[0]  # noqa: PTH119, PTH122
    return name in _COMMANDS


def guard() -> None:
    """Answer interrupts in one line; take no code from the current folder, in children either."""
    os.environ[SAFE_PATH] = "1"
    sys.path[:] = filter(os.path.isabs, sys.path)
    if os.path.exists(_COMPILER_CONFIG):  # noqa: PTH110
        # numba obeys it, even as to the folder from which compiled code is loaded
        print(
            f"rdpi: {_COMPILER_CONFIG} in this folder would configure the compiler; "
            "move it away, or start from another folder",
            file=sys.stderr,
        )
        sys.exit(REFUSED)
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
