"""CITATION.cff holds what the Citation File Format 1.2 requires, and this release's version."""

import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TYPES = {"article", "software", "generic"}


def test_the_citation_file_is_valid():
    yaml = pytest.importorskip("yaml")
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["cff-version"] == "1.2.0"
    assert {"message", "title", "authors", "version"} <= set(cited)
    assert cited["authors"] == [{"name": "rdpi-gym developers"}]
    for reference in cited["references"]:
        assert {"type", "title", "authors"} <= set(reference)
        assert reference["type"] in TYPES
        for author in reference["authors"]:
            assert set(author) == {"family-names", "given-names"}


def test_its_version_and_licence_are_those_of_the_package():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    assert f"\nversion: {project['version']}\n" in text
    assert f"\nlicense: {project['license']}\n" in text
