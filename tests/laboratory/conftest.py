"""The browser of the tests of the page."""

from contextlib import ExitStack

import pytest

from rdpi_gym.support.errors import InputError
from studies.chromium import chromium


@pytest.fixture(scope="module")
def browser():
    with ExitStack() as stack:
        try:
            found = stack.enter_context(chromium())
        except InputError as missing:
            pytest.skip(str(missing))
        yield found
