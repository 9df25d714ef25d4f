"""Settings of Sphinx for the site: ``make docs-html`` builds it, and a broken link fails it."""

from __future__ import annotations

from typing import Any

project = "bt_dualarm"
author = "The bt_dualarm authors"
project_copyright = author

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]
source_suffix = {".md": "markdown"}

# The pages are Markdown that GitHub shows, too: the same anchors for headings as there.
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]

autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings give shapes and units; signatures stay short
napoleon_google_docstring = True
napoleon_use_ivar = True

html_theme = "furo"
html_title = "bt_dualarm"
html_static_path: list[str] = []
copybutton_prompt_text = "$ "


def _links_to_the_root(_app: Any, _name: str, source: list[str]) -> None:  # Sphinx has the type
    """Lead links to files beside ``docs/``, which GitHub follows, to their pages of the site."""
    source[0] = source[0].replace("](../CONTRIBUTING.md", "](contributing.md")
    source[0] = source[0].replace("](../CHANGELOG.md", "](changelog.md")


def setup(app: Any) -> None:  # as above: Sphinx is not in `dev`
    """Connect to Sphinx."""
    app.connect("source-read", _links_to_the_root)
