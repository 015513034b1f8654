"""``python -m benchmarks.effect_discovery --truth foreign``, by its first name."""

from __future__ import annotations

import sys
from functools import partial

from benchmarks.effect_discovery.__main__ import main as discover_main
from benchmarks.effect_discovery.foreign import FOREIGN

main = partial(discover_main, source=FOREIGN)

if __name__ == "__main__":
    sys.exit(main())
