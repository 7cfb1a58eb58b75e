"""Compiled loops are made in one way, with numba's public interface."""

import ast

from support.source_tree import MODULES, ROOT, tree_of

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


def test_loops_are_compiled_in_the_one_way_of_the_house():
    decorators = {
        ast.unparse(decorator)
        for path in MODULES
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.FunctionDef)
        for decorator in node.decorator_list
        if "jit" in ast.unparse(decorator) or "kernel" in ast.unparse(decorator)
    }
    assert decorators == {"kernel"}
