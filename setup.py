# SPDX-License-Identifier: Apache-2.0
"""Build the package: for colcon (ament_python) and for pip alike."""

import os
import re
import sys
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "lidar_buildings"
#: `colcon build --symlink-install` runs this file by a symlink, in a folder that has no README.md.
ROOT = Path(__file__).resolve().parent
VERSION = re.search(r'__version__ = "(.+)"', (ROOT / PACKAGE / "__init__.py").read_text()).group(1)
#: colcon and bloom run `setup.py install` or `develop`; pip does not.
IS_FOR_ROS = not {"install", "develop"}.isdisjoint(sys.argv)
#: In a workspace every node is an executable of its name in lib/lidar_buildings. An environment of pip has
#: one `bin` for all packages, without such generic names: there it is `lidar-buildings node recorder`.
NODES = re.findall(r'NodeCard\(\s*"(\w+)"', (ROOT / PACKAGE / "nodes" / "table.py").read_text())

#: Where the sources are, as the release workflow says it: links of the page on PyPI lead there.
URL = os.environ.get("REPOSITORY_URL", "")
README = (ROOT / "README.md").read_text(encoding="utf-8")
if URL:
    README = re.sub(r"\]\((?!https?:|#)([^)]+\.png)\)", rf"]({URL}/raw/v{VERSION}/\1)", README)
    README = re.sub(r"\]\((?!https?:|#)([^)]+)\)", rf"]({URL}/blob/v{VERSION}/\1)", README)

ROS_WHEELS = [
    "ros-rclpy[fastrtps]==7.1.6",
    "ros-common-interfaces==5.3.6",
    "ros-sensor-msgs==5.3.6",
    "ros-geometry-msgs==5.3.6",
    "ros-visualization-msgs==5.3.6",
    "ros-std-msgs==5.3.6",
    "ros-nav-msgs==5.3.6",
    "ros-diagnostic-msgs==5.3.6",
    "ros-rosgraph-msgs==2.0.3",
    "ros-shape-msgs==5.3.6",
    "ros-std-srvs==5.3.6",
]
CLUSTER = ["distributed>=2024.8"]
# what reads https; s3fs, gcsfs, adlfs … are for those who have such stores
CLOUD = ["fsspec>=2024.6", "universal-pathlib>=0.3", "aiohttp"]
COMPLETION = ["shtab>=1.13"]
# PLY and PCD
FORMATS = ["trimesh>=4", "pypcd4>=1.1"]
# the build for graphics cards is four times as large; from this release on pictures need no display
VIEW = ["open3d-cpu>=0.20; platform_machine == 'x86_64'", "open3d>=0.20; platform_machine != 'x86_64'"]
DOC = ["sphinx>=8", "furo>=2024.8", "myst-parser>=4"]
TEST = [
    *CLUSTER,
    *CLOUD,
    *DOC,
    *FORMATS,
    *COMPLETION,
    "pytest>=8",
    "pytest-xdist",
    "hypothesis",
    "startinpy",
    "cjio",
    "ezdxf>=1.0",
    "geopandas",
    "trimesh>=5",
    "ruff",
    "mypy",
    "matplotlib",
]
# peers of the benchmarks, all of permissive licences (bench/*/peers.py)
BENCH = [
    # jakteristics has no wheel for later ones
    "jakteristics; python_version < '3.13'",
    "pgeof",
    *VIEW,
    "buildingregulariser",
    "geopandas",
    "matplotlib",
]

setup(
    name=PACKAGE,
    version=VERSION,
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: ["py.typed", "*.pyi", "ros/*.xml", "commands/*.npz", "io/models/*.dxf", "report/page/*"]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", glob("config/*")),
        (f"share/{PACKAGE}/launch", glob("launch/*.launch.py")),
    ],
    install_requires=[
        "setuptools",
        "numpy>=1.26.4",
        "scipy>=1.11.4",
        "numba>=0.58.1",
        "scikit-learn>=1.4.1.post1",
        "shapely>=2.0.3",
        "laspy>=2.5",
        "lazrs>=0.6",
        "pyproj>=3.6.1",
        "pyogrio>=0.9",
        "rasterio>=1.3.9",
        "pyyaml>=6",
        "tqdm>=4.66",
        "rosbags>=0.11",
        "mcap>=1.2.1",
    ],
    extras_require={
        "ros": ROS_WHEELS,
        "cluster": [*CLUSTER, "bokeh"],  # bokeh shows dask's dashboard
        "cloud": CLOUD,
        "formats": FORMATS,
        "completion": COMPLETION,
        "view": VIEW,
        "terrain": ["startinpy>=0.12"],
        "doc": DOC,
        "test": TEST,
        "bench": BENCH,
    },
    python_requires=">=3.10",
    # compiled loops are cached beside their modules, and the middleware profile is a file
    zip_safe=False,
    author="The lidar_buildings developers",
    author_email="maintainers@users.noreply.github.com",
    maintainer="The lidar_buildings developers",
    maintainer_email="maintainers@users.noreply.github.com",
    description="Raw lidar in, valid 3D city models out: a ROS 2 node graph for buildings from point clouds.",
    long_description=README,
    long_description_content_type="text/markdown",
    keywords=["ROS", "lidar", "point cloud", "buildings", "CityJSON"],
    project_urls={
        "Source": URL,
        "Documentation": f"{URL}/tree/v{VERSION}/doc/index.md",
        "Changelog": f"{URL}/blob/v{VERSION}/CHANGELOG.rst",
        "Issues": f"{URL}/issues",
    }
    if URL
    else {},
    license="Apache-2.0",
    license_files=["LICENSE"],
    classifiers=[
        "Development Status :: 4 - Beta",
        "Environment :: Console",
        "Intended Audience :: Developers",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        *(f"Programming Language :: Python :: 3.{minor}" for minor in (10, 11, 12, 13)),
        "Topic :: Scientific/Engineering :: GIS",
        "Typing :: Typed",
    ],
    entry_points={
        "console_scripts": [
            "lidar-buildings = lidar_buildings.cli:console",
            *(f"{one} = {PACKAGE}.commands.node:node_process" for one in NODES if IS_FOR_ROS),
        ],
    },
)
