"""What the house's compiler leaves to later, or out, nobody misses."""

import os
import subprocess
import sys
import textwrap

import numpy as np
from numba.core.dispatcher import Dispatcher

from lidar_buildings.core.compiling import LoopLibrary
from lidar_buildings.core.kernels import inner_kernel, kernel

LOOPS = """
    import numpy as np
    from lidar_buildings.core.kernels import kernel

    @kernel
    def double(x):
        return 2.0 * x

    @kernel
    def quadruple(x):
        return double(double(x))
"""


@inner_kernel
def _sum_below(values, limit):
    total = 0.0
    for value in values:
        if value < limit:
            total += value
    return total


@kernel
def _sums_below(values, limits):
    sums = np.empty(len(limits))
    for i, limit in enumerate(limits):
        sums[i] = _sum_below(values, limit)
    return sums


def library_of(loop: Dispatcher):
    (compiled,) = loop.overloads.values()
    return compiled.library


def test_an_inner_loop_has_no_machine_code_but_in_those_that_call_it():
    values = np.arange(10.0)
    assert _sums_below(values, np.array([0.0, 3.0, 99.0])).tolist() == [0.0, 3.0, 45.0]
    inner = library_of(_sum_below)
    assert isinstance(inner, LoopLibrary)
    assert not inner._is_made


def test_a_loop_read_from_a_file_while_another_is_compiled_can_be_called_by_python(tmp_path):
    (tmp_path / "loops.py").write_text(textwrap.dedent(LOOPS))
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    for call in ("loops.double(2.0)", "loops.quadruple(1.0), loops.double(2.0)"):
        done = subprocess.run(
            [sys.executable, "-c", f"import sys; sys.path.insert(0, '.'); import loops; print({call})"],
            cwd=tmp_path,
            env=environment | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "4.0 4.0"


def test_a_numba_that_was_not_tried_compiles_in_its_own_way(tmp_path):
    (tmp_path / "loops.py").write_text(textwrap.dedent(LOOPS))
    script = """
        import sys
        import numba
        numba.__version__ = "99.0"
        import loops
        assert "lidar_buildings.core.compiling" not in sys.modules
        print(loops.quadruple(1.0), loops.double(2.0))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)],
        cwd=tmp_path,
        env=os.environ
        | {
            "NUMBA_CACHE_DIR": "kept",
            "PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)]),
        },
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout.strip()) == (0, "4.0 4.0"), done.stderr
