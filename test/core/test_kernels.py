"""How loops are compiled."""

import os
import subprocess
import sys

import numpy as np
from numba.core.caching import NullCache

from lidar_buildings.core.kernels import inner_kernel, kernel


@inner_kernel
def raised(number, by):
    return number + by


@kernel
def raised_twice(number):
    return raised(raised(number, 1), 2)


@inner_kernel
def raised_by_one(number):
    return number + 1


@kernel
def raised_from(small, large):
    return raised_by_one(small[0]) + raised_by_one(large[0])


@kernel
def share(part, whole):
    return part / whole


def test_literal_numbers_make_no_copies():
    raised_twice._cache = NullCache()  # what comes from the disk compiles nothing
    assert raised_twice(3) == 6
    assert len(raised.signatures) == 1


def test_numbers_of_32_bits_make_no_copies():
    raised_from._cache = NullCache()
    assert raised_from(np.array([3], dtype=np.int32), np.array([4])) == 9
    assert len(raised_by_one.signatures) == 1


def test_a_loop_from_a_file_is_put_into_those_that_are_compiled(tmp_path):
    """What is loaded is machine code; a loop that calls it asks for what the compiler needs."""
    script = tmp_path / "loops.py"
    script.write_text(
        "import sys\n"
        "from lidar_buildings.core.kernels import kernel\n"
        "@kernel\n"
        "def doubled(number):\n    return 2 * number\n"
        "@kernel\n"
        "def of_doubled(number):\n    return doubled(number) + 1\n"
        "if sys.argv[1] == 'first':\n    doubled(3)\n"
        "else:\n    assert doubled(3) == 6 and doubled.stats.cache_hits\n    assert of_doubled(3) == 7\n"
    )
    for turn in ("first", "second"):
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
        subprocess.run([sys.executable, str(script), turn], env=environment, check=True)


def test_loops_divide_as_numpy_does():
    assert share(1.0, 0.0) == float("inf")
