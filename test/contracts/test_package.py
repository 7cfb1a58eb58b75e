"""What is built for users holds every file that the package reads; what tells its version says the same."""

import re
import subprocess
import sys
import tarfile

import yaml
from support.source_tree import PACKAGE, ROOT

import lidar_buildings


def python(folder, *arguments):
    subprocess.run([sys.executable, *arguments], cwd=folder, check=True, capture_output=True)


def files_below(folder):
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def test_a_source_distribution_holds_all_and_what_is_built_from_it_all_that_is_read(tmp_path):
    python(ROOT, "setup.py", "-q", "egg_info", f"--egg-base={tmp_path}", "sdist", f"--dist-dir={tmp_path}")
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as file:
        file.extractall(tmp_path, **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))
    source = tmp_path / archive.name.removesuffix(".tar.gz")
    for folder in ("config", "conda", "launch", "resource", "examples", "lidar_buildings", "bench", "test"):
        assert files_below(ROOT / folder) - files_below(source / folder) == set(), folder
    for name in ("Makefile", "LICENSE", "README.md", "CHANGELOG.rst", "CITATION.cff", "CONTRIBUTING.md"):
        assert (source / name).is_file()
    built, shared = tmp_path / "built", tmp_path / "shared"
    python(
        source, "setup.py", "-q", "build", f"--build-lib={built}", "install_data", f"--install-dir={shared}"
    )
    assert files_below(built / PACKAGE.name) == files_below(PACKAGE)
    for folder in ("config", "launch"):
        assert files_below(shared / "share" / "lidar_buildings" / folder) == files_below(ROOT / folder)
    index = shared / "share/ament_index/resource_index/packages/lidar_buildings"
    assert index.is_file()


def test_the_recipe_of_conda_is_of_this_version_and_requires_what_pip_does():
    recipe = (ROOT / "conda" / "meta.yaml").read_text(encoding="utf-8")
    assert re.search(r'set version = "(.+)"', recipe)[1] == lidar_buildings.__version__
    named = re.findall(r"^    - ([\w-]+)", recipe.split("  run:")[1].split("\n\n")[0], re.MULTILINE)
    wanted = re.search(r"install_requires=\[(.*?)\]", (ROOT / "setup.py").read_text(), re.DOTALL)[1]
    assert {one.removesuffix("-python") for one in named} - {"python"} == set(
        re.findall(r'"([\w-]+)', wanted)
    )


def test_the_citation_and_the_changelog_are_of_this_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == lidar_buildings.__version__
    headings = re.findall(
        r"^(\S+) \((.*)\)\n-+$", (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert (citation["version"], str(citation["date-released"])) == headings[0]
    assert len(citation["references"]) == 3
