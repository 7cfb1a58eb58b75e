"""The documentation is a site: every page is in the menu, no link is dead, nothing needs a network."""

import re
import subprocess
import sys
from importlib.util import find_spec

import pytest
from support.source_tree import ROOT

import lidar_buildings

BUILD = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the built site; what the builder has to complain of is an error."""
    if not all(map(find_spec, ("sphinx", "furo", "myst_parser"))):
        pytest.skip("the site is not built: pip install '.[doc]'")
    folder = tmp_path_factory.mktemp("site")
    built = subprocess.run([*BUILD, str(ROOT / "doc"), str(folder)], capture_output=True, text=True)
    assert (built.returncode, built.stderr) == (0, "")
    return folder


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_has_every_page(site):
    pages = {path.relative_to(ROOT / "doc").with_suffix("") for path in (ROOT / "doc").rglob("*.md")}
    assert {path.relative_to(site).with_suffix("") for path in site.rglob("*.html")} > pages


@pytest.mark.slow
def test_the_site_fetches_nothing_from_elsewhere(site):
    for page in site.rglob("*.html"):
        assert not re.findall(r'(?:src|rel="stylesheet" href)="(?:https?:)?//[^"]*', page.read_text()), page


@pytest.mark.slow
def test_the_reference_has_every_public_name(site):
    told = set(re.findall(r'id="lidar_buildings\.(\w+)"', (site / "api.html").read_text()))
    assert set(lidar_buildings.__all__) - {"__version__"} <= told
