"""Texts stay letter for letter what they were, in V and µm."""

import json

import pytest

from tests.diagnosis.golden_texts import FILE, texts

WANTED = json.loads(FILE.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def rendered():
    return texts()


def test_every_text_is_there(rendered):
    assert list(rendered) == list(WANTED)
    assert len(WANTED) >= 200


@pytest.mark.parametrize("key", WANTED)
def test_a_text_stays_as_it_was(rendered, key):
    assert rendered[key] == WANTED[key]
