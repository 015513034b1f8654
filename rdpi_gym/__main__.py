"""`python -m rdpi_gym` is the command `rdpi`."""

import sys

from rdpi_gym.cli import main

sys.exit(main())
