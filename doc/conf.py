"""The documentation as a site, of the pages in this folder as they are: `make site`."""

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parents[1]))

project = "lidar_buildings"
author = "The lidar_buildings developers"
project_copyright = f"{author}, Apache-2.0"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = project
html_static_path, html_css_files = ["_static"], ["site.css"]
html_show_sphinx = html_copy_source = False
# headings have the anchors that GitHub gives them
myst_heading_anchors = 3
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False


def setup(app: Sphinx) -> None:
    """Let the links of pages at the root hold where a page of this folder includes them."""
    app.connect("include-read", _from_root)


def _from_root(app: Sphinx, path: Path, document: str, content: list[str]) -> None:
    content[0] = re.sub(r"\]\((?!https?:|doc/|#)([^)#\s]+)", _beside_pages, content[0])


def _beside_pages(link: re.Match[str]) -> str:
    """A page NAME.md at the root is included by name.md; anything else is a file to download."""
    return f"]({link[1].lower()}" if link[1].endswith(".md") else f"](../{link[1]}"
