"""Compiled loops are made in one way, with numba's public interface."""

import ast
from collections import Counter

import pytest
from support.source_tree import MODULES, ROOT, tree_of

from lidar_buildings.core import kernel_cache

PRIVATE = ("numba.core", "numba.np", "numba.extending", "llvmlite")
SOURCES = [*MODULES, *sorted((ROOT / "test").rglob("*.py")), *sorted((ROOT / "bench").rglob("*.py"))]


def imported_by(path):
    """The modules that a file imports."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (one.name for one in node.names)


def test_nothing_private_of_numba_is_imported():
    private = {
        str(path.relative_to(ROOT)): name
        for path in SOURCES
        for name in imported_by(path)
        if name.startswith(PRIVATE)
    }
    assert private == {}


def test_loops_are_compiled_in_the_ways_of_the_house():
    decorators = {
        ast.unparse(decorator)
        for path in MODULES
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.FunctionDef)
        for decorator in node.decorator_list
        if "jit" in ast.unparse(decorator) or "kernel" in ast.unparse(decorator)
    }
    assert decorators == {"kernel", "inner_kernel"}


def test_warming_up_compiles_each_loop_for_arguments_of_one_kind():
    complete = kernel_cache.marker()
    if complete is None or not complete.exists():
        pytest.skip("run `lidar-buildings warm-up` first")
    # What tests compile later, with arguments of their own, does not count.
    ended = complete.stat().st_mtime
    codes = [path for path in complete.parent.rglob("*.nbc") if path.stat().st_mtime <= ended]
    assert codes
    # package/__pycache__/module.loop-line.py311.1.nbc
    n_kinds = Counter(str(path).rsplit(".", 2)[0] for path in codes)
    assert [loop for loop, n in n_kinds.items() if n > 1] == []
