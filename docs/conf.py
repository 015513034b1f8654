"""Sphinx: the site of pages, gallery and reference that `make docs` builds.

The source folder is the project's root, so that links between pages, results and files are the
same on the site as in the checkout; `docs/index.md` is the first page.
"""

from __future__ import annotations

import os
import sys
from importlib.metadata import version as installed
from pathlib import Path
from typing import Any

from sphinx_gallery import backreferences

os.environ["COLUMNS"] = "100"  # tables that the gallery prints
os.environ["NO_COLOR"] = "1"

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(Path(__file__).parent))

project = "rdpi-gym"
author = "rdpi-gym developers"
release = installed("rdpi-gym")
version = release

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_gallery.gen_gallery",
]
root_doc = "docs/index"
include_patterns = [
    "docs/**",
    "examples/**/*.md",
    "studies/results/*.md",
    "studies/results/**/*.md",
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
]
exclude_patterns = [
    ".*",
    "docs/_*",
    "build",
    "results",
    "tests",
    "rdpi_gym",
    "baselines",
    "benchmarks",
    "dist",
]
templates_path = [str(ROOT / "docs" / "_templates")]
suppress_warnings = ["config.cache"]  # the gallery's settings hold functions

# Every reference leads somewhere, but for what stands behind the rooms' own names: docstrings there speak to
# who reads the code.
nitpicky = True
nitpick_ignore_regex = [
    ("py:mod", r"(rdpi_gym|baselines)\..*"),
    (
        "py:class",
        r"(History|Scaling|HistoryObservation|ScaledObservation|PiezoTrackingEnv|SearchOptions)",
    ),
    ("py:class", r"(rdpi_gym\.diagnosis\.results|benchmarks|baselines\.learned)\..*"),
    (
        "py:func",
        r"(rdpi_gym\.(virtual_lab|envs)\.\w+\.\w+|rdpi_gym\.environments\.layout|displacement)",
    ),
    ("py:meth", r"(baselines\.base\.Baseline\.\w+|seed)"),
    ("py:attr", r"(records|parameters)"),
    ("py:data", r"(rdpi_gym\.plant\.CORES|PLANTS|HIDEABLE|VISIBLE|CONTROLLERS)"),
]

autosummary_generate = True
autosummary_imported_members = True
autosummary_ignore_module_all = False
autodoc_typehints = "none"
autodoc_preserve_defaults = True
autodoc_inherit_docstrings = False
numpydoc_show_class_members = False

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4

sphinx_gallery_conf: dict[str, Any] = {
    "examples_dirs": "examples/gallery",
    "gallery_dirs": "docs/gallery",
    "filename_pattern": r"\.py$",
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_memory": False,
    "write_computation_times": False,
    "min_reported_time": 1,
    "plot_gallery": True,
    "abort_on_example_error": False,
    "only_warn_on_example_error": False,
    "within_subsection_order": "FileNameSortKey",
    "capture_repr": ("_repr_html_", "__repr__"),
    "ignore_repr_types": r"matplotlib\.|list|tuple",
}

# Thumbnails of the gallery have the title of their example as alternative text.
for _template in ("THUMBNAIL_TEMPLATE", "BACKREF_THUMBNAIL_TEMPLATE"):
    _text = getattr(backreferences, _template)
    setattr(backreferences, _template, _text.replace(":alt:\n", ":alt: {title}\n"))

html_theme = "pydata_sphinx_theme"
html_title = "rdpi-gym"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_extra_path = ["_extra"]
html_copy_source = False
html_show_sourcelink = False
html_sidebars = {"docs/index": []}
html_theme_options = {
    "navbar_end": ["theme-switcher"],
    "show_prev_next": True,
    "header_links_before_dropdown": 7,
    "secondary_sidebar_items": {"docs/**": ["page-toc"], "studies/**": []},
    "footer_start": ["copyright"],
    "footer_end": [],
    "navigation_with_keys": False,
}


def setup(app: Any) -> None:
    """Read docstrings in Gymnasium's style before numpydoc does."""
    from _docstrings import convert

    app.connect("autodoc-process-docstring", convert, priority=100)
