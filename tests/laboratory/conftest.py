"""The browser of the tests of the page."""

import pytest

from rdpi_gym.support.errors import InputError
from studies.chromium import chromium


@pytest.fixture(scope="module")
def browser():
    shown = chromium()
    try:
        found = shown.__enter__()
    except InputError as missing:
        pytest.skip(str(missing))
    yield found
    shown.__exit__(None, None, None)
