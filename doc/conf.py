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
html_show_sphinx = html_copy_source = False
# headings have the anchors that GitHub gives them
myst_heading_anchors = 3
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False


def setup(app: Sphinx) -> None:
    """Let the README's links to other places than doc/ hold on the first page, too."""
    app.connect("include-read", _beside_readme)


def _beside_readme(app: Sphinx, path: Path, document: str, content: list[str]) -> None:
    content[0] = re.sub(r"\]\((?!https?:|doc/|#)", "](../", content[0])
